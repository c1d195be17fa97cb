"""The benchmark: metrics, one run to one row, tables and figures from rows.

The command is ``sshade-eval``: :mod:`eval.main`.

In a clone, the folder ``conf`` of YAML files lies beside the packages; a wheel has a copy in ``eval/conf``.
It is found from the place of this module and not by its name: users may have folders called ``conf``.
"""

from __future__ import annotations

from pathlib import Path

PACKAGES = Path(__file__).resolve().parents[1]

_SHIPPED = PACKAGES / "eval" / "conf"

#: Folder of the YAML files of methods, datasets and experiments.
CONFIGURATION = _SHIPPED if _SHIPPED.is_dir() else PACKAGES / "conf"

#: Extra of the package that brings a library, by the module that is imported: for the libraries of this
#: package, and of the methods and datasets that it runs.
EXTRAS = {
    **dict.fromkeys(("igl", "pymeshlab", "pandas", "hydra", "omegaconf"), "bench"),
    **dict.fromkeys(("pyvista", "matplotlib", "jinja2", "PIL"), "figures"),
    **{"torch": "torch", "pytetwild": "tet", "simkit": "neo-hookean", "ray": "ray"},
}
