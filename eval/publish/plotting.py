"""Colours, fonts, lines and files of all figures. The same rows give the same bytes."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eval.rows.files import writing
from sshade.core.whole_files import check_suffix
from sshade.plotting.pictures import View, new_plotter, panel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sshade.mesh.mesh import Mesh

#: Formats of figures, by suffix.
SUFFIXES = (".svg", ".png")

#: Metadata without the time and the version of the library, which would change the bytes.
_METADATA = {
    ".png": {"Software": None},
    ".svg": {"Date": None, "Creator": None},
}

#: Default folder of figures.
FIGURES = Path("out/figures")


@contextmanager
def style() -> Iterator[None]:
    """Set the style of figures that are made and saved in this context or in a decorated function."""
    import matplotlib

    with matplotlib.rc_context(
        {
            "font.size": 8,
            "axes.titlesize": 9,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "legend.frameon": False,
            "legend.fontsize": 7,
            "svg.hashsalt": "sshade",
        }
    ):
        yield


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of a size in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def save(figure: Figure, path: Path) -> None:
    """Write a figure as .svg or .png, by the suffix of the path, and print the path.

    A .png has 256 colours, and about a third of the bytes.

    Raises
    ------
    InputError
        On another suffix.
    """
    suffix = path.suffix.lower()
    check_suffix(path, SUFFIXES)
    with style(), writing(path) as temporary:
        figure.savefig(temporary, format=suffix[1:], dpi=150, metadata=_METADATA[suffix])
        if suffix == ".png":
            _reduce(temporary)
    print(path)  # noqa: T201


def _reduce(path: Path) -> None:
    """Reduce a picture to 256 colours. Rare colours, such as of handles, stay."""
    from PIL import Image

    with Image.open(path) as whole:
        picture = whole.convert("RGB")
    palette = picture.quantize(256, method=Image.Quantize.MAXCOVERAGE)
    reduced = picture.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG)
    reduced.save(path, format="PNG", optimize=True)


def picture(mesh: Mesh, V: np.ndarray, *, view: View, width: int = 600, **options: Any) -> np.ndarray:
    """Render a shape without a display.

    Parameters
    ----------
    mesh : Mesh
        Rest shape, which gives the faces and the size of the handles.
    V : (n, 3) float64
        Positions to show.
    view : View
    width : int
        Width in pixels; the view determines the height.
    **options
        See :func:`sshade.plotting.pictures.panel`.

    Returns
    -------
    (h, w, 3) uint8
    """
    plotter = new_plotter(window_size=view.pixels(width))
    panel(plotter, mesh, V, view, **options)
    pixels = plotter.screenshot(return_img=True)
    plotter.close()
    return pixels


def to_svg(figure: Figure) -> str:
    """Return a figure as SVG text."""
    text = io.StringIO()
    with style():
        figure.savefig(text, format="svg", metadata=_METADATA[".svg"])
    return text.getvalue()
