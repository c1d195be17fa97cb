"""Read and write handle files: this project's JSON; the YAML of Implicit-ARAP is read only.

JSON::

    {"handles": [
        {"landmark": "left foot", "kind": "static", "vertices": [12, 13, 14]},
        {"landmark": "right hand", "kind": "dynamic",
         "source": [[x, y, z], ...], "target": [[x, y, z], ...]},
        {"landmark": "head", "kind": "dynamic", "boxes": [[[x, y, z], [x, y, z]], ...],
         "rotation": [[...], [...], [...]], "translation": [x, y, z]},
        {"landmark": "tail", "vertices": [99], "target": [[x, y, z]], "weight": 5, "rotation": [x, y, z, w]}
    ]}

Each entry is a group of handles, given in one of three ways:

- ``vertices``: ids of vertices of the mesh.
- ``source``: positions, which are snapped to the nearest vertices.
- ``boxes``: a region of all vertices v in some axis-aligned boxes, each with its lowest and highest
  corner. The vertices move to R v + t, with ``rotation`` R and ``translation`` t.

``kind`` is ``static`` (the handles stay at rest and need no target), ``dynamic`` or ``unused`` (the entry
is skipped). A group with a ``weight`` is soft: it is pulled to its targets (:class:`sshade.Handles`).
Without ``boxes``, ``rotation`` prescribes the rotation of the surface at the handles. A rotation is a
matrix of three rows, or a unit quaternion [x, y, z, w], as in glTF. Misspelt keys are
refused, and further keys are ignored.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sshade.errors import InputError
from sshade.handles import Handles
from sshade.io.entries import NO_ROTATION, Entry, HandleFile, read_handle_file
from sshade.io.files import naming, replacing
from sshade.io.implicit_arap import implicit_arap_frame
from sshade.io.meshes import read_surface
from sshade.io.points import columns
from sshade.io.regions import rigidly_moved, vertices_in
from sshade.mesh.mesh import Mesh
from sshade.task import DeformationTask


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


def on_mesh(file: HandleFile, mesh: Mesh, *, vertex: np.ndarray | None = None) -> Handles:
    """Place the handles of a file on a mesh.

    Parameters
    ----------
    file : HandleFile
    mesh, vertex
        See :func:`read_handles`.

    Raises
    ------
    InputError
        When the handles do not fit the mesh.
    """
    vertex = np.arange(mesh.n) if vertex is None else vertex
    # Rows of handles by id, and rows of positions, which are snapped at once with one search tree.
    rows: tuple[list[tuple[np.ndarray, ...]], ...] = ([], [])
    for entry in file.entries:
        with naming(f"entry {entry.number}"):
            place, target = _places_and_targets(entry, mesh, vertex)
        k = len(place)
        values = np.full(k, entry.dynamic), np.full(k, entry.number), np.full(k, entry.weight)
        rotation = NO_ROTATION if entry.way == "boxes" else entry.rotation
        row = place, target, *values, np.broadcast_to(rotation, (k, 3, 3))
        rows[entry.way == "source"].append(row)
    parts, snapped = [], partial(Handles.from_positions, mesh, raw=file.raw)
    for create, some in (Handles, rows[0]), (snapped, rows[1]):
        if some:
            at, target, dynamic, group, weight, R = columns(some)
            if file.implicit_arap:
                to_mesh = implicit_arap_frame(at, mesh)
                at, target = to_mesh(at), to_mesh(target)
            parts.append(create(at, target, dynamic=dynamic, group=group, weight=weight, rotation=R))
    order = np.argsort(np.concatenate([part.group for part in parts]), kind="stable")
    names = ("index", "target", "dynamic", "group", "snap_distance", "weight", "rotation")
    joined = {name: np.concatenate([getattr(part, name) for part in parts])[order] for name in names}
    if np.isnan(joined["rotation"]).all():
        del joined["rotation"]
    return Handles(**joined, merged=sum(part.merged for part in parts))


def read_task(
    mesh: str, *, handles: str, raw: bool = False, carry_unconstrained: bool = False
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

    Raises
    ------
    InputError
        See :func:`sshade.io.meshes.read_surface`, :func:`read_handles` and
        :class:`sshade.DeformationTask`.
    """
    _, rest = read_surface(mesh)
    name = f"{Path(mesh).stem}/{Path(handles).stem}"
    own = read_handles(handles, rest.mesh, raw=raw, vertex=rest.vertex)
    meta, carry = {"raw": raw}, carry_unconstrained
    return DeformationTask(name, rest.mesh, own, meta=meta, carry_unconstrained=carry)


def write_handles(
    path: str | os.PathLike[str],
    handles: Handles,
    *,
    names: Mapping[int, str] | None = None,
    about: Mapping[str, Any] | None = None,
) -> None:
    """Write handles as this project's JSON, by vertex ids.

    Parameters
    ----------
    path : path
    handles : Handles
    names : mapping, optional
        Names of groups. Other groups are named by their number.
    about : mapping, optional
        Further keys of the file, which readers ignore.

    Raises
    ------
    InputError
        When the file cannot be written.
    """
    entries = []
    rotation = np.zeros((len(handles), 9)) if handles.rotation is None else handles.rotation.reshape(-1, 9)
    rows = np.column_stack([handles.group, handles.dynamic, handles.weight, np.nan_to_num(rotation)])
    for row in np.unique(rows, axis=0):
        members, group = (rows == row).all(axis=1), int(row[0])
        entry: dict[str, Any] = {
            "landmark": (names or {}).get(group, group),
            "kind": "dynamic" if row[1] else "static",
            "vertices": handles.index[members].tolist(),
            "target": handles.target[members].tolist(),
        }
        if np.isfinite(row[2]):
            entry["weight"] = row[2]
        if row[3:].any():
            entry["rotation"] = row[3:].reshape(3, 3).tolist()
        entries.append(entry)
    with replacing(path) as temporary:
        content = json.dumps({**(about or {}), "handles": entries}, indent=1)
        temporary.write_text(content + "\n", encoding="utf-8")


def _places_and_targets(entry: Entry, mesh: Mesh, vertex: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices of an entry, or the positions that are to be snapped, and their targets."""
    if entry.way == "source":
        return entry.place, entry.place if entry.target is None else entry.target
    if entry.way == "vertices":
        at = _vertices(entry.place, vertex)
        return at, mesh.V[at] if entry.target is None else entry.target
    at = vertices_in(mesh.V, entry.place)
    if entry.translation is None:
        return at, mesh.V[at]
    return at, rigidly_moved(mesh.V[at], entry.rotation, entry.translation)


def _vertices(index: np.ndarray, vertex: np.ndarray) -> np.ndarray:
    """Return the vertices of the mesh for ids of the file."""
    outside = index[(index < 0) | (index >= len(vertex))]
    if len(outside):
        raise InputError(f"vertex ids must lie in 0..{len(vertex) - 1}, not {outside[0]}")
    if (vertex[index] < 0).any():
        raise InputError(f"vertex {index[np.argmin(vertex[index])]} belongs to no face")
    return vertex[index]
