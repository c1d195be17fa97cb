"""Handle files: this project's JSON, and the YAML of the Implicit-ARAP experiments.

JSON::

    {"handles": [
        {"landmark": "left foot", "kind": "static", "vertices": [12, 13, 14]},
        {"landmark": "right hand", "kind": "dynamic",
         "source": [[x, y, z], ...], "target": [[x, y, z], ...]},
        {"landmark": "head", "kind": "dynamic", "boxes": [[[x, y, z], [x, y, z]], ...],
         "rotation": [[...], [...], [...]], "translation": [x, y, z]},
        {"landmark": "tail", "vertices": [99], "target": [[x, y, z]], "weight": 5}
    ]}

Each entry is a group. Handles are given by position (``source``), snapped to
the nearest vertices; by ``vertices`` (ids), taken exactly; or as a region: all
vertices in some ``boxes`` along the axes, each by its lowest and its highest
corner, which go to R v + t. ``static`` handles stay where they are and need no
target; ``unused`` groups are skipped. A group with a ``weight`` is soft: it is pulled to its targets
(:class:`sshade.Handles`). Other keys are left alone.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sshade.errors import InputError
from sshade.handles import NO_HANDLES, Handles
from sshade.io.files import check_suffix, replacing
from sshade.io.meshes import read_file
from sshade.io.regions import rigidly_moved, vertices_in
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import rigid_motion
from sshade.mesh.surface import surface
from sshade.task import DeformationTask

#: Half the extent of a mesh in Implicit-ARAP's coordinates.
HALF_EXTENT = 0.8
#: Largest mean distance, in those coordinates, between its points and the mesh they belong to.
ON_SURFACE = 0.01
#: Ways to give the handles of an entry.
WAYS = ("vertices", "source", "boxes")
#: What a region that moves needs.
MOTION = {"rotation", "translation"}
#: Largest entry of R R^T - 1 of a rotation R read from a file.
ROTATION = 1e-6


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
        source, target, dynamic, group = _read_implicit_arap(path)
        place = _implicit_arap_frame(source, mesh)
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


def write_handles(path: str | os.PathLike[str], handles: Handles) -> None:
    """Write handles by vertex id as this project's JSON."""
    groups = []
    columns = [handles.group, handles.dynamic, handles.weight]
    for group, dynamic, weight in np.unique(np.stack(columns, axis=1), axis=0).tolist():
        own = (handles.group == group) & (handles.dynamic == dynamic) & (handles.weight == weight)
        vertices, target = handles.index[own].tolist(), handles.target[own].tolist()
        kind = "dynamic" if dynamic else "static"
        entry = {"landmark": int(group), "kind": kind, "vertices": vertices, "target": target}
        groups.append(entry if weight == np.inf else entry | {"weight": weight})
    with replacing(path) as temporary:
        temporary.write_text(json.dumps({"handles": groups}, indent=1) + "\n", encoding="utf-8")


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
        except InputError as error:
            raise InputError(f"entry {number}: {error}") from error
        own = at, target, np.full(len(at), kind == "dynamic"), np.full(len(at), number), weights
        (snapped if "source" in entry else exact).append(own)
    parts = []
    if exact:
        index, target, dynamic, group, weight = _columns(exact)
        parts.append(Handles(index, target, dynamic, group, weight=weight))
    if snapped:  # one search tree serves them all
        source, target, dynamic, group, weight = _columns(snapped)
        more = {"dynamic": dynamic, "group": group, "weight": weight}
        parts.append(Handles.from_positions(mesh, source, target, raw=raw, **more))
    if not parts:
        raise InputError(NO_HANDLES)
    order = np.argsort(np.concatenate([part.group for part in parts]), kind="stable")
    names = ("index", "target", "dynamic", "group", "snap_distance", "weight")
    joined = {name: np.concatenate([getattr(part, name) for part in parts])[order] for name in names}
    return Handles(**joined, merged=sum(part.merged for part in parts))


