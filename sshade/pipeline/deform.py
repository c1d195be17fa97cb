"""One call for all that is deformed: arrays, a mesh of this package or of trimesh, or a task."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeVar, overload

import numpy as np

from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.mesh.surface import surface
from sshade.pipeline.fast import sshade_fast
from sshade.pipeline.fine import sshade_fine
from sshade.pipeline.paper import sshade
from sshade.task import DeformationResult, DeformationTask, Handles

ShapeT = TypeVar("ShapeT")

#: What the names of `method` stand for.
METHODS: Mapping[str, Callable[..., DeformationResult]] = {
    "fast": sshade_fast,
    "fine": sshade_fine,
    "paper": sshade,
}


@overload
def deform(task: DeformationTask, /, **options: Any) -> DeformationResult: ...
@overload
def deform(V: np.ndarray, F: np.ndarray, b: np.ndarray, bc: np.ndarray, /, **options: Any) -> np.ndarray: ...
@overload
def deform(mesh: ShapeT, b: np.ndarray, bc: np.ndarray, /, **options: Any) -> ShapeT: ...


def deform(
    shape: Any,
    /,
    *given: Any,
    method: str | Callable[..., DeformationResult] = "fast",
    weight: np.ndarray | float | None = None,
    rotations: np.ndarray | None = None,
    carry_unconstrained: bool = False,
    **options: Any,
) -> Any:
    """Deform a surface so that some of its vertices, the handles, reach given positions.

    - ``deform(V, F, b, bc)`` gives positions (n, 3) float64,
    - ``deform(mesh, b, bc)`` another of the mesh's kind,
    - ``deform(task)`` a DeformationResult.

    The surface may have several components, each with a handle, a boundary, edges of more than two
    faces, faces twice, and faces without area. Unless it is a task's, it may also have vertices that
    stand twice along a seam, which move as one, and, as arrays or a trimesh, faces that repeat a vertex,
    and vertices in no face, which stay where they are.

    Parameters
    ----------
    V : (n, 3) float64
        Rest positions, in any unit of length.
    F : (m, 3) int
        Triangles, counter-clockwise seen from outside.
    mesh : Mesh or trimesh.Trimesh
        A trimesh, or what has ``vertices``, ``faces`` and ``copy`` as that does, comes back as a copy with
        other vertices: with its texture, colours and metadata.
    task : DeformationTask
    b : (k,) int
        Handle vertices.
    bc : (k, 3) float64
        Their targets.
    method : {"fast", "fine", "paper"} or callable
        :func:`sshade.sshade_fast`; :func:`sshade.sshade_fine`, which polishes its result, takes ten
        times as long, and changes edges and angles less; :func:`sshade.sshade`, as published; or
        another :class:`sshade.Method`, which is given the task as it is.
    weight : (k,) float64 or float, optional
        Of soft handles, which are pulled to their targets with it, all of one weight together; inf, the
        default, holds them there. 1 is about as strong as the surface, at any size and resolution:
        see :class:`sshade.Handles`. `fast`, `fine` and `paper` take soft handles.
    rotations : (k, 3, 3) or (3, 3) float64, optional
        How the surface turns at the handles, or at all of them; NaN where that is open. A vertex turns as
        much of the surface as is nearer to it than to other vertices of the proxy. Of the same methods.
    carry_unconstrained : bool
        Components without a handle move rigidly with the nearest one, instead of being refused.
        Of a task, which says these things itself, leave them out.
    **options
        Of the method: ``vertices`` of the proxy, ``seed``, ``progress``, ``workers``, and so on.

    Raises
    ------
    TypeError
        On another number of arguments, or an option that the method does not have.
    InputError
        On arrays that are no mesh, handles that are none of its vertices or have contradictory targets,
        a component without a handle, an unknown method, or what the method refuses.
    FloatingPointError
        When the method ends in positions that are not finite.

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
    run = _method(method)
    if isinstance(shape, DeformationTask):
        _expect(given, "a task", 0)
        if weight is not None or rotations is not None or carry_unconstrained:
            raise TypeError("a task says itself how its handles are held and what is carried")
        return run(shape, **options)
    if isinstance(shape, Mesh):
        b, bc = _expect(given, "a mesh", 2)
        V, F = shape.V, shape.F
    elif all(hasattr(shape, name) for name in ("vertices", "faces", "copy")):
        b, bc = _expect(given, "a mesh", 2)
        V, F = np.asarray(shape.vertices, dtype=np.float64), np.asarray(shape.faces)
    else:
        F, b, bc = _expect(given, "vertices", 3)
        V = np.asarray(shape, dtype=np.float64)
    whole = surface(V, F)
    if rotations is not None and np.ndim(rotations) == 2:
        rotations = np.broadcast_to(rotations, (len(b), *np.shape(rotations)))
    given_handles = Handles(b, bc, weight=weight, rotation=rotations)  # type: ignore[arg-type]
    handles = _on(whole.vertex, given_handles)
    task = DeformationTask("mesh", whole.mesh, handles, carry_unconstrained=carry_unconstrained)
    moved = whole.placed(V, run(task, **options).vertices)
    if isinstance(shape, Mesh):
        return Mesh(moved, F)
    if not hasattr(shape, "vertices"):
        return moved
    copy = shape.copy()
    copy.vertices = moved
    return copy


def _method(method: str | Callable[..., DeformationResult]) -> Callable[..., DeformationResult]:
    if callable(method):
        return method
    if method not in METHODS:
        raise InputError(f"unknown method {method!r}; use {', '.join(map(repr, METHODS))} or a function")
    return METHODS[method]


def _expect(given: tuple[Any, ...], what: str, count: int) -> tuple[Any, ...]:
    if len(given) != count:
        raise TypeError(
            f"{what} and {len(given)} arguments were given: deform takes a task, a mesh with handles b and "
            "targets bc, or vertices V and faces F with b and bc"
        )
    return given


def _on(vertex: np.ndarray, handles: Handles) -> Handles:
    """Handles of given vertices, as those of a surface: `vertex` (n,) of each, or -1."""
    outside = handles.index[handles.index >= len(vertex)]
    if len(outside):
        raise InputError(f"handle id {outside[0]} is out of range: the mesh has {len(vertex)} vertices")
    index = vertex[handles.index]
    if (index < 0).any():
        raise InputError(f"handle vertex {handles.index[np.argmin(index)]} belongs to no face")
    return replace(handles, index=index)
