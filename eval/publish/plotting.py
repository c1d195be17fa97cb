"""What the drawn figures share: colours, fonts, lines, and files that the same rows give byte by byte."""

from __future__ import annotations

import argparse
import io
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sshade.errors import InputError
from sshade.figures import TOWARDS, UP
from sshade.io.files import make_folder, replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Colours of methods in the order of the table; told apart by people who do not see all of them.
PALETTE = (
    *("#0072b2", "#e69f00", "#009e73", "#d55e00", "#cc79a7"),
    *("#56b4e9", "#8c6d31", "#6b6ecf", "#637939", "#7f7f7f"),
)
MARKERS = "osD^vPX*<>"

#: Formats of figures, by suffix.
SUFFIXES = (".svg", ".pdf", ".png")

_STYLE = {
    "font.size": 8,
    "axes.titlesize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "legend.fontsize": 7,
    "svg.hashsalt": "sshade",
    "pdf.fonttype": 42,
}

#: Without the time and the library's version in the file the same rows give the same bytes.
_METADATA = {
    ".png": {"Software": None},
    ".pdf": {"CreationDate": None, "Producer": None, "Creator": None},
    ".svg": {"Date": None, "Creator": None},
}


#: Where figures go unless told.
FIGURES = Path("out/figures")


@contextmanager
def style() -> Iterator[None]:
    """A context in which figures are made and saved, or as a decorator a function that makes one."""
    import matplotlib

    with matplotlib.rc_context(_STYLE):
        yield


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of a size in inches; it belongs to no window system."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def look(methods: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Colour and marker of each method, by its place."""
    return {
        method: {"color": PALETTE[i % len(PALETTE)], "marker": MARKERS[i // len(PALETTE) % len(MARKERS)]}
        for i, method in enumerate(methods)
    }


def plot_points(
    axes: Axes, points: Mapping[str, Iterable[tuple[float, float]]], looks: Mapping[str, dict[str, Any]]
) -> None:
    """Plot (x, y) of each method: a line through several, a marker alone for one."""
    for method, own in points.items():
        x, y = zip(*own, strict=True)
        line = "-" if len(x) > 1 else "none"
        axes.plot(x, y, linestyle=line, linewidth=1.2, markersize=4, label=method, **looks[method])


def axis_label(name: str, unit: str) -> str:
    """A measure's name with its unit, if it has one."""
    return f"{name.replace('_', ' ')} ({unit})" if unit not in ("", "-") else name.replace("_", " ")


def save(figure: Figure, path: Path, *, small: bool = False) -> None:
    """Write a figure as .svg, .pdf or .png, by the path's suffix, and print where it is.

    A .png that is to be `small` has 256 colours and fewer pixels: of surfaces a third of the bytes.

    Raises
    ------
    InputError
        On another suffix.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: unknown figure format {path.suffix!r}; use {', '.join(SUFFIXES)}")
    make_folder(path.parent)
    with style(), replacing(path) as temporary:
        figure.savefig(temporary, format=suffix[1:], dpi=150 if small else 200, metadata=_METADATA[suffix])
        if small and suffix == ".png":
            _reduce(temporary)
    print(path)  # noqa: T201


def _reduce(path: Path) -> None:
    """Leave a picture 256 colours, chosen from the distinct ones, so that rare ones stay, as of handles."""
    from PIL import Image

    with Image.open(path) as whole:
        picture = whole.convert("RGB")
    # In steps of 4, which nobody sees, or a hundred thousand blends would outvote a rare colour.
    distinct = np.unique(np.asarray(picture).reshape(-1, 3) & 252, axis=0)
    palette = Image.fromarray(distinct[None].astype(np.uint8)).quantize(255)
    colours = palette.getpalette()[: 3 * 255]
    palette.putpalette([*colours, *[255] * (3 * 256 - len(colours))])
    picture.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG).save(
        path, format="PNG", optimize=True
    )


def to_svg(figure: Figure) -> str:
    """A figure as SVG text."""
    text = io.StringIO()
    with style():
        figure.savefig(text, format="svg", metadata=_METADATA[".svg"])
    return text.getvalue()


def add_camera(parser: argparse.ArgumentParser) -> None:
    """Declare --towards and --up, from the scene to the camera and the upright direction."""
    parser.add_argument("--towards", nargs=3, type=float, metavar=("X", "Y", "Z"))
    parser.add_argument("--up", nargs=3, type=float, metavar=("X", "Y", "Z"))


def camera(options: argparse.Namespace, told: Mapping[str, Any] | None = None) -> dict[str, np.ndarray]:
    """The camera of parsed arguments, or of what else was told: ``towards`` and ``up``, (3,) float64."""
    usual = {"towards": TOWARDS, "up": UP, **(told or {})}
    return {name: np.array(getattr(options, name) or usual[name]) for name in ("towards", "up")}
