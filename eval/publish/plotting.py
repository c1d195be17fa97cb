"""Colours, fonts, lines and files of all figures. The same rows give the same bytes."""

from __future__ import annotations

import argparse
import io
import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eval.rows.files import writing
from sshade.core.atomic import check_suffix
from sshade.plotting.pictures import TOWARDS, UP, View, new_plotter, panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from sshade.mesh.mesh import Mesh

#: Colours of methods in the order of the table; colour-blind people can tell them apart.
PALETTE = (
    *("#0072b2", "#e69f00", "#009e73", "#d55e00", "#cc79a7"),
    *("#56b4e9", "#8c6d31", "#6b6ecf", "#637939", "#7f7f7f"),
)
MARKERS = "osD^vPX*<>"

#: Directions in which a name can stand from its point, to the right and up, and distances in points.
SIDES = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1))
DISTANCES = (6, 14, 24, 36, 50)
#: Line from a name to its point.
LINE = {"arrowstyle": "-", "color": "#999999", "linewidth": 0.5, "shrinkB": 3}

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

#: Metadata without the time and the version of the library, which would change the bytes.
_METADATA = {
    ".png": {"Software": None},
    ".pdf": {"CreationDate": None, "Producer": None, "Creator": None},
    ".svg": {"Date": None, "Creator": None},
}

#: Default folder of figures.
FIGURES = Path("out/figures")


@contextmanager
def style() -> Iterator[None]:
    """Set the style of figures that are made and saved in this context or in a decorated function."""
    import matplotlib

    with matplotlib.rc_context(_STYLE):
        yield


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of a size in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def look(methods: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Return the colour and marker of each method, by its position."""
    return {
        method: {"color": PALETTE[i % len(PALETTE)], "marker": MARKERS[i // len(PALETTE) % len(MARKERS)]}
        for i, method in enumerate(methods)
    }


def plot_points(
    axes: Axes, points: Mapping[str, Iterable[tuple[float, float]]], looks: Mapping[str, dict[str, Any]]
) -> None:
    """Plot (x, y) of each method: a line through several points, a marker for a single point."""
    for method, own in points.items():
        x, y = zip(*own, strict=True)
        line = "-" if len(x) > 1 else "none"
        axes.plot(x, y, linestyle=line, linewidth=1.2, markersize=4, label=method, **looks[method])


def name_points(
    axes: Axes, points: Mapping[str, Sequence[tuple[float, float]]], looks: Mapping[str, dict[str, Any]]
) -> None:
    """Write the name of each method near its point, so that it covers no point and no other name.

    Names without space go to a legend. Call this after everything else in the figure is drawn: the layout
    decides where names fit.
    """
    from matplotlib.text import Text
    from matplotlib.transforms import Bbox

    axes.figure.draw_without_rendering()
    inside = axes.get_window_extent()
    left = []
    places = axes.transData.transform([own[0] for own in points.values()])
    taken = [Bbox([(x - 5, y - 5), (x + 5, y + 5)]) for x, y in places]
    for method, ((x, y), *_) in points.items():
        for distance, (right, up) in itertools.product(DISTANCES, SIDES):
            text = axes.annotate(
                method,
                (x, y),
                (distance * right, distance * up),
                textcoords="offset points",
                ha=("right", "center", "left")[right + 1],
                va=("top", "center", "bottom")[up + 1],
                color=looks[method]["color"],
                arrowprops=LINE if distance > DISTANCES[0] else None,
                in_layout=False,
            )
            text.get_window_extent()  # updates the position
            box = Text.get_window_extent(text)  # without the line
            fits = inside.x0 <= box.x0 and box.x1 <= inside.x1 and inside.y0 <= box.y0 and box.y1 <= inside.y1
            if fits and not any(box.overlaps(other) for other in taken):
                break
            text.remove()
        else:
            left.append(method)
            continue
        taken.append(box.padded(2))
    if left:
        axes.legend([line for line in axes.lines if line.get_label() in left], left)


def save(figure: Figure, path: Path, *, small: bool = False) -> None:
    """Write a figure as .svg, .pdf or .png, by the suffix of the path, and print the path.

    A `small` .png has 256 colours and fewer pixels, and about a third of the bytes.

    Raises
    ------
    InputError
        On another suffix.
    """
    suffix = path.suffix.lower()
    check_suffix(path, SUFFIXES)
    with style(), writing(path) as temporary:
        figure.savefig(temporary, format=suffix[1:], dpi=150 if small else 200, metadata=_METADATA[suffix])
        if small and suffix == ".png":
            _reduce(temporary)
    print(path)  # noqa: T201


def _reduce(path: Path) -> None:
    """Reduce a picture to 256 colours. Rare colours, such as of handles, stay."""
    from PIL import Image

    with Image.open(path) as whole:
        picture = whole.convert("RGB")
    # Colours in invisible steps of 4 count once each; otherwise many similar blends would displace a rare
    # colour.
    distinct = np.unique(np.asarray(picture).reshape(-1, 3) & 252, axis=0)
    palette = Image.fromarray(distinct[None].astype(np.uint8)).quantize(255)
    colours = palette.getpalette()[: 3 * 255]
    palette.putpalette([*colours, *[255] * (3 * 256 - len(colours))])
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


def add_camera(parser: argparse.ArgumentParser) -> None:
    """Declare --towards, the direction from the scene to the camera, and --up, the upright direction."""
    text = f"direction from the scene to the camera (default: {' '.join(f'{x:g}' for x in TOWARDS)})"
    parser.add_argument("--towards", nargs=3, type=float, metavar=("X", "Y", "Z"), help=text)
    text = f"upward direction (default: {' '.join(f'{x:g}' for x in UP)})"
    parser.add_argument("--up", nargs=3, type=float, metavar=("X", "Y", "Z"), help=text)


def camera(options: argparse.Namespace, defaults: Mapping[str, Any] | None = None) -> dict[str, np.ndarray]:
    """Return ``towards`` and ``up``, (3,) float64, of parsed arguments, with defaults."""
    defaults = {"towards": TOWARDS, "up": UP, **(defaults or {})}
    return {name: np.array(getattr(options, name) or defaults[name]) for name in ("towards", "up")}
