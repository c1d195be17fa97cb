"""Check every file of a DeFAUST folder against dataset.json and against the other files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from defaust.build.handles import UNUSED, displacement
from defaust.folder import layout
from defaust.folder.record import read_dataset, read_json
from sshade import InputError, Mesh
from sshade.core.progress import Progress, silent
from sshade.files.meshes import read_mesh
from sshade.mesh.rigid import rigidly_moved
from sshade.problem.snapping import vertices_in

#: Accepted error of a listed displacement, as a fraction of the diagonal times the number of handles.
SAME = 1e-12


class Fault(NamedTuple):
    """A fault of a file."""

    file: str
    text: str


def verify(root: str | os.PathLike[str], *, progress: Progress = silent) -> list[Fault]:
    """Check a DeFAUST folder.

    - Every file and dataset.json match their checksums. The other checks leave out files that do not.
    - Every mesh matches its listed counts and topology.
    - Handles are vertices of the registered rest mesh, and their targets the same vertices of the pose. No
      vertex is a handle twice. Displacement and kind are recomputed.
    - Regions contain vertices of both rest meshes, and no two regions share a vertex.

    Returns
    -------
    list of Fault
        Empty if the dataset is sound.

    Raises
    ------
    InputError
        When the folder is not a finished DeFAUST folder.
    """
    root = Path(root)
    document = read_dataset(root, intact=False)
    if layout.checksum(document) != document.get("checksum"):
        return [Fault(layout.DATASET, "its content does not match its own checksum")]
    faults, sound = [], set()
    for number, (name, entry) in enumerate(document["files"].items(), start=1):
        path = root / name
        if not path.is_file():
            faults.append(Fault(name, "missing"))
        elif layout.sha256(path) != entry["sha256"]:
            faults.append(Fault(name, "its sha256 differs from the listed one"))
        else:
            sound.add(name)
        progress("checksums", number, len(document["files"]))
    for number, subject in enumerate(document["subjects"], start=1):
        faults += _check_subject(root, document, subject=subject, sound=sound)
        progress("subjects", number, len(document["subjects"]))
    return faults


def _check_subject(
    root: Path, document: dict[str, Any], *, subject: dict[str, Any], sound: set[str]
) -> list[Fault]:
    folder = layout.subject_folder(subject["subject"])
    poses = [pose["pose"] for pose in subject["poses"]]
    faults: list[Fault] = []
    meshes: dict[str, Mesh] = {}
    for name in (layout.REST, layout.REST_LOW, *map(layout.pose_mesh, poses)):
        file = f"{folder}/{name}"
        if file in sound:
            try:
                meshes[name] = _read_listed(root / file, document["files"][file], facts=subject["low"])
            except InputError as error:
                faults.append(Fault(file, str(error)))
    rest = meshes.get(layout.REST_LOW)
    if rest is None:
        return faults  # the poses cannot be compared
    high = meshes.get(layout.REST, rest)
    for k in poses:
        mesh_file, file = f"{folder}/{layout.pose_mesh(k)}", f"{folder}/{layout.pose_file(k)}"
        posed = meshes.get(layout.pose_mesh(k))
        if posed is None and mesh_file in document["files"]:
            continue  # its mesh is already reported
        if posed is not None and not np.array_equal(posed.F, rest.F):
            faults.append(Fault(mesh_file, f"its faces differ from those of {layout.REST_LOW}"))
        elif file in sound:
            try:
                _check_handles(root / file, document, rest=rest, posed=posed, high=high)
            except InputError as error:
                faults.append(Fault(file, str(error)))
    return faults


def _read_listed(path: Path, entry: dict[str, Any], *, facts: dict[str, Any]) -> Mesh:
    """Read a mesh; raise InputError if it differs from its listed counts and topology."""
    mesh = read_mesh(path)
    if facts.get("oriented_manifold", True):
        mesh.require_manifold()
    loops = f"boundary loops ({mesh.connectivity.boundary_edges} boundary edges)"
    for counted, found, listed in (
        ("components", mesh.topology.components, facts.get("components", 1)),
        (loops, mesh.topology.boundary_loops, facts.get("boundary_loops", 0)),
        ("vertices", mesh.n, entry["vertices"]),
        ("faces", mesh.m, entry["faces"]),
    ):
        if found != listed:
            raise InputError(f"number of {counted}: {found}, not {listed}")
    return mesh


def _check_handles(
    path: Path, document: dict[str, Any], *, rest: Mesh, posed: Mesh | None, high: Mesh
) -> None:
    """Raise InputError at the first fault in the handles of a pose."""
    handles, build = read_json(path)["handles"], document["build"]
    if [h["landmark"] for h in handles] != document["landmarks"]:
        raise InputError("its landmarks differ from those of the dataset")
    vertex = {tuple(p): i for i, p in enumerate(rest.V.tolist())}
    taken, taken_high = np.zeros(rest.n, dtype=bool), np.zeros(high.n, dtype=bool)
    for handle in (handle for handle in handles if handle["kind"] != UNUSED):
        try:
            if "boxes" in handle:
                index = vertices_in(rest.V, handle["boxes"])
                target = rigidly_moved(rest.V[index], handle["rotation"], handle["translation"])
                _take(vertices_in(high.V, handle["boxes"]), taken_high)
            else:
                index, target = _positions(handle, vertex, count=build["handles_per_landmark"])
            _take(index, taken)
            if posed is not None and not np.array_equal(posed.V[index], target):
                raise InputError("a target is not its vertex of the registered pose")
            found = displacement(
                rest.V[index], target, diagonal=rest.diagonal, static_below=build["static_below"]
            )
            for name in ("delta", "delta_mean"):
                if abs(found[name] - handle[name]) > SAME * rest.diagonal * len(index):
                    raise InputError(f"{name} is {handle[name]}, and {found[name]} when recomputed")
            if found["kind"] != handle["kind"]:
                raise InputError(f"is listed as {handle['kind']}, and {found['kind']} when recomputed")
        except InputError as error:
            raise InputError(f"landmark {handle['landmark']}: {error}") from error


def _positions(
    handle: dict[str, Any], vertex: dict[tuple[float, ...], int], *, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices at a landmark's positions, and their targets."""
    index = [vertex.get(tuple(position), -1) for position in handle["source"]]
    if len(index) != count:
        raise InputError(f"has {len(index)} handles, not {count}")
    if -1 in index:
        raise InputError(f"handle {index.index(-1)} is no vertex of {layout.REST_LOW}")
    return np.array(index), np.array(handle["target"])


def _take(index: np.ndarray, taken: np.ndarray) -> None:
    """Mark vertices as taken; raise InputError if a vertex is a handle twice."""
    if taken[index].any() or len(np.unique(index)) < len(index):
        raise InputError("a vertex is a handle twice")
    taken[index] = True
