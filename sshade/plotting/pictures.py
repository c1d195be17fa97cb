"""Draw shapes with handles, in blue (fixed) and yellow (moved), plain or in colours.

The functions that draw need pyvista, from the extra ``figures``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from sshade.core.errors import InputError

if TYPE_CHECKING:
    from sshade.mesh.mesh import Mesh
    from sshade.problem.task import Handles

STATIC, DYNAMIC, BODY, PATH = "#2166ac", "#f2c200", "#d9d5cf", "#8c8c8c"

#: Colour map of errors, from light to dark.
COLOURS = "magma_r"

#: Default direction from the scene to the camera, and upward direction.
TOWARDS, UP = (0.5, 0.25, 1.0), (0.0, 1.0, 0.0)
#: Both directions.
ViewDirection = tuple[ArrayLike, ArrayLike]
#: Both directions, by the axis that points up.
CAMERAS: dict[str, ViewDirection] = {
    "y": (TOWARDS, UP),
    "z": ((TOWARDS[0], -TOWARDS[2], TOWARDS[1]), (0.0, 0.0, 1.0)),
}

#: Radius of the sphere of a handle, over the bounding-box diagonal.
SPHERE = 0.0025
#: Largest number of handles that are drawn.
HANDLES = 1500
#: Radius of the shaft of an arrow, over the bounding-box diagonal.
SHAFT = 0.0012
#: What the colours of a shape can show, with the unit.
COLOUR_LABELS = {
    "stretch": "change of edge length (%)",
    "distance": "distance from the first shape (% of the diagonal)",
}

#: Width of a panel, and its greatest height, in pixels.
PANEL = 900
#: Least width of a picture with a colour bar, in pixels.
LEAST = 450

#: Percentiles over vertices and over shapes for the end of a colour scale, which ignores few extreme values.
PERCENTILE, SHAPES = 98, 75
#: Changes of length, in percent, that are rounding.
ROUNDING = 1e-6


@dataclass(frozen=True)
class View:
    """A parallel projection that shows a whole box.

    Parameters
    ----------
    axes : (3, 3) float64
        Rows: the axes of the picture to the right and upwards, and the direction to the camera.
    centre : (3,) float64
    size : (3,) float64
        Width, height and depth: the extent along the axes, in the unit of length of the mesh.
    """

    axes: np.ndarray
    centre: np.ndarray
    size: np.ndarray

    @classmethod
    def of(cls, shapes: Iterable[np.ndarray], *, towards: ArrayLike = TOWARDS, up: ArrayLike = UP) -> View:
        """Return a view of all shapes (n, 3), with a margin. The two directions are not parallel."""
        forward, upright = np.asarray(towards, dtype=np.float64), np.asarray(up, dtype=np.float64)
        right = np.cross(upright, forward)
        forward = forward / np.linalg.norm(forward)
        right = right / np.linalg.norm(right)
        axes = np.stack([right, np.cross(forward, right), forward])
        points = np.concatenate([np.asarray(shape) for shape in shapes]) @ axes.T
        low, high = points.min(axis=0), points.max(axis=0)
        size = np.maximum(1.06 * (high - low), 1e-3 * np.linalg.norm(high - low))
        return cls(axes, 0.5 * (low + high) @ axes, size)

    def with_foot(self, fraction: float) -> View:
        """Return a view with additional space below, as a fraction of the height."""
        foot = np.array([0.0, fraction * self.size[1], 0.0])
        return replace(self, size=self.size + foot, centre=self.centre - 0.5 * foot @ self.axes)

    def pixels(self, width: int) -> tuple[int, int]:
        """Return the width and height of a picture of this view."""
        return width, max(1, round(width * self.size[1] / self.size[0]))


def edge_error(rest: Mesh, vertices: np.ndarray) -> np.ndarray:
    """Return the mean relative length change of the edges at each vertex (n,), in percent."""
    edges = rest.edges
    before, after = (np.linalg.norm(V[edges[:, 0]] - V[edges[:, 1]], axis=1) for V in (rest.V, vertices))
    # Edges without length at rest count as unchanged.
    change = np.abs(after - before) / np.where(before > 0, before, np.inf)
    ends = edges.T.ravel()
    total = np.bincount(ends, np.tile(change, 2), rest.n)
    return 100 * total / np.bincount(ends, minlength=rest.n)


def colour_values(rest: Mesh, vertices: np.ndarray, colour: str) -> np.ndarray:
    """Return the values (n,) of a shape that a colour of :data:`COLOUR_LABELS` shows."""
    if colour == "distance":
        return 100 * np.linalg.norm(vertices - rest.V, axis=1) / rest.diagonal
    return edge_error(rest, vertices)


def colour_range(errors: Iterable[np.ndarray]) -> float:
    """Return the upper end of a common colour scale for several shapes.

    It is the upper quartile over the shapes of the 98th percentile of each shape, or 1 if that is no more
    than :data:`ROUNDING`.
    """
    top = float(np.percentile([np.percentile(error, PERCENTILE) for error in errors], SHAPES))
    return top if top > ROUNDING else 1.0


def new_plotter(**options: Any) -> Any:
    """Return a pyvista plotter with a white background, which draws off-screen.

    Raises
    ------
    InputError
        When there is neither a screen nor a library that draws without a screen.
    """
    import pyvista

    # Without a display VTK prints a needless warning.
    pyvista.vtk_verbosity("error")
    _require_renderer()
    plotter = pyvista.Plotter(off_screen=True, border=False, **options)
    plotter.set_background("white")
    return plotter


@cache
def _require_renderer() -> None:
    """Raise InputError if VTK finds no library to draw with; it would end the process."""
    from ctypes import CDLL

    import vtkmodules.vtkRenderingOpenGL2  # noqa: F401 - registers the classes of vtkRenderWindow()
    from vtkmodules.vtkRenderingCore import vtkRenderWindow

    # VTK falls back on this class without checking that its library exists.
    if vtkRenderWindow().GetClassName() == "vtkOSOpenGLRenderWindow":
        for name in ("libOSMesa.so.8", "libOSMesa.so"):
            with suppress(OSError):
                CDLL(name)
                return
        raise InputError(
            "pictures need a screen, or libEGL and a software renderer "
            "(Debian, Ubuntu: apt install libegl1 libgl1-mesa-dri)"
        )


def draw(
    mesh: Mesh,
    handles: Handles | None,
    poses: Sequence[np.ndarray] = (),
    *,
    colour: str | None = None,
    **look: ArrayLike,
) -> Any:
    """Return a pyvista plotter with the rest shape and its poses side by side, with linked views.

    Parameters
    ----------
    mesh : Mesh
        Rest shape.
    handles : Handles, optional
    poses : sequence of (n, 3) float64
    colour : str, optional
        A key of :data:`COLOUR_LABELS`. By default shapes are plain.
    **look
        The directions `towards` and `up` of :meth:`View.of`.
    """
    shapes = [mesh.V, *poses]
    view = View.of(shapes if handles is None else [*shapes, handles.target], **look)
    values = [colour_values(mesh, V, colour) for V in poses] if colour else []
    if values:
        view = view.with_foot(0.12)  # for the colour bar
    width, height = view.pixels(PANEL)
    scale = min(1.0, PANEL / height)
    least = LEAST if values else 0  # for the words of the colour bar
    size = (len(shapes) * max(round(scale * width), least), round(scale * height))
    plotter = new_plotter(shape=(1, len(shapes)), window_size=size)
    top = colour_range(values) if values else 1.0
    for column, V in enumerate(shapes):
        plotter.subplot(0, column)
        error = values[column - 1] if column and values else None
        bar = COLOUR_LABELS[colour] if colour and error is not None else None
        panel(plotter, mesh, V, view, error=error, top=top, bar=bar, handles=handles, targets=not column)
    plotter.link_views()
    return plotter


def panel(
    plotter: Any,
    mesh: Mesh,
    V: np.ndarray,
    view: View,
    *,
    error: np.ndarray | None = None,
    top: float = 1.0,
    bar: str | None = None,
    handles: Handles | None = None,
    targets: bool = False,
) -> None:
    """Draw a shape in the active panel of a plotter.

    Parameters
    ----------
    plotter : pyvista.Plotter
    mesh : Mesh
        Rest shape, which gives the faces and the size of the handles.
    V : (n, 3) float64
        Positions to show.
    view : View
    error : (n,) float64, optional
        Values that colour the surface, on a scale from 0 to `top`.
    top : float
    bar : str, optional
        Title of a colour bar.
    handles : Handles, optional
        Handles, shown at their vertices of `V`.
    targets : bool
        Also show the targets of dynamic handles, pale, and an arrow for each group.
    """
    import pyvista

    surface = pyvista.PolyData.from_regular_faces(V, mesh.F)
    if error is None:
        plotter.add_mesh(surface, smooth_shading=True, color=BODY, ambient=0.25, diffuse=0.85)
    else:
        bar_style = {"title": bar, "color": "black", "n_labels": 2, "fmt": "%.3g"}
        bar_place = {"position_x": 0.2, "position_y": 0.01, "width": 0.6, "height": 0.07}
        plotter.add_mesh(
            surface,
            smooth_shading=True,
            scalars=error,
            clim=(0, top),
            cmap=COLOURS,
            # The light keeps the colours close to the colour bar.
            ambient=0.4,
            diffuse=0.6,
            show_scalar_bar=bar is not None,
            scalar_bar_args=bar_style | bar_place,
        )
    if handles is not None:
        add_handles(plotter, V, handles, size=mesh.diagonal, targets=targets)
    aim(plotter, view)
    plotter.enable_anti_aliasing("ssaa")


def aim(plotter: Any, view: View) -> None:
    """Point the camera of the active panel at a view."""
    width, height = plotter.renderer.GetSize()
    plotter.enable_parallel_projection()
    plotter.camera.focal_point = view.centre
    plotter.camera.position = view.centre + 2 * view.size.sum() * view.axes[2]
    plotter.camera.up = view.axes[1]
    # Half the visible height, which is larger if the panel is narrower than the view.
    plotter.camera.parallel_scale = 0.5 * max(view.size[1], view.size[0] * height / width)
    plotter.reset_camera_clipping_range()


def add_handles(plotter: Any, V: np.ndarray, handles: Handles, *, size: float, targets: bool) -> None:
    """Add handles as spheres; the bounding-box diagonal `size` determines the size of the spheres."""
    import pyvista

    ball = pyvista.Sphere(radius=SPHERE * size, theta_resolution=12, phi_resolution=12)

    def balls(points: np.ndarray, colour: str, **options: Any) -> None:
        if len(points):
            many = pyvista.PolyData(points).glyph(geom=ball, scale=False, orient=False)
            plotter.add_mesh(many, color=colour, ambient=0.5, diffuse=0.6, **options)

    moving = handles.dynamic
    drawn = some(len(handles))
    fixed, free = drawn[~moving[drawn]], drawn[moving[drawn]]
    balls(V[handles.index[fixed]], STATIC)
    balls(V[handles.index[free]], DYNAMIC)
    if not targets:
        return
    balls(handles.target[free], DYNAMIC, opacity=0.45)
    for group in np.unique(handles.group[moving]):
        own = moving & (handles.group == group)
        begin, target = V[handles.index[own]], handles.target[own]
        foremost = np.argmax(begin @ (target - begin).mean(axis=0))  # an arrow from the middle is hidden
        start, end = begin[foremost], target[foremost]
        if (length := float(np.linalg.norm(end - start))) > SPHERE * size:
            tip = min(0.3, 12 * SHAFT * size / length)
            arrow = pyvista.Arrow(
                start=start,
                direction=end - start,
                scale=length,
                tip_length=tip,
                tip_radius=0.4 * tip,
                shaft_radius=SHAFT * size / length,
            )
            plotter.add_mesh(arrow, color=PATH)


def some(count: int) -> np.ndarray:
    """Return numbers of handles to draw: all, or :data:`HANDLES` of them."""
    return np.unique(np.linspace(0, count - 1, min(count, HANDLES)).astype(np.int64))
