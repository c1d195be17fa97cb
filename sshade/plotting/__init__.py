"""3D views on web pages: the shapes that they show, reduced and packed, and the parts of their pages.

:mod:`sshade.plotting.figure` makes figures for notebooks. The report of the evaluator uses the same parts.
"""

from __future__ import annotations

from importlib.resources import files

#: Colours of values from the least to the greatest, at equal distances: magma of matplotlib, reversed.
COLOURS = (
    "#fbfcbf, #fde1a3, #fec689, #feaa74, #fc8e63, #f7715b, #ec585f, #d9466a, #c23a75, "
    "#a9327c, #912a80, #792281, #61187f, #4a1079, #301065, #1a1041, #09071f, #000003"
)


def part(name: str) -> str:
    """Return a part of a page by its file name. "viewer.js" needs ``THREE`` of `threejs`."""
    return files(__name__).joinpath(name).read_text(encoding="utf-8")


def style() -> str:
    """Return the style sheet of the view."""
    return f"{part('view.css')}.ramp {{ background: linear-gradient(to right, {COLOURS}); }}\n"
