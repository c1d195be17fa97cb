import doctest
import importlib
import pkgutil
import re
import subprocess
import sys

import pytest

import sshade
from eval import EXTRAS

HEAVY = ["pymeshlab", "pandas", "hydra", "omegaconf", "torch", "pyvista", "matplotlib", "trimesh", "rich"]
MODULES = ["sshade", *(info.name for info in pkgutil.walk_packages(sshade.__path__, "sshade."))]


@pytest.mark.parametrize("program", ["sshade.cli.main", "defaust.cli", "eval.main"])
def test_help_imports_no_library(program):
    code = f"import sys, {program} as p\ntry: p.main(['--help'])\nfinally: print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    *text, modules = run.stdout.splitlines()
    assert run.returncode == 0 and len(text) > 5
    assert not {"numpy", "scipy", "numba", "yaml", *HEAVY, *EXTRAS} & set(modules.split())


def test_names_of_the_package_are_found_when_they_are_asked_for():
    assert set(sshade.__all__) == set(sshade._HOME) <= set(dir(sshade))
    assert set(dir(sshade)) == {*sshade.__all__, "__version__"}
    for name in sshade.__all__:
        value = getattr(sshade, name)
        assert value.__name__ == {"Deformer": "Bound"}.get(name, name)
    with pytest.raises(AttributeError, match="no attribute 'shade'"):
        sshade.shade  # noqa: B018


@pytest.mark.parametrize("name", [name for name in MODULES if not re.search(r"__main__$|blender\.", name)])
def test_examples_in_docstrings_do_what_they_show(name):
    assert doctest.testmod(importlib.import_module(name)).failed == 0
