"""Handle files: this project's JSON, and the YAML of the Implicit-ARAP experiments.

JSON::

    {"handles": [
        {"landmark": "left foot", "kind": "static", "vertices": [12, 13, 14]},
        {"landmark": "right hand", "kind": "dynamic",
         "source": [[x, y, z], ...], "target": [[x, y, z], ...]},
        {"landmark": "head", "kind": "dynamic", "boxes": [[[x, y, z], [x, y, z]], ...],
         "rotation": [[...], [...], [...]], "translation": [x, y, z]},
        {"landmark": "tail", "vertices": [99], "target": [[x, y, z]], "weight": 5, "rotation": [x, y, z, w]}
    ]}

Each entry is a group. Handles are given by position (``source``), snapped to
the nearest vertices; by ``vertices`` (ids), taken exactly; or as a region: all
vertices in some ``boxes`` along the axes, each by its lowest and its highest
corner, which go to R v + t. ``static`` handles stay where they are and need no
target; ``unused`` groups are skipped. A group with a ``weight`` is soft: it is pulled to its targets
(:class:`sshade.Handles`). A ``rotation`` of handles that are given otherwise than by boxes says how
the surface turns at them. It is a matrix, of three rows, or a unit quaternion [x, y, z, w], in the
order of glTF. Other keys are left alone.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sshade.errors import InputError
from sshade.handles import NO_HANDLES, Handles, require_rotations
from sshade.io.files import check_suffix, replacing
from sshade.io.implicit_arap import implicit_arap_frame, read_implicit_arap
from sshade.io.meshes import read_file
from sshade.io.points import as_array, as_points, columns
from sshade.io.regions import rigidly_moved, vertices_in
from sshade.mesh.mesh import Mesh
from sshade.mesh.surface import surface
from sshade.task import DeformationTask

#: Ways to give the handles of an entry.
WAYS = ("vertices", "source", "boxes")
#: What a region that moves needs.
MOTION = {"rotation", "translation"}
#: How far the length of a quaternion read from a file may be from 1.
UNIT = 1e-3
#: A rotation that is open.
OPEN = np.full((3, 3), np.nan)


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
        Keep the file's targets as they are; see :meth:`sshade.Handles.from_positions`.
    vertex : (k,) int, optional
        Where `mesh` is a repaired copy: the vertex of `mesh`, or -1, for each
        vertex that the file's ids count; see :func:`sshade.io.meshes.repair`.

    Raises
    ------
    InputError
        When the file is missing, of another format, inconsistent, or does not fit the mesh.
    """
    path = Path(path)
    check_suffix(path, (".json", ".yaml", ".yml"))
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        if path.suffix.lower() == ".json":
            vertex = np.arange(mesh.n) if vertex is None else vertex
            return _from_json(json.loads(path.read_text(encoding="utf-8")), mesh, raw=raw, vertex=vertex)
        source, target, dynamic, group = read_implicit_arap(path)
        place = implicit_arap_frame(source, mesh)
        return Handles.from_positions(
            mesh, place(source), place(target), dynamic=dynamic, group=group, raw=raw
        )
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError) as error:
        why = "nested too deeply" if isinstance(error, RecursionError) else error
        raise InputError(f"{path}: not readable as {path.suffix[1:].upper()} ({why})") from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def read_task(
    mesh: str, *, handles: str, raw: bool = False, carry_unconstrained: bool = False
) -> DeformationTask:
    """A mesh and a handle file as a task, named by both.

    Its mesh is what of the file can be deformed: see :func:`sshade.mesh.surface.surface`.

    Parameters
    ----------
    mesh, handles : path
    raw : bool
        Keep the file's targets as they are; see :meth:`sshade.Handles.from_positions`.
    carry_unconstrained : bool
        See :class:`sshade.DeformationTask`.

    Raises
    ------
    InputError
        See :func:`sshade.io.meshes.read_file`, :func:`sshade.mesh.surface.surface`, :func:`read_handles` and
        :class:`sshade.DeformationTask`.
    """
    file = read_file(mesh)
    try:
        rest = surface(file.V, file.F)
    except InputError as error:
        raise InputError(f"{mesh}: {error}") from error
    own = read_handles(handles, rest.mesh, raw=raw, vertex=rest.vertex)
    name = f"{Path(mesh).stem}/{Path(handles).stem}"
    return DeformationTask(name, rest.mesh, own, meta={"raw": raw}, carry_unconstrained=carry_unconstrained)


def write_handles(
    path: str | os.PathLike[str],
    handles: Handles,
    *,
    names: Mapping[int, str] | None = None,
    about: Mapping[str, Any] | None = None,
) -> None:
    """Write handles by vertex id as this project's JSON.

    Parameters
    ----------
    path : path
    handles : Handles
    names : mapping, optional
        What groups are called; the others are called by their number.
    about : mapping, optional
        Further facts, which readers leave alone.

    Raises
    ------
    InputError
        When the file cannot be written.
    """
    groups = []
    turn = np.zeros((len(handles), 9)) if handles.rotation is None else handles.rotation.reshape(-1, 9)
    facts = np.column_stack([handles.group, handles.dynamic, handles.weight, np.nan_to_num(turn)])
    for row in np.unique(facts, axis=0):
        own = (facts == row).all(axis=1)
        landmark = (names or {}).get(int(row[0]), int(row[0]))
        entry: dict[str, Any] = {"landmark": landmark, "kind": "dynamic" if row[1] else "static"}
        entry |= {"vertices": handles.index[own].tolist(), "target": handles.target[own].tolist()}
        entry |= {"weight": row[2]} if np.isfinite(row[2]) else {}
        groups.append(entry | ({"rotation": row[3:].reshape(3, 3).tolist()} if row[3:].any() else {}))
    with replacing(path) as temporary:
        temporary.write_text(
            json.dumps({**(about or {}), "handles": groups}, indent=1) + "\n", encoding="utf-8"
        )


