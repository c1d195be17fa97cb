"""Pictures of shapes: handles in blue (static) and yellow (dynamic), edge errors in colours.

Needs pyvista, of the extra ``figures``; it is imported where something is drawn.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.task import Handles

STATIC, DYNAMIC, BODY, PATH = "#2166ac", "#f2c200", "#d9d5cf", "#8c8c8c"

#: Colours of errors, light to dark.
COLOURS = "magma_r"

#: From the scene to the camera, and upright: the defaults.
TOWARDS, UP = (0.5, 0.25, 1.0), (0.0, 1.0, 0.0)

#: Radius of a handle's sphere over the bounding-box diagonal.
SPHERE = 0.006

#: The few most stretched vertices, or a shape that is nothing but stretched, would take all of a scale.
PERCENTILE, SHAPES = 98, 75


@dataclass(frozen=True)
class View:
    """A parallel projection that shows a box whole.

    Parameters
    ----------
    right, up, towards : (3,) float64
        Axes of the picture, and the direction from the scene to the camera.
    centre : (3,) float64
    width, height, depth : float
        Extent of the scene along the axes, in the mesh's unit of length.
    """

    right: np.ndarray
    up: np.ndarray
    towards: np.ndarray
    centre: np.ndarray
    width: float
    height: float
    depth: float

    @classmethod
    def of(cls, shapes: Iterable[np.ndarray], *, towards: ArrayLike = TOWARDS, up: ArrayLike = UP) -> View:
        """The view in which every shape (n, 3) fits, with a margin.

        Raises
        ------
        InputError
            When the camera would look along the upright direction.
        """
        forward, upright = np.asarray(towards, dtype=np.float64), np.asarray(up, dtype=np.float64)
        right = np.cross(upright, forward)
        if np.linalg.norm(right) <= 1e-9 * np.linalg.norm(upright) * np.linalg.norm(forward):
            raise InputError("the camera looks along the upright direction; choose another --towards or --up")
        forward = forward / np.linalg.norm(forward)
        right = right / np.linalg.norm(right)
        axes = np.stack([right, np.cross(forward, right), forward])
        points = np.concatenate([np.asarray(shape) for shape in shapes]) @ axes.T
        low, high = points.min(axis=0), points.max(axis=0)
        size = np.maximum(1.06 * (high - low), 1e-3 * np.linalg.norm(high - low))
        width, height, depth = (float(extent) for extent in size)
        return cls(axes[0], axes[1], axes[2], 0.5 * (low + high) @ axes, width, height, depth)

    def with_foot(self, share: float) -> View:
        """The same view with free space below, of a share of its height."""
        free = share * self.height
        return replace(self, height=self.height + free, centre=self.centre - 0.5 * free * self.up)

    def pixels(self, width: int) -> tuple[int, int]:
        """Width and height of a picture that this view fills."""
        return width, max(1, round(width * self.height / self.width))


def edge_error(rest: Mesh, vertices: np.ndarray) -> np.ndarray:
    """(n,) relative length change of the edges at each vertex, the mean, in percent."""
    edges = rest.edges
    before, after = (np.linalg.norm(V[edges[:, 0]] - V[edges[:, 1]], axis=1) for V in (rest.V, vertices))
    # An edge without length at rest counts as unchanged as long as it has none.
    change = np.abs(after - before) / np.where(before > 0, before, np.inf)
    ends = edges.T.ravel()
    total = np.bincount(ends, np.tile(change, 2), rest.n)
    return 100 * total / np.bincount(ends, minlength=rest.n)


def colour_range(errors: Iterable[np.ndarray]) -> float:
    """Upper end of one colour scale for several shapes, 1 if that is zero.

    The upper quartile, over the shapes, of the 98th percentile of each.
    """
    top = float(np.percentile([np.percentile(error, PERCENTILE) for error in errors], SHAPES))
    return top if top > 0 else 1.0


def picture(
    mesh: Mesh,
    V: np.ndarray,
    *,
    view: View,
    width: int = 600,
    error: np.ndarray | None = None,
    top: float = 1.0,
    handles: Handles | None = None,
) -> np.ndarray:
    """Render one shape, without a display.

    Parameters
    ----------
    mesh : Mesh
        Its faces, its rest shape, and the unit of the handles' size.
    V : (n, 3) float64
        Positions to show.
    view : View
    width : int
        In pixels; the height follows from the view.
    error : (n,) float64, optional
        Colours the surface on a scale from 0 to `top`.
    top : float
    handles : Handles, optional
        Shown at their vertices of `V`.

    Returns
    -------
    (h, w, 3) uint8
    """
    plotter = new_plotter(window_size=view.pixels(width))
    add_shape(plotter, mesh, V, error=error, top=top)
    if handles is not None:
        add_handles(plotter, V, handles, size=mesh.diagonal)
    aim(plotter, view)
    pixels = plotter.screenshot(return_img=True)
    plotter.close()
    return pixels


def new_plotter(**options: Any) -> Any:
    """An off-screen plotter of pyvista on white; `options` override that.

    Raises
    ------
    InputError
        Where there is neither a screen nor a library that draws without one.
    """
    import pyvista

    # Without a display VTK warns about it, then renders off-screen as it should.
    pyvista.vtk_verbosity("error")
    _require_renderer()
    plotter = pyvista.Plotter(**{"off_screen": True, "border": False, **options})
    plotter.set_background("white")
    return plotter


@cache
def _require_renderer() -> None:
    """Raise InputError where VTK would end the process, having nothing to draw with."""
    from ctypes import CDLL

    import vtkmodules.vtkRenderingOpenGL2  # noqa: F401 - what vtkRenderWindow() chooses from
    from vtkmodules.vtkRenderingCore import vtkRenderWindow

    # VTK's last resort, which it takes without asking whether its library is there.
    if vtkRenderWindow().GetClassName() == "vtkOSOpenGLRenderWindow":
        for name in ("libOSMesa.so.8", "libOSMesa.so"):
            with suppress(OSError):
                CDLL(name)
                return
        raise InputError(
            "pictures need a screen, or libEGL and a software renderer "
            "(Debian, Ubuntu: apt install libegl1 libgl1-mesa-dri)"
        )


def add_shape(
    plotter: Any,
    mesh: Mesh,
    V: np.ndarray,
    *,
    error: np.ndarray | None = None,
    top: float = 1.0,
    bar: str | None = None,
) -> None:
    """Add a surface, in one colour or coloured by `error` on a scale to `top`, with a bar titled `bar`."""
    import pyvista

    surface = pyvista.PolyData.from_regular_faces(V, mesh.F)
    if error is None:
        plotter.add_mesh(surface, color=BODY, smooth_shading=True)
        return
    plotter.add_mesh(
        surface,
        scalars=error,
        clim=(0, top),
        cmap=COLOURS,
        smooth_shading=True,
        show_scalar_bar=bar is not None,
        scalar_bar_args={
            "title": bar,
            "color": "black",
            "n_labels": 2,
            "fmt": "%.3g",
            "position_x": 0.2,
            "position_y": 0.01,
            "width": 0.6,
            "height": 0.07,
        },
        ambient=0.4,  # or shading darkens the colours away from those of the bar
        diffuse=0.6,
    )


def add_handles(plotter: Any, V: np.ndarray, handles: Handles, *, size: float, targets: bool = False) -> None:
    """Add handles as spheres at their vertices of `V`, and where they are to go.

    Parameters
    ----------
    plotter : pyvista.Plotter
    V : (n, 3) float64
    handles : Handles
    size : float
        The bounding-box diagonal that the spheres are measured by.
    targets : bool
        Show the targets of dynamic handles too, paler, with a line to each.
    """
    import pyvista

    ball = pyvista.Sphere(radius=SPHERE * size, theta_resolution=12, phi_resolution=12)

    def balls(points: np.ndarray, colour: str, **options: Any) -> None:
        if len(points):
            plotter.add_mesh(
                pyvista.PolyData(points).glyph(geom=ball, scale=False, orient=False),
                color=colour,
                ambient=0.5,
                diffuse=0.6,
                **options,
            )

    moving = handles.dynamic
    balls(V[handles.index[~moving]], STATIC)
    balls(V[handles.index[moving]], DYNAMIC)
    if targets and moving.any():
        balls(handles.target[moving], DYNAMIC, opacity=0.45)
        ends = np.stack([V[handles.index[moving]], handles.target[moving]], axis=1).reshape(-1, 3)
        plotter.add_mesh(pyvista.line_segments_from_points(ends), color=PATH, line_width=1)


def aim(plotter: Any, view: View) -> None:
    """Turn the camera of the plotter's active panel."""
    width, height = plotter.renderer.GetSize()
    plotter.enable_parallel_projection()
    plotter.camera.focal_point = view.centre
    plotter.camera.position = view.centre + 2 * (view.width + view.height + view.depth) * view.towards
    plotter.camera.up = view.up
    # Half the height of what is seen; a panel narrower than the view must show more of it.
    plotter.camera.parallel_scale = 0.5 * max(view.height, view.width * height / width)
    plotter.reset_camera_clipping_range()
    plotter.enable_anti_aliasing("ssaa")


def require_extra(*libraries: str) -> None:
    """Raise InputError where a library of the extra ``figures`` is missing: by default one that draws."""
    from importlib.util import find_spec

    for library in libraries or ("matplotlib", "pyvista"):
        if find_spec(library) is None:
            raise InputError(f"{library} is not installed; pip install 'sshade[figures]'")
