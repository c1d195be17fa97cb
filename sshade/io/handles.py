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
matrix of three rows, or a unit quaternion [x, y, z, w], as in glTF. Other keys are ignored.
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
from sshade.handles import NO_HANDLES, Handles, require_rotations
from sshade.io.files import check_suffix, naming, replacing
from sshade.io.implicit_arap import implicit_arap_frame, read_implicit_arap
from sshade.io.meshes import read_file
from sshade.io.points import as_array, as_points, columns
from sshade.io.regions import rigidly_moved, vertices_in
from sshade.mesh.mesh import Mesh
from sshade.mesh.surface import surface
from sshade.task import DeformationTask

#: Keys that give the handles of an entry.
WAYS = ("vertices", "source", "boxes")
#: Keys that give the motion of a region.
MOTION = {"rotation", "translation"}
#: Greatest accepted difference between the length of a quaternion and 1; files round to a few digits.
UNIT = 1e-3
#: Value for handles without a prescribed rotation.
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
        for each id, or -1; see :func:`sshade.io.meshes.repair`.

    Raises
    ------
    InputError
        When the file is missing, of another format, inconsistent, or does not fit the mesh.
    """
    path = Path(path)
    check_suffix(path, (".json", ".yaml", ".yml"))
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    with naming(path):
        if path.suffix.lower() == ".json":
            return parsed_handles(path.read_bytes(), mesh, raw=raw, vertex=vertex)
        source, target, dynamic, group = read_implicit_arap(path)
        to_mesh = implicit_arap_frame(source, mesh)
        source, target = to_mesh(source), to_mesh(target)
        return Handles.from_positions(mesh, source, target, dynamic=dynamic, group=group, raw=raw)


def parsed_handles(
    content: bytes, mesh: Mesh, *, raw: bool = False, vertex: np.ndarray | None = None
) -> Handles:
    """Read handles from this project's JSON. Parameters and errors are those of :func:`read_handles`."""
    try:
        data = json.loads(content)
    except (ValueError, RecursionError) as error:
        why = "nested too deeply" if isinstance(error, RecursionError) else error
        raise InputError(f"not readable as JSON ({why})") from error
    return _from_json(data, mesh, raw=raw, vertex=np.arange(mesh.n) if vertex is None else vertex)


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
        See :func:`sshade.io.meshes.read_file`, :func:`sshade.mesh.surface.surface`, :func:`read_handles` and
        :class:`sshade.DeformationTask`.
    """
    file = read_file(mesh)
    with naming(mesh):
        rest = surface(file.V, file.F)
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


def _from_json(data: Any, mesh: Mesh, *, raw: bool, vertex: np.ndarray) -> Handles:
    if not isinstance(data, dict) or not isinstance(data.get("handles"), list):
        raise InputError('expected an object with a list "handles"')
    # Rows of handles by id, and rows of positions, which are snapped at once with one search tree.
    rows: tuple[list[tuple[np.ndarray, ...]], ...] = ([], [])
    for number, entry in enumerate(data["handles"]):
        with naming(f"entry {number}"):
            kind = _kind(entry)
            if kind == "unused":
                continue
            place, target = _group(entry, mesh, moves=raw or kind == "dynamic", vertex=vertex)
            rotation = _rotation(entry) if "rotation" in entry and "boxes" not in entry else NO_ROTATION
            k = len(place)
            values = np.full(k, kind == "dynamic"), np.full(k, number), np.full(k, _weight(entry))
        row = place, target, *values, np.broadcast_to(rotation, (k, 3, 3))
        rows["source" in entry].append(row)
    parts, snapped = [], partial(Handles.from_positions, mesh, raw=raw)
    for create, some in (Handles, rows[0]), (snapped, rows[1]):
        if some:
            at, target, dynamic, group, weight, R = columns(some)
            parts.append(create(at, target, dynamic=dynamic, group=group, weight=weight, rotation=R))
    if not parts:
        raise InputError(NO_HANDLES)
    order = np.argsort(np.concatenate([part.group for part in parts]), kind="stable")
    names = ("index", "target", "dynamic", "group", "snap_distance", "weight", "rotation")
    joined = {name: np.concatenate([getattr(part, name) for part in parts])[order] for name in names}
    if np.isnan(joined["rotation"]).all():
        del joined["rotation"]
    return Handles(**joined, merged=sum(part.merged for part in parts))


def _group(
    entry: dict[str, Any], mesh: Mesh, *, moves: bool, vertex: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices of an entry, or the positions that are to be snapped, and their targets."""
    if "boxes" in entry:
        boxes = as_array(entry["boxes"], '"boxes"', (None, 2, 3), "a list of pairs of points")
        at = vertices_in(mesh.V, boxes)
        moves = moves and set(entry) >= MOTION
        if not moves:
            return at, mesh.V[at]
        translation = as_array(entry["translation"], '"translation"', (3,), "three numbers")
        return at, rigidly_moved(mesh.V[at], _rotation(entry), translation)
    by_id = "vertices" in entry
    at = _ids(entry["vertices"], vertex) if by_id else as_points(entry["source"], '"source"')
    target = mesh.V[at] if by_id else at
    if "target" in entry and (moves or not by_id):
        target = as_points(entry["target"], '"target"')
    if len(target) != len(at):
        raise InputError(f"{len(at)} handles have {len(target)} targets; each needs one")
    return at, target


