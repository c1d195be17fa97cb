"""``sshade.deform``: deform arrays, meshes of this package, of trimesh or of pyvista, and tasks."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar, Unpack, overload

import numpy as np

from sshade.core.console import compilation_told
from sshade.core.progress import Progress, silent
from sshade.files.open_shape import in_order, open_arguments
from sshade.method.bound import Bound
from sshade.problem.handle_checks import ids_of
from sshade.problem.options import OptionValues, accepted, require_method, resolve, takes_options
from sshade.problem.task import DeformationResult, DeformationTask, Handles, result_of

ShapeT = TypeVar("ShapeT")


@overload
def deform(
    task: DeformationTask,
    /,
    *,
    method: str | Callable[..., DeformationResult] = "fast",
    progress: Progress = silent,
    **options: Unpack[OptionValues],
) -> DeformationResult: ...
@overload
def deform(
    V: np.ndarray,
    F: np.ndarray,
    b: np.ndarray,
    bc: np.ndarray,
    *,
    method: str | Callable[..., DeformationResult] = "fast",
    weight: np.ndarray | float | None = None,
    rotations: np.ndarray | None = None,
    refuse_unconstrained: bool = False,
    weld: float | None = None,
    repair: bool = False,
    progress: Progress = silent,
    **options: Unpack[OptionValues],
) -> np.ndarray: ...
@overload
def deform(
    mesh: ShapeT,
    /,
    b: np.ndarray,
    bc: np.ndarray,
    *,
    method: str | Callable[..., DeformationResult] = "fast",
    weight: np.ndarray | float | None = None,
    rotations: np.ndarray | None = None,
    refuse_unconstrained: bool = False,
    weld: float | None = None,
    repair: bool = False,
    progress: Progress = silent,
    **options: Unpack[OptionValues],
) -> ShapeT: ...


@takes_options(lambda given: (*accepted(given.get("method", "fast")), "progress"), task=DeformationTask)
def deform(
    *shape: Any,
    V: Any = None,
    F: Any = None,
    b: Any = None,
    bc: Any = None,
    method: str | Callable[..., DeformationResult] = "fast",
    weight: np.ndarray | float | None = None,
    rotations: np.ndarray | None = None,
    refuse_unconstrained: bool = False,
    weld: float | None = None,
    repair: bool = False,
    **options: Any,
) -> Any:
    """Deform a surface so that some of its vertices, the handles, reach given positions.

    - ``deform(V, F, b, bc)`` returns positions (n, 3) float64,
    - ``deform(mesh, b, bc)`` returns another mesh of the same kind,
    - ``deform(task)`` returns a DeformationResult.

    The arrays V, F, b and bc may also be given by their names.

    The surface may have several components, a boundary, a single side, edges of more than
    two faces, duplicate faces, and faces without area. Arrays and meshes may also have duplicate vertices
    along a seam, which move as one. Arrays and a trimesh may have faces that repeat a vertex, and vertices in
    no face, which stay.

    Parameters
    ----------
    V : (n, 3) float64
        Rest positions, in any unit of length.
    F : (m, 3) int
        Triangles, counter-clockwise seen from outside.
    mesh : Mesh, trimesh.Trimesh, trimesh.Scene, or pyvista.PolyData, UnstructuredGrid or StructuredGrid
        A trimesh, or another object with ``vertices``, ``faces`` and ``copy``, is copied with its texture,
        colours and metadata. A scene, as ``trimesh.load`` makes it from a .glb, has one mesh; `bc` and the
        deformation are in the coordinates of the scene. A PolyData has triangles. Of a grid of PyVista the
        outer surface is deformed; points inside stay.
    task : DeformationTask
    b : (k,) int or (n,) bool
        Handle vertices: their ids, or a mask of all vertices.
    bc : (k, 3) float64
        Their targets.
    method : {"fast", "fine", "paper", "interpolate"} or callable
        "fast" solves one proxy. "fine" also polishes the result at full resolution: it creases less, leaves
        no dents of samples, and takes three times as long at 170,000 vertices, and eleven times at 1.8
        million. "paper" is the published method with an accelerated solver; ``accelerate=False`` takes the
        published iterations. "interpolate" is for dense handles: it solves for no elastic shape, and takes no
        options. Any other
        :class:`sshade.Method` is called with the task.
    weight : (k,) float64 or float, optional
        Weight of soft handles, which are pulled to their targets; inf, the default, is a hard handle. 1 is
        about as strong as the surface, at any size and resolution: see :class:`sshade.Handles`. All soft
        handles of a call are one group, whose pull they share by area: weak handles take a part of the pull
        of others. A task may have several groups.
    rotations : (k, 3, 3) or (3, 3) float64, optional
        Rotation of the surface at each handle, or one rotation for all; NaN where open. A vertex turns the
        surface that is nearer to it than to other vertices of the proxy.
    refuse_unconstrained : bool
        Refuse components without a handle, which by default move rigidly with the nearest component. A task
        has weights, rotations and this flag itself.
    weld : float, optional
        Largest distance of a copy of a vertex from its place, as a fraction of the bounding-box diagonal. The
        default is 1e-9, or two rounding steps of float32 arrays where they are larger. Copies along a seam
        move as one. 0 joins exact copies alone.
    repair : bool
        Weld all copies of a vertex, along seams or not.
    **options
        The options of the method, ``seed`` and ``workers`` among them: see
        :class:`sshade.problem.options.Options`; and ``progress``, a :class:`sshade.core.progress.Progress`.

    Returns
    -------
    (n, 3) float64, mesh or DeformationResult
        ``seconds`` of a result are summed over samplings, which overlap in time, as do ``bind`` and
        ``solve``. ``iterations`` is the mean over samplings, or the number in the polish. ``facts``:
        see :class:`sshade.problem.facts.Facts`.

    Raises
    ------
    TypeError
        On another number of arguments, or a path in place of a mesh.
    InputError
        On an invalid mesh, handles that are no vertices of the mesh or have contradictory targets, a
        component without a handle that is refused, an unknown method or option, or a value out of range.
    FloatingPointError
        When a deformed position is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> import sshade
    >>> V = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0.1], [0, 1, 0]], dtype=float)
    >>> F = np.array([[0, 1, 2], [0, 2, 3]])
    >>> U = sshade.deform(V, F, [0, 2], V[[0, 2]] + [0, 0, 1])
    >>> bool(np.allclose(U, V + [0, 0, 1], atol=1e-4))
    True
    """
    run = method if callable(method) else partial(_by_method, require_method(method))
    first, *arrays = in_order(shape, V=V, F=F, b=b, bc=bc)
    if isinstance(first, DeformationTask):
        has = weight is not None or rotations is not None or refuse_unconstrained
        if arrays or has or repair or weld is not None:
            raise TypeError(
                "a task has handles, weights, rotations and refuse_unconstrained itself, and its mesh is not "
                "welded"
            )
        with compilation_told():
            return result_of(first, run(first, **options))
    with compilation_told():
        opened, (b, bc) = open_arguments(
            first, tuple(arrays), ("handles b", "targets bc"), weld=weld, repair=repair
        )
        b = ids_of(b, len(opened.V))
        if rotations is not None and np.ndim(rotations) == 2:
            rotations = np.broadcast_to(rotations, (len(b), *np.shape(rotations)))
        handles = Handles(b, bc, weight=weight, rotation=rotations, extent=opened.extent)  # type: ignore[arg-type]
        task = opened.task("mesh", opened.on_surface(handles), refuse_unconstrained=refuse_unconstrained)
        return opened.moved(result_of(task, run(task, **options)).vertices)


def _by_method(
    method: str, task: DeformationTask, *, progress: Progress = silent, **options: Any
) -> DeformationResult:
    """Bind a task and solve it once."""
    bound = Bound.of_task(task, resolve(method, options))
    return bound.solve(task.handles, guess=task.guess, progress=progress)
