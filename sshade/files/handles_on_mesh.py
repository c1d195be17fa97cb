"""Place the handles of a file on a mesh."""

from __future__ import annotations

import numpy as np

from sshade.core.errors import InputError
from sshade.files.atomic import naming
from sshade.files.door import OpenShape
from sshade.files.handle_files import HandleFile, HandleGroup
from sshade.files.implicit_arap import implicit_arap_frame
from sshade.mesh.mesh import Mesh
from sshade.problem.handle_checks import SAME_TARGET
from sshade.problem.handles import Handles
from sshade.problem.snapping import snap_to_vertices, vertices_in

#: Rotation of handles without a prescribed one.
NO_ROTATION = np.full((3, 3), np.nan)


def on_shape(file: HandleFile, shape: OpenShape) -> Handles:
    """Place the handles of a file on the surface of a shape; see :func:`on_mesh`."""
    return on_mesh(file, shape.mesh, vertex=shape.surface.vertex, extent=shape.extent)


def on_mesh(
    file: HandleFile, mesh: Mesh, *, vertex: np.ndarray | None = None, extent: float | None = None
) -> Handles:
    """Place the handles of a file on a mesh.

    Parameters
    ----------
    file : HandleFile
    mesh, vertex
        See :func:`sshade.files.task_files.read_handles`.
    extent : float, optional
        See :class:`sshade.Handles`; by default the diagonal of the mesh.

    Raises
    ------
    InputError
        When the handles do not fit the mesh.
    """
    vertex = np.arange(mesh.n) if vertex is None else vertex
    extent = mesh.diagonal if extent is None else extent
    # Handles at vertices, and positions, which are snapped at once with one search tree.
    rows: tuple[list[tuple[np.ndarray, ...]], ...] = ([], [])
    for own in file.groups:
        with naming(own.title):
            place, target, distance = _placed(own, mesh, vertex)
        k, by_position = len(place), own.source is not None and own.motion is None
        values = np.full(k, own.moves), np.full(k, own.number), np.full(k, own.weight)
        rotation = np.broadcast_to(NO_ROTATION if own.rotation is None else own.rotation, (k, 3, 3))
        rows[by_position].append((place, target, distance, *values, rotation))
    parts = []
    if rows[0]:
        at, target, snap, dynamic, group, weight, R = _columns(rows[0])
        parts.append(Handles(at, target, dynamic, group, snap, weight, None, R, extent=extent))
    if rows[1]:
        at, target, _, dynamic, group, weight, R = _columns(rows[1])
        if file.implicit_arap:
            to_mesh = implicit_arap_frame(at, mesh)
            at, target = to_mesh(at), to_mesh(target)
        given = {"dynamic": dynamic, "group": group, "weight": weight, "rotation": R}
        parts.append(Handles.from_positions(mesh, at, target, **given, raw=file.raw))  # type: ignore[arg-type]
    order = np.argsort(np.concatenate([part.group for part in parts]), kind="stable")
    names = ("index", "target", "dynamic", "group", "snap_distance", "weight", "rotation")
    joined = {name: np.concatenate([getattr(part, name) for part in parts])[order] for name in names}
    if np.isnan(joined["rotation"]).all():
        del joined["rotation"]
    merged, farthest = sum(part.merged for part in parts), max(part.merge_distance for part in parts)
    return Handles(**joined, merged=merged, merge_distance=farthest, extent=extent)


def handle_notes(file: HandleFile, handles: Handles, mesh: Mesh) -> list[str]:
    """Return a sentence for each unusual fact about the handles of a file on a mesh."""
    found = []
    if handles.merge_distance > SAME_TARGET * mesh.diagonal:
        merged = "1 position was" if handles.merged == 1 else f"{handles.merged} positions were"
        found.append(
            f"{merged} merged with another position of the group at the same vertex; the vertex goes to the "
            "mean of their targets, at most "
            f"{100 * handles.merge_distance / mesh.diagonal:.2g} % of the diagonal from each target"
        )
    turned = []
    for group in file.groups:
        if group.motion is not None and group.motion.center is None and group.motion.turns:
            points = mesh.V[handles.index[handles.group == group.number]]
            if len(points) and not ((points.min(axis=0) <= 0) & (points.max(axis=0) >= 0)).all():
                turned.append(str(group.number))
    if turned:
        entries = "entry" if len(turned) == 1 else "entries"
        found.append(
            f"the rotation of {entries} {', '.join(turned)} is about the origin, which lies outside of the "
            'bounding box of its vertices; "center": "centroid" turns them about their mean'
        )
    return found


def _columns(rows: list[tuple[np.ndarray, ...]]) -> list[np.ndarray]:
    """Concatenate the first entries of all rows, the second entries, and so on."""
    return [np.concatenate(column) for column in zip(*rows, strict=True)]


def _placed(group: HandleGroup, mesh: Mesh, vertex: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
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
    _, first = np.unique(at, return_index=True)  # each vertex counts once in the centroid
    at = at[np.sort(first)]
    return at, group.motion(mesh.V[at]), distance[np.sort(first)]


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