def _rotation(entry: dict[str, Any]) -> np.ndarray:
    """Return the rotation (3, 3) of an entry, given as a matrix or a quaternion."""
    from scipy.spatial.transform import Rotation

    form = "three rows of three numbers, or a quaternion [x, y, z, w]"
    if isinstance(entry["rotation"], list) and len(entry["rotation"]) == 4:
        quaternion = as_array(entry["rotation"], '"rotation"', (4,), form)
        if abs(np.linalg.norm(quaternion) - 1) > UNIT:
            raise InputError('"rotation" is no rotation: a quaternion has length 1')
        return Rotation.from_quat(quaternion).as_matrix()
    R = as_array(entry["rotation"], '"rotation"', (3, 3), form)
    with naming('"rotation" is no rotation'):
        require_rotations(R[None])
    return R


def _weight(entry: dict[str, Any]) -> float:
    """Return the weight of an entry: inf for hard handles."""
    weight = entry.get("weight", np.inf)
    number = isinstance(weight, int | float) and not isinstance(weight, bool)
    if not number or not weight > 0:
        raise InputError('"weight" must be a number above 0; leave it out for hard handles')
    return float(weight)


def _kind(entry: Any) -> str:
    """Return "static", "dynamic" or "unused", and check that the entry has the keys of that kind."""
    if not isinstance(entry, dict):
        raise InputError("it is no JSON object")
    moves = "target" in entry or ("boxes" in entry and MOTION & set(entry))
    kind = entry.get("kind", "dynamic" if moves else "static")
    if kind not in ("static", "dynamic", "unused"):
        raise InputError(f"unknown kind {kind!r}; use static, dynamic or unused")
    if kind != "unused" and sum(key in entry for key in WAYS) != 1:
        raise InputError('give its handles either as "vertices", as "source" or as "boxes"')
    needed = MOTION if "boxes" in entry else {"target"}
    if kind == "dynamic" and not needed <= set(entry):
        raise InputError(f'it is dynamic and has no "{min(needed - set(entry))}"')
    return kind


def _ids(values: Any, vertex: np.ndarray) -> np.ndarray:
    """Return the vertices of the mesh for ids of the file."""
    try:
        index = np.asarray(values)
    except ValueError:  # lists of several lengths
        index = np.zeros(0)
    if index.ndim != 1 or not np.issubdtype(index.dtype, np.integer):
        raise InputError('"vertices" must be a list of integers, at least one')
    outside = index[(index < 0) | (index >= len(vertex))]
    if len(outside):
        raise InputError(f"vertex ids must lie in 0..{len(vertex) - 1}, not {outside[0]}")
    if (vertex[index] < 0).any():
        raise InputError(f"vertex {index[np.argmin(vertex[index])]} belongs to no face")
    return vertex[index]
