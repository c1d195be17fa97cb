"""Place the handles of a file on a mesh, and write handles as a file."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sshade.core.errors import InputError
from sshade.files.atomic import naming, replacing
from sshade.files.door import OpenShape, open_shape
from sshade.files.handle_files import FILE_RECORDS, HandleFile, HandleGroup, read_handle_file
from sshade.files.handwritten import packed, require_known
from sshade.files.implicit_arap import implicit_arap_frame
from sshade.files.meshes import read_file
from sshade.mesh.mesh import Mesh
from sshade.mesh.weld import NEAR
from sshade.problem.handle_checks import SAME_TARGET
from sshade.problem.handles import Handles
from sshade.problem.snapping import snap_to_vertices, vertices_in
from sshade.problem.task import DeformationTask

#: Rotation of handles without a prescribed one.
NO_ROTATION = np.full((3, 3), np.nan)


def read_handles(
    path: str | os.PathLike[str], mesh: Mesh, *, raw: bool = False, vertex: np.ndarray | None = None
) -> Handles:
    """Read handles for a mesh from a .json or an Implicit-ARAP .yaml file.

    Parameters
    ----------
    path : path
    mesh : Mesh
        The rest shape that the handles are snapped to.
    raw : bool
        Keep the targets of the file as they are; see :meth:`sshade.Handles.from_positions`.
    vertex : (k,) int, optional
        Needed if `mesh` is a repaired copy of the mesh that the vertex ids refer to: the vertex of `mesh`
        for each id, or -1; see :class:`sshade.mesh.surface.Surface`.

    Raises
    ------
    InputError
        When the file is missing, of another format, inconsistent, or does not fit the mesh.
    """
    file = read_handle_file(path, raw=raw)
    with naming(path):
        return on_mesh(file, mesh, vertex=vertex)


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
        See :func:`read_handles`.
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


def read_task(
    mesh: str,
    *,
    handles: str,
    raw: bool = False,
    carry_unconstrained: bool = False,
    weld: float = NEAR,
    repair: bool = False,
) -> DeformationTask:
    """Read a mesh file and a handle file as a task, which is named after both.

    The mesh of the task is the part of the file that can be deformed: see
    :func:`sshade.mesh.surface.surface`.

    Parameters
    ----------
    mesh, handles : path
    raw : bool
        Keep the targets of the file as they are; see :meth:`sshade.Handles.from_positions`.
    carry_unconstrained : bool
        See :class:`sshade.DeformationTask`.
    weld, repair
        See :func:`sshade.mesh.surface.surface`.

    Raises
    ------
    InputError
        See :func:`sshade.files.meshes.read_file`, :func:`sshade.files.door.open_shape`,
        :func:`read_handles` and :class:`sshade.DeformationTask`.
    """
    file = read_file(mesh)
    with naming(mesh):
        shape = open_shape(file, weld=weld, repair=repair)
    given = read_handle_file(handles, raw=raw)
    with naming(handles):
        own = on_shape(given, shape)
    name = f"{Path(mesh).stem}/{Path(handles).stem}"
    return shape.task(name, own, carry_unconstrained=carry_unconstrained, meta={"raw": raw})


def write_handles(
    path: str | os.PathLike[str],
    handles: Handles,
    *,
    names: Mapping[int, str] | None = None,
    about: Mapping[str, Any] | None = None,
    static_at_rest: bool = False,
) -> None:
    """Write handles as this project's JSON, by vertex ids.

    Vertices, targets, kinds, weights and rotations are read back bit by bit, in the order of the groups.
    Targets of static handles are read back with ``raw`` only; otherwise, static handles are read back at
    rest. A group of the file has one kind, one weight and one rotation: hard handles of a group that differ
    in them are read back as several groups. Groups are numbered anew, and snap distances are not in the file.

    Parameters
    ----------
    path : path
    handles : Handles
    names : mapping, optional
        Names of groups. Other groups are named by their number.
    about : mapping, optional
        Further keys of the file that readers of handles ignore. Keys of your own begin with ``_``.
    static_at_rest : bool
        The targets of static handles are their positions at rest, and are left out of the file.

    Raises
    ------
    InputError
        When the file cannot be written or is no .json file, on another key, and when handles of a soft group
        differ in what a group has once: several groups would pull more strongly.
    """
    if Path(path).suffix.lower() != ".json":
        raise InputError(f"{path}: handles are written as .json")
    require_known(about or (), FILE_RECORDS)
    entries = []
    rotation = np.zeros((len(handles), 9)) if handles.rotation is None else handles.rotation.reshape(-1, 9)
    rows = np.column_stack([handles.dynamic, handles.weight, np.nan_to_num(rotation)])
    order = np.argsort(handles.group, kind="stable")
    groups, first = np.unique(handles.group[order], return_index=True)
    for group, own in zip(groups.tolist(), np.split(order, first[1:]), strict=True):
        kinds = np.unique(rows[own], axis=0)
        if np.isfinite(kinds[:, 1]).sum() > 1:
            raise InputError(
                f"the soft handles of group {group} differ in their kinds, weights or rotations, which a "
                "group of a file has once; give them groups of their own"
            )
        for row in kinds:
            members, (dynamic, weight) = own[(rows[own] == row).all(axis=1)], row[:2]
            entry: dict[str, Any] = {
                "landmark": (names or {}).get(group, group),
                "kind": "dynamic" if dynamic else "static",
                "vertices": packed(handles.index[members]),
            }
            if dynamic or not static_at_rest:
                entry["target"] = packed(handles.target[members])
            if np.isfinite(weight):
                entry["weight"] = weight
            if row[2:].any():
                entry["rotation"] = row[2:].reshape(3, 3).tolist()
            entries.append(_lines({key: json.dumps(value) for key, value in entry.items()}, "  "))
    texts = {key: json.dumps(value) for key, value in (about or {}).items()}
    texts["handles"] = "[\n  " + ",\n  ".join(entries) + "\n ]"
    with replacing(path) as temporary:
        temporary.write_text(_lines(texts, "") + "\n", encoding="utf-8")


def _lines(texts: Mapping[str, str], indent: str) -> str:
    """Return the text of a JSON object with a line for each key."""
    lines = ",\n".join(f"{indent} {json.dumps(key)}: {text}" for key, text in texts.items())
    return f"{{\n{lines}\n{indent}}}"


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