def _from_json(data: Any, mesh: Mesh, *, raw: bool, vertex: np.ndarray) -> Handles:
    if not isinstance(data, dict) or not isinstance(data.get("handles"), list):
        raise InputError('expected an object with a list "handles"')
    exact: list[tuple[np.ndarray, ...]] = []
    snapped: list[tuple[np.ndarray, ...]] = []
    for number, entry in enumerate(data["handles"]):
        try:
            kind = _kind(entry)
            if kind == "unused":
                continue
            at, target = _group(entry, mesh, moves=raw or kind == "dynamic", vertex=vertex)
            weights = np.full(len(at), _weight(entry))
            turn = _rotation(entry) if "rotation" in entry and "boxes" not in entry else OPEN
            turns = np.broadcast_to(turn, (len(at), 3, 3))
        except InputError as error:
            raise InputError(f"entry {number}: {error}") from error
        own = at, target, np.full(len(at), kind == "dynamic"), np.full(len(at), number), weights, turns
        (snapped if "source" in entry else exact).append(own)
    parts = []
    if exact:
        index, target, dynamic, group, weight, turns = columns(exact)
        parts.append(Handles(index, target, dynamic, group, weight=weight, rotation=turns))
    if snapped:  # one search tree serves them all
        source, target, dynamic, group, weight, turns = columns(snapped)
        more = {"dynamic": dynamic, "group": group, "weight": weight, "rotation": turns}
        parts.append(Handles.from_positions(mesh, source, target, raw=raw, **more))
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
    """Vertices of an entry, or the positions to be snapped, and their targets."""
    if "boxes" in entry:
        boxes = as_array(entry["boxes"], '"boxes"', (None, 2, 3), "a list of pairs of points")
        at = vertices_in(mesh.V, boxes)
        moves = moves and set(entry) >= MOTION
        return at, rigidly_moved(mesh.V[at], *_motion(entry)) if moves else mesh.V[at]
    by_id = "vertices" in entry
    at = _ids(entry["vertices"], vertex) if by_id else as_points(entry["source"], '"source"')
    target = mesh.V[at] if by_id else at
    if "target" in entry and (moves or not by_id):
        target = as_points(entry["target"], '"target"')
    if len(target) != len(at):
        raise InputError(f"{len(at)} handles have {len(target)} targets; each needs one")
    return at, target


def _motion(entry: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and translation of a region."""
    return _rotation(entry), as_array(entry["translation"], '"translation"', (3,), "three numbers")


def _rotation(entry: dict[str, Any]) -> np.ndarray:
    """(3, 3) rotation of an entry that has one, as a matrix or a quaternion."""
    from scipy.spatial.transform import Rotation

    form = "three rows of three numbers, or a quaternion [x, y, z, w]"
    given, R = entry["rotation"], np.zeros((3, 3))
    if isinstance(given, list) and len(given) == 4:
        quaternion = as_array(given, '"rotation"', (4,), form)
        if abs(np.linalg.norm(quaternion) - 1) <= UNIT:  # files round to a few digits
            R = Rotation.from_quat(quaternion).as_matrix()
    else:
        R = as_array(given, '"rotation"', (3, 3), form)
    try:
        require_rotations(R[None])
    except InputError as error:
        raise InputError(
            '"rotation" is no rotation: its rows must be orthonormal and right-handed, or its quaternion of '
            "length 1"
        ) from error
    return R


def _weight(entry: dict[str, Any]) -> float:
    """Weight of the handles of an entry, inf without one."""
    weight = entry.get("weight", np.inf)
    number = isinstance(weight, int | float) and not isinstance(weight, bool)
    if not number or not weight > 0:
        raise InputError('"weight" must be a number above 0; without it the handles are hard')
    return float(weight)


def _kind(entry: Any) -> str:
    """Static, dynamic or unused, of an entry that has what it needs to be that."""
    if not isinstance(entry, dict):
        raise InputError("it is no object")
    moves = "target" in entry or ("boxes" in entry and MOTION & set(entry))
    kind = entry.get("kind", "dynamic" if moves else "static")
    if kind not in ("static", "dynamic", "unused"):
        raise InputError(f"unknown kind {kind!r}; use static, dynamic or unused")
    if kind != "unused" and sum(way in entry for way in WAYS) != 1:
        raise InputError('give its handles either as "vertices", as "source" or as "boxes"')
    needed = MOTION if "boxes" in entry else {"target"}
    if kind == "dynamic" and not needed <= set(entry):
        raise InputError(f'it is dynamic and has no "{min(needed - set(entry))}"')
    return kind


def _ids(values: Any, vertex: np.ndarray) -> np.ndarray:
    """Vertices of the mesh for ids of the file."""
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
