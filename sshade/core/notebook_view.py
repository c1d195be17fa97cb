"""Objects that show themselves in a notebook."""

from __future__ import annotations

from importlib import import_module

from sshade.core.errors import InputError

#: Module that draws. It lies above this one, and is imported by name.
FIGURES = "sshade.plotting.figure"


class Shown:
    """Base of types that :func:`sshade.plot` draws."""

    def _repr_html_(self) -> str | None:
        """Return a 3D view for a notebook, or None if there is nothing to draw."""
        try:
            return import_module(FIGURES).plot(self)._repr_html_()
        except InputError:
            return None