def _group(
    entry: dict[str, Any], mesh: Mesh, *, moves: bool, vertex: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices of an entry, or the positions to be snapped, and their targets."""
    if "boxes" in entry:
        at = vertices_in(mesh.V, _array(entry["boxes"], '"boxes"', (None, 2, 3), "a list of pairs of points"))
        moves = moves and set(entry) >= MOTION
        return at, rigidly_moved(mesh.V[at], *_motion(entry)) if moves else mesh.V[at]
    by_id = "vertices" in entry
    at = _ids(entry["vertices"], vertex) if by_id else _points(entry["source"], '"source"')
    target = mesh.V[at] if by_id else at
    if "target" in entry and (moves or not by_id):
        target = _points(entry["target"], '"target"')
    if len(target) != len(at):
        raise InputError(f"{len(at)} handles have {len(target)} targets; each needs one")
    return at, target


def _motion(entry: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and translation of a region."""
    R = _array(entry["rotation"], '"rotation"', (3, 3), "three rows of three numbers")
    t = _array(entry["translation"], '"translation"', (3,), "three numbers")
    if np.abs(R @ R.T - np.eye(3)).max() > ROTATION or np.linalg.det(R) < 0:
        raise InputError('"rotation" is no rotation: its rows must be orthonormal and right-handed')
    return R, t


def _weight(entry: dict[str, Any]) -> float:
    """Weight of the handles of an entry, inf without one."""
    weight = entry.get("weight", np.inf)
    number = isinstance(weight, int | float) and not isinstance(weight, bool)
    if not number or not weight > 0:
        raise InputError('"weight" must be a number above 0; without it the handles are hard')
    return float(weight)


def _columns(rows: Sequence[tuple[np.ndarray, ...]]) -> list[np.ndarray]:
    return [np.concatenate(column) for column in zip(*rows, strict=True)]


def _kind(entry: Any) -> str:
    """Static, dynamic or unused, of an entry that has what it needs to be that."""
    if not isinstance(entry, dict):
        raise InputError("it is no object")
    moves = "target" in entry or MOTION & set(entry)
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


def _points(values: Any, what: str) -> np.ndarray:
    return _array(values, what, (None, 3), "a list of points [x, y, z]")


def _array(values: Any, what: str, shape: tuple[int | None, ...], form: str) -> np.ndarray:
    """Finite numbers of a shape (None: any length but 0); InputError that tells the form on anything else."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.zeros(0)
    fits = array.ndim == len(shape) and all(a in (None, b) for a, b in zip(shape, array.shape, strict=True))
    if not fits or array.size == 0:
        raise InputError(f"{what} must be {form}")
    if not np.isfinite(array).all():
        raise InputError(f"{what} has a NaN or infinite position")
    return array


def _read_implicit_arap(path: Path) -> list[np.ndarray]:
    """Points, targets, dynamic flags and part numbers, in the file's own coordinates.

    D. Baieri, F. Maggioli, Z. Laehner, S. Melzi, E. Rodola, "Implicit-ARAP", 2024.
    """
    import yaml

    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except yaml.YAMLError as error:
        raise InputError(f"not readable as YAML ({str(error).splitlines()[0]})") from error
    if not isinstance(data, dict) or not isinstance(data.get("handles"), dict):
        raise InputError("expected a mapping `handles` with `static` and `moving`")
    static = _names(data["handles"], "static", "positions")
    moving = _names(data["handles"], "moving", "positions")
    transforms = _names(data["handles"], "moving", "transform")
    if len(moving) != len(transforms):
        raise InputError(f"{len(moving)} moving parts have {len(transforms)} transforms; each needs one")
    if not static and not moving:
        raise InputError("there are no handles; name at least one static or moving part")
    parts: list[tuple[str, str | None]] = [(name, None) for name in static]
    parts += zip(moving, transforms, strict=True)
    rows = []
    for number, (name, transform) in enumerate(parts):
        points = _read_points(path.parent / "parts", name)
        moved = points if transform is None else _read_points(path.parent / "transforms", transform)
        if len(points) != len(moved):
            raise InputError(f"part {name} has {len(points)} points, its transform {transform} {len(moved)}")
        k = len(points)
        rows.append((points, moved, np.full(k, transform is not None), np.full(k, number)))
    return _columns(rows)


def _names(handles: dict, kind: str, key: str) -> list[str]:
    parts = handles.get(kind) or {}
    names = (parts.get(key) or []) if isinstance(parts, dict) else None
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InputError(f"`handles.{kind}.{key}` must be a list of names")
    return names


def _read_points(folder: Path, name: str) -> np.ndarray:
    path = folder / f"{name}.txt"
    if Path(name).is_absolute() or ".." in Path(name).parts:
        raise InputError(f"{name!r} leads out of the folder {folder.name}; name a file in it")
    if not path.is_file():
        raise InputError(f"no such file: {path}")
    rows = [line.split() for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    try:
        values = [[float(word) for word in row] for row in rows]
    except ValueError as error:
        raise InputError(f"{path}: each line needs three numbers ({error})") from error
    return _points(values, str(path))


def _implicit_arap_frame(points: np.ndarray, mesh: Mesh):
    """The map from Implicit-ARAP's coordinates to the mesh's own.

    Its meshes are centred on the area-weighted surface centroid and scaled to
    a largest coordinate of 0.8. Copies of a model differ in their axes and a
    little in their centroid: of the 24 axis rotations the one that brings the
    points nearest to the surface is refined by rigid ICP on all of them.
    """
    import igl
    from scipy.spatial.transform import Rotation

    barycentres = mesh.V[mesh.F].mean(axis=1)
    centre = (barycentres * mesh.face_areas[:, None]).sum(axis=0) / mesh.area
    scale = HALF_EXTENT / np.abs(mesh.V - centre).max()
    V, F = (mesh.V - centre) * scale, np.array(mesh.F)
    tree = igl.AABB()
    tree.init(V, F)  # once: it takes far longer than the queries

    def closest(queries: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        squared, _, nearest = tree.squared_distance(V, F, np.ascontiguousarray(queries))
        return np.sqrt(squared), nearest

    rotations = np.rint(Rotation.create_group("O").as_matrix())
    rotations = rotations[np.argsort(-np.trace(rotations, axis1=1, axis2=2), kind="stable")]
    distance, _ = closest((points @ rotations.transpose(0, 2, 1)).reshape(-1, 3))
    mean = distance.reshape(len(rotations), -1).mean(axis=1)
    R, t, error = rotations[int(np.argmin(mean))], np.zeros(3), float(mean.min())
    for _ in range(2):
        at = points @ R.T + t
        dR, dt = rigid_motion(at, closest(at)[1])
        refined = float(closest(points @ (dR @ R).T + dR @ t + dt)[0].mean())
        if refined >= error:
            break
        R, t, error = dR @ R, dR @ t + dt, refined
    if error >= ON_SURFACE:
        raise InputError(
            f"its points lie {error:.3f} from the mesh in the mean, of a half-extent of {HALF_EXTENT}, in "
            f"the best of 24 axis orientations (at most {ON_SURFACE} is accepted); "
            "is this the mesh they were made for?"
        )
    return lambda x: (x @ R.T + t) / scale + centre
