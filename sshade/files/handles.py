"""Read and write handle files: this project's JSON; the YAML of Implicit-ARAP is read only.

JSON::

    {"handles": [
        {"landmark": "left foot", "kind": "static", "vertices": [12, 13, 14]},
        {"landmark": "right hand", "source": [[x, y, z], ...], "target": [[x, y, z], ...]},
        {"landmark": "head", "boxes": [[[x, y, z], [x, y, z]], ...],
         "rotation": [[...], [...], [...]], "translation": [x, y, z], "center": "centroid"},
        {"landmark": "tail", "vertices": [99], "target": [[x, y, z]], "weight": 5, "rotation": [x, y, z, w]}
    ]}

Each entry is a group of handles, given in one of three ways:

- ``vertices``: ids of vertices of the mesh.
- ``source``: positions, which are snapped to the nearest vertices.
- ``boxes``: all vertices in some axis-aligned boxes, each with its lowest and its highest corner.

``kind`` is ``static`` (the handles stay at rest and need no target), ``dynamic`` or ``unused`` (the entry
is skipped). Without a ``kind``, an entry with a motion is dynamic. A motion is given in one of two ways:

- ``target``: the position of each handle.
- ``translation`` t and ``rotation`` R, or one of the two: a vertex v moves to R (v - c) + c + t. The
  ``center`` c is a point or ``"centroid"``, the mean of the vertices; by default it is the origin.

A ``rotation`` beside ``vertices`` or ``source`` that have a ``target``, or neither a motion nor the kind
``dynamic``, prescribes the rotation of the surface at the handles. A rotation is a matrix of three rows, or
a unit quaternion [x, y, z, w], as in glTF. A group with a ``weight`` is soft: it is pulled to its targets
(:class:`sshade.Handles`). Long lists of numbers may have a compact form: see :mod:`sshade.files.points`.

Unknown keys are refused. Keys that begin with ``_`` are ignored, as are keys that this project records.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sshade.core.errors import InputError
from sshade.files.atomic import naming, replacing
from sshade.files.entries import FILE_RECORDS, Entry, HandleFile, entry_name, read_handle_file
from sshade.files.implicit_arap import implicit_arap_frame
from sshade.files.keys import require_known
from sshade.files.meshes import read_surface
from sshade.files.points import columns, packed
from sshade.files.regions import vertices_in
from sshade.mesh.mesh import Mesh
from sshade.mesh.surface import Surface
from sshade.mesh.weld import NEAR
from sshade.problem.handle_checks import SAME_TARGET, extent_of
from sshade.problem.handles import Handles
from sshade.problem.snapping import snap_to_vertices
from sshade.problem.task import DeformationTask


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


def on_surface(file: HandleFile, whole: Surface) -> Handles:
    """Place the handles of a file on a surface; see :func:`on_mesh`."""
    return on_mesh(file, whole.mesh, vertex=whole.vertex, extent=extent_of(whole))


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
    for entry in file.entries:
        by_position = entry.way == "source" and entry.motion is None
        with naming(entry_name(entry.number, entry.name)):
            place, target, distance = _placed(entry, mesh, vertex)
        k = len(place)
        values = np.full(k, entry.dynamic), np.full(k, entry.number), np.full(k, entry.weight)
        rotation = np.broadcast_to(entry.rotation, (k, 3, 3))
        rows[by_position].append((place, target, distance, *values, rotation))
    parts = []
    if rows[0]:
        at, target, snap, dynamic, group, weight, R = columns(rows[0])
        parts.append(Handles(at, target, dynamic, group, snap, weight, None, R, extent=extent))
    if rows[1]:
        at, target, _, dynamic, group, weight, R = columns(rows[1])
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
    for entry in file.entries:
        if entry.motion is not None and entry.motion.center is None and entry.motion.turns:
            points = mesh.V[handles.index[handles.group == entry.number]]
            if len(points) and not ((points.min(axis=0) <= 0) & (points.max(axis=0) >= 0)).all():
                turned.append(str(entry.number))
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
        See :func:`sshade.files.meshes.read_surface`, :func:`read_handles` and
        :class:`sshade.DeformationTask`.
    """
    file, rest = read_surface(mesh, weld=weld, repair=repair)
    name = f"{Path(mesh).stem}/{Path(handles).stem}"
    given = read_handle_file(handles, raw=raw)
    with naming(handles):
        own = on_surface(given, rest)
    meta, carry = {"raw": raw}, carry_unconstrained
    return DeformationTask(name, rest.mesh, own, meta=meta, carry_unconstrained=carry)


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


def _placed(entry: Entry, mesh: Mesh, vertex: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the vertices of an entry, their targets and their snap distances.

    If the positions of an entry have targets, which are corrected by the snap, they are returned in place
    of vertices.
    """
    target, distance = entry.target, np.zeros(len(entry.place))
    if entry.way == "source" and entry.motion is None:
        return entry.place, entry.place if target is None else target, distance
    if entry.way == "source":
        distance, at = snap_to_vertices(mesh, entry.place, np.full(len(entry.place), entry.number))
    elif entry.way == "vertices":
        at = _vertices(entry.place, vertex)
    else:
        at = vertices_in(mesh.V, entry.place)
        distance = np.zeros(len(at))
    if entry.motion is None:
        return at, mesh.V[at] if target is None else target, distance
    _, first = np.unique(at, return_index=True)  # each vertex counts once in the centroid
    at = at[np.sort(first)]
    return at, entry.motion(mesh.V[at]), distance[np.sort(first)]


def _vertices(index: np.ndarray, vertex: np.ndarray) -> np.ndarray:
    """Return the vertices of the mesh for ids of the file."""
    outside = index[(index < 0) | (index >= len(vertex))]
    if len(outside):
        raise InputError(f"vertex ids must lie in 0..{len(vertex) - 1}, not {outside[0]}")
    if (vertex[index] < 0).any():
        raise InputError(f"vertex {index[np.argmin(vertex[index])]} belongs to no face")
    return vertex[index]
