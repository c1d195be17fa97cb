"""Open shapes: vertices and faces of any kind become a surface with handles, and its positions go back.

A shape is arrays, a mesh of this package, of trimesh or of pyvista, or a mesh file that was read. The
command, Python, the editor and Blender open shapes here, make their tasks here, and place results here.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sshade.core.errors import InputError, counted
from sshade.core.whole_files import naming
from sshade.files.handle_files import HandleFile, HandleGroup
from sshade.files.mesh_file import MeshFile, unchanged
from sshade.files.objects import MeshObject, mesh_in
from sshade.mesh.mesh import Mesh
from sshade.mesh.surface import Surface, rounding_steps, surface
from sshade.problem.handle_checks import SAME_TARGET
from sshade.problem.handles import Handles, Snapping
from sshade.problem.registration import implicit_arap_frame
from sshade.problem.similarity import rotations_partway
from sshade.problem.snapping import snap_to_vertices, vertices_in
from sshade.problem.task import DeformationTask

#: Largest distance between the moves of two handles, as a multiple of the bounding-box diagonal.
FARTHEST_MOVE = 10.0
#: Rotation of handles without a prescribed one.
NO_ROTATION = np.full((3, 3), np.nan)


@dataclass(frozen=True, eq=False)
class OpenShape:
    """A shape and the surface in it that can be deformed.

    The surface lacks vertices in no face, and copies of a vertex along a seam are one vertex of it.

    Attributes
    ----------
    V : (n, 3) float64
        Positions at rest.
    F : (m, 3) int
        Triangles.
    surface : Surface
    made : callable
        ``made(V)`` returns an object of the shape's kind with positions V (n, 3): of arrays and of a file the
        positions themselves.
    space : str
        Coordinate system that the file of the shape declares, LPS or RAS; empty if it declares none.
    """

    V: np.ndarray
    F: np.ndarray
    surface: Surface
    made: Callable[[np.ndarray], Any]
    space: str = ""

    @property
    def mesh(self) -> Mesh:
        """The surface as a mesh."""
        return self.surface.mesh

    @property
    def extent(self) -> float:
        """The `extent` of :class:`sshade.Handles`: targets of copies of a vertex may differ as they do."""
        apart = 2 * np.sqrt(3) * self.surface.facts.tolerance  # of two copies, along all axes
        return self.mesh.diagonal * max(1.0, apart / SAME_TARGET)

    def on_surface(self, handles: Handles) -> Handles:
        """Convert handles at vertices of the shape to handles at vertices of the surface.

        Raises
        ------
        InputError
            When a handle is no vertex of a face, or copies of a vertex have contradictory targets.
        """
        return replace(handles, index=self.surface.places(handles.index), extent=self.extent)

    def task(self, name: str, handles: Handles, *, refuse_unconstrained: bool = False) -> DeformationTask:
        """Return the task for handles at vertices of the surface; see :class:`sshade.DeformationTask`."""
        return DeformationTask(name, self.mesh, handles, refuse_unconstrained=refuse_unconstrained)

    def placed(self, vertices: np.ndarray) -> np.ndarray:
        """Return all positions (n, 3) of the shape, given positions (k, 3) of the surface's vertices.

        Vertices in no face stay. The result is `vertices` itself where the surface has all vertices.
        """
        return self.surface.placed(self.V, vertices)

    def moved(self, vertices: np.ndarray) -> Any:
        """Return an object of the shape's kind, given positions (k, 3) of the surface's vertices."""
        # A copy, because a method may return the rest shape itself.
        return self.made(np.array(self.placed(vertices), dtype=np.float64))


def open_shape(
    shape: Any, F: np.ndarray | None = None, *, weld: float | None = None, repair: bool = False
) -> OpenShape:
    """Open a shape: find the surface in it that can be deformed.

    Parameters
    ----------
    shape : (n, 3) float, object or MeshFile
        Positions, with `F`; an object as :func:`sshade.files.objects.mesh_in` takes it, or as it returns it;
        or a file that :func:`sshade.files.meshes.read_file` has read.
    F : (m, 3) int, optional
        Triangles of positions.
    weld, repair
        See :func:`sshade.mesh.surface.surface`.

    Raises
    ------
    InputError
        On another object, or when there is no surface: see :func:`sshade.mesh.surface.surface`.
    """
    rounding: np.ndarray | None = None
    made: Callable[[np.ndarray], Any] = unchanged
    space = shape.space if isinstance(shape, MeshFile) else ""
    if F is not None:
        V, rounding = np.asarray(shape, dtype=np.float64), rounding_steps(shape)
    elif isinstance(shape, MeshFile):
        shape.require_triangles()
        V, F, rounding = shape.V, shape.F, shape.rounding
    else:
        found = shape if isinstance(shape, MeshObject) else mesh_in(shape)
        if found is None:
            raise InputError(f"there is no mesh in an object of type {type(shape).__name__}")
        V, F, made, rounding = found.V, found.F, found.moved, found.rounding
    return OpenShape(V, F, surface(V, F, weld=weld, rounding=rounding, repair=repair), made, space)


def in_order(given: tuple[Any, ...], **named: Any) -> tuple[Any, ...]:
    """Return positional arguments and then the named ones that are not None, in the order of their names.

    Raises
    ------
    TypeError
        Without arguments, or when a named argument would stand before a positional one.
    """
    names = [name for name, value in named.items() if value is not None]
    if not given and not names:
        raise TypeError("pass a mesh or vertices V and faces F, with handles b and targets bc")
    if given and "V" in names:
        raise TypeError("V stands before all other arguments; give them their names, too")
    return (*given, *(named[name] for name in names))


def open_arguments(
    shape: Any, arrays: tuple[Any, ...], names: tuple[str, ...], **options: Any
) -> tuple[OpenShape, tuple[Any, ...]]:
    """Open the shape in the arguments of a function: a mesh, or vertices with the faces as first array.

    Parameters
    ----------
    shape : object
    arrays : tuple
        The further arguments.
    names : tuple of str
        Names of the arguments that follow the shape.
    **options
        See :func:`open_shape`.

    Returns
    -------
    opened : OpenShape
    arrays : tuple
        The arguments that follow the shape.

    Raises
    ------
    TypeError
        On another number of arguments, or a path in place of the shape.
    InputError
        See :func:`open_shape`.
    """
    if isinstance(shape, (str, os.PathLike)):
        raise TypeError(f"{os.fspath(shape)!r} is a path; read the file: V, F = sshade.read(path)")
    mesh = mesh_in(shape)
    own = 1 if mesh is None else 0
    if len(arrays) != own + len(names):
        what, others = "a mesh" if mesh else "vertices", " and ".join(names)
        given = counted(len(arrays), "more argument was", "more arguments were")
        raise TypeError(
            f"{what} and {given} given; pass a mesh with {others}, or vertices V and faces F with these"
        )
    opened = open_shape(shape, arrays[0], **options) if mesh is None else open_shape(mesh, **options)
    return opened, arrays[own:]


def on_shape(file: HandleFile, shape: OpenShape) -> Handles:
    """Place the handles of a file on the surface of a shape; see :func:`on_mesh`."""
    own, mesh = file.in_space(shape.space), shape.mesh
    handles = on_mesh(own, mesh, vertex=shape.surface.vertex, extent=shape.extent)
    moves = handles.target - mesh.V[handles.index]
    if np.linalg.norm(np.ptp(moves, axis=0)) > FARTHEST_MOVE * mesh.diagonal:
        times = np.linalg.norm(moves, axis=1).max() / mesh.diagonal
        far = f"{times:.2g} times the diagonal of the mesh"
        raise InputError(f"handles move up to {far}; are the units right?")
    return handles


def on_mesh(file: HandleFile, mesh: Mesh, *, vertex: np.ndarray, extent: float) -> Handles:
    """Place the handles of a file on a mesh.

    Parameters
    ----------
    file : HandleFile
    mesh : Mesh
    vertex : (k,) int
        Vertex of the mesh for each vertex id of the file, or -1.
    extent : float
        See :class:`sshade.Handles`.

    Raises
    ------
    InputError
        When the handles do not fit the mesh.
    """
    # Handles at vertices, and positions, which are snapped at once with one search tree.
    rows: tuple[list[tuple[np.ndarray, ...]], ...] = ([], [])
    for own in file.groups:
        with naming(own.title):
            place, target, distance = _placed(own, mesh, vertex, file.amount)
        k, by_position = len(place), own.source is not None and own.motion is None
        values = np.full(k, own.moves), np.full(k, own.number), np.full(k, own.weight)
        rotation = np.broadcast_to(NO_ROTATION if own.rotation is None else own.rotation, (k, 3, 3))
        rows[by_position].append((place, target, distance, *values, rotation))
    parts = []
    if rows[0]:
        at, target, snap, dynamic, group, weight, R = _columns(rows[0])
        parts.append(Handles(at, target, dynamic, group, weight, R, extent=extent, snap=Snapping(snap)))
    if rows[1]:
        at, target, _, dynamic, group, weight, R = _columns(rows[1])
        if file.implicit_arap:
            to_mesh = implicit_arap_frame(at, mesh)
            at, target = to_mesh(at), to_mesh(target)
        parts.append(
            Handles.from_positions(
                mesh, at, target, dynamic=dynamic, group=group, weight=weight, rotation=R, raw=file.raw
            )
        )
    order = np.argsort(np.concatenate([part.group for part in parts]), kind="stable")

    def joined(arrays: Iterable[np.ndarray]) -> np.ndarray:
        return np.concatenate(list(arrays))[order]

    rotation = joined(part.rotation for part in parts if part.rotation is not None)
    handles = Handles(
        index=joined(part.index for part in parts),
        target=joined(part.target for part in parts),
        dynamic=joined(part.dynamic for part in parts),
        group=joined(part.group for part in parts),
        weight=joined(part.weight for part in parts),
        rotation=None if np.isnan(rotation).all() else rotation,
        extent=extent,
        snap=Snapping(
            joined(part.snapping.distance for part in parts),
            sum(part.snapping.merged for part in parts),
            max(part.snapping.merge_distance for part in parts),
        ),
    )
    return handles if file.amount == 1 else _partway(file, handles, mesh)


def _partway(file: HandleFile, handles: Handles, mesh: Mesh) -> Handles:
    """Move the targets of groups without a common motion, and turn prescribed rotations, partway."""
    rest, rotation = mesh.V[handles.index], None
    straight = np.isin(handles.group, [group.number for group in file.groups if group.motion is None])
    target = handles.target.copy()
    target[straight] = (rest + file.amount * (handles.target - rest))[straight]
    if handles.rotation is not None and file.amount > 0:
        rotation = handles.rotation.copy()
        rows = handles.has_rotation
        rotation[rows] = rotations_partway(rotation[rows], file.amount)
    return handles.at(target, rotation)


def _columns(rows: list[tuple[np.ndarray, ...]]) -> list[np.ndarray]:
    """Concatenate the first entries of all rows, the second entries, and so on."""
    return [np.concatenate(column) for column in zip(*rows, strict=True)]


def _placed(
    group: HandleGroup, mesh: Mesh, vertex: np.ndarray, amount: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the vertices of a group, their targets and their snap distances.

    Positions without a common motion are returned in place of vertices: they are snapped later, because the
    snap corrects their targets.
    """
    if group.source is not None and group.motion is None:
        target = group.source if group.target is None else group.target
        return group.source, target, np.zeros(len(target))
    if group.source is not None:
        distance, at = snap_to_vertices(mesh, group.source, np.full(len(group.source), group.number))
    else:
        at = _vertices(group, mesh, vertex)
        distance = np.zeros(len(at))
    if group.motion is None:
        return at, mesh.V[at] if group.target is None else group.target, distance
    return at, group.motion.partway(amount)(mesh.V[at]), distance


def _vertices(group: HandleGroup, mesh: Mesh, vertex: np.ndarray) -> np.ndarray:
    """Return the vertices of the mesh in the boxes of a group, or for its ids of the file."""
    if group.boxes is not None:
        return vertices_in(mesh.V, group.boxes)
    index = np.asarray(group.vertices)
    outside = index[(index < 0) | (index >= len(vertex))]
    if len(outside):
        raise InputError(f"vertex ids must lie in 0..{len(vertex) - 1}, not {outside[0]}")
    if (vertex[index] < 0).any():
        raise InputError(f"vertex {index[np.argmin(vertex[index])]} belongs to no face")
    return vertex[index]
