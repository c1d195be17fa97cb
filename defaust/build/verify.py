"""Checks every file of a DeFAUST folder against dataset.json and against itself."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from defaust.build.handles import UNUSED, displacement
from defaust.folder.card import render_card
from defaust.folder.layout import (
    CARD,
    DATASET,
    REST,
    REST_LOW,
    checksum,
    pose_file,
    pose_mesh,
    sha256,
    subject_folder,
)
from defaust.folder.record import POSE, read_dataset, read_record
from sshade import InputError, Mesh
from sshade.io.meshes import read_mesh
from sshade.io.regions import rigidly_moved, vertices_in
from sshade.progress import Progress, silent

#: A listed displacement may differ from the recomputed one by this, x the diagonal x the number of handles.
SAME = 1e-12


class Fault(NamedTuple):
    """One thing wrong with one file."""

    file: str
    text: str


def verify(root: str | os.PathLike[str], *, progress: Progress = silent) -> list[Fault]:
    """Check a DeFAUST folder.

    Recomputed are: the checksum of each file and of dataset.json itself;
    counts, manifoldness, closedness, components and Euler characteristic of
    each mesh; and for the handles, that their sources are vertices of the
    registered rest mesh and their targets the same vertices of the pose, that
    no vertex serves twice, and displacement and kind; for regions, that they have vertices
    on both rest meshes and no two share one.

    Returns
    -------
    list of Fault
        Empty where everything is as listed.

    Raises
    ------
    InputError
        When the folder is no finished DeFAUST folder, or its record cannot be used.
    """
    root = Path(root)
    document = read_dataset(root, intact=False)
    faults = []
    if checksum(document) != document["checksum"]:
        faults.append(Fault(DATASET, "its content does not match its own checksum"))
    for number, (name, entry) in enumerate(document["files"].items(), start=1):
        path = root / name
        if not path.is_file():
            faults.append(Fault(name, "missing"))
        elif sha256(path) != entry["sha256"]:
            faults.append(Fault(name, "its sha256 is not the one listed"))
        progress("checksums", number, len(document["files"]))
    card = render_card(document).encode("utf-8", "surrogatepass")
    if CARD not in document["files"]:
        faults.append(Fault(DATASET, f"lists no {CARD}"))
    elif (root / CARD).is_file() and (root / CARD).read_bytes() != card:
        faults.append(Fault(CARD, "is not the card that this record gives"))
    for number, subject in enumerate(document["subjects"], start=1):
        faults += _check_subject(root, document, subject=subject)
        progress("subjects", number, len(document["subjects"]))
    return faults


def _check_subject(root: Path, document: dict[str, Any], *, subject: dict[str, Any]) -> list[Fault]:
    folder = subject_folder(subject["subject"])
    poses = [pose["pose"] for pose in subject["poses"]]
    registered = [pose["pose"] for pose in subject["poses"] if pose.get("registered", True)]
    faults: list[Fault] = []
    meshes: dict[str, Mesh] = {}
    for name in (REST, REST_LOW, *map(pose_mesh, registered)):
        file = f"{folder}/{name}"
        if file not in document["files"]:
            faults.append(Fault(DATASET, f"lists no {file}"))
        elif (root / file).is_file():  # a missing one was reported before
            try:
                meshes[name] = _read_listed(root / file, document["files"][file], facts=subject["low"])
            except InputError as error:
                faults.append(Fault(file, str(error)))
    rest = meshes.get(REST_LOW)
    if rest is None:
        return faults  # nothing to compare the poses with
    if REST in meshes and meshes[REST].topology != rest.topology:
        faults.append(Fault(f"{folder}/{REST}", "its topology is not that of the registered mesh"))
    for k in poses:
        posed = meshes.get(pose_mesh(k))
        if posed is None and k in registered:
            continue
        if posed is not None and not np.array_equal(posed.F, rest.F):
            faults.append(Fault(f"{folder}/{pose_mesh(k)}", f"its faces are not those of {REST_LOW}"))
        elif (root / folder / pose_file(k)).is_file():
            name, high = f"{folder}/{pose_file(k)}", meshes.get(REST, rest)
            faults += _check_handles(root, document, name=name, rest=rest, posed=posed, high=high)
    return faults


def _read_listed(path: Path, entry: dict[str, Any], *, facts: dict[str, Any]) -> Mesh:
    """The mesh of a file; InputError where it is not the one listed, or not of the topology listed."""
    mesh = read_mesh(path)
    loops, components = facts.get("boundary_loops", 0), facts.get("components", 1)
    if facts.get("oriented_manifold", True):
        mesh.require_manifold()
    if components == 1:
        mesh.require_one_component()
    if not loops and not mesh.is_closed:
        raise InputError(f"not closed: {len(mesh.boundary_edges)} boundary edges")
    listed = entry.get("vertices"), entry.get("faces")
    if (mesh.n, mesh.m) != listed:
        raise InputError(f"has {mesh.n} vertices and {mesh.m} faces, not {listed[0]} and {listed[1]}")
    if mesh.topology.components != components:
        raise InputError(f"has {mesh.topology.components} components, not {components}")
    if mesh.topology.boundary_loops != loops:
        raise InputError(f"has {mesh.topology.boundary_loops} boundary loops, not {loops}")
    return mesh


def _check_handles(
    root: Path, document: dict[str, Any], *, name: str, rest: Mesh, posed: Mesh | None, high: Mesh
) -> list[Fault]:
    try:
        handles = read_record(root / name, POSE)["handles"]
    except InputError as error:
        return [Fault(name, str(error))]
    if [h["landmark"] for h in handles] != document["landmarks"]:
        return [Fault(name, "its landmarks are not those of the dataset")]
    vertex = {tuple(p): i for i, p in enumerate(rest.V.tolist())}
    taken, taken_high = np.zeros(rest.n, dtype=bool), np.zeros(high.n, dtype=bool)
    for handle in handles:
        try:
            if "boxes" in handle:
                index, target = _region(handle, rest, taken=taken)
                _region(handle, high, taken=taken_high)
            else:
                index, target = _positions(handle, document["build"], vertex=vertex, taken=taken)
            if len(index):
                _check_targets(
                    handle,
                    rest.V[index],
                    target,
                    posed=None if posed is None else posed.V[index],
                    diagonal=rest.diagonal,
                    static_below=document["build"]["static_below"],
                )
        except InputError as error:
            return [Fault(name, f"landmark {handle['landmark']}: {error}")]
    return []


def _region(handle: dict[str, Any], mesh: Mesh, *, taken: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices of a region and their targets; marks them as taken."""
    index = vertices_in(mesh.V, handle["boxes"])
    _take(index, taken)
    return index, rigidly_moved(mesh.V[index], handle["rotation"], handle["translation"])


def _positions(
    handle: dict[str, Any],
    build: dict[str, Any],
    *,
    vertex: dict[tuple[float, ...], int],
    taken: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices at a landmark's positions and their targets, none where it is unused; marks them as taken."""
    index = np.array([vertex.get(tuple(p), -1) for p in handle["source"]], dtype=np.int64)
    target = np.array(handle["target"])
    if handle["kind"] == UNUSED:
        if len(index) or len(target):
            raise InputError("unused, but it has handles")
    elif len(index) != build["handles_per_landmark"]:
        raise InputError(f"has {len(index)} handles, not {build['handles_per_landmark']}")
    elif -1 in index:
        raise InputError(f"handle {index.tolist().index(-1)} is no vertex of {REST_LOW}")
    else:
        _take(index, taken)
    return index, target


def _take(index: np.ndarray, taken: np.ndarray) -> None:
    if taken[index].any() or len(np.unique(index)) < len(index):
        raise InputError("a vertex serves twice")
    taken[index] = True


def _check_targets(
    handle: dict[str, Any],
    source: np.ndarray,
    target: np.ndarray,
    *,
    posed: np.ndarray | None,
    diagonal: float,
    static_below: float,
) -> None:
    """Raise InputError unless a landmark's targets are those of the pose and its facts follow from them.

    Parameters
    ----------
    source, target : (k, 3) float64
    posed : (k, 3) float64, optional
        Its vertices in the registered pose, where there is one.
    """
    if posed is not None and not np.array_equal(posed, target):
        raise InputError("a target is not its vertex of the registered pose")
    d = displacement(source, target, diagonal=diagonal, static_below=static_below)
    for name, found in (("delta", d.delta), ("delta_mean", d.delta_mean)):
        listed = handle[name]
        if listed is None or abs(found - listed) > SAME * diagonal * len(source):
            raise InputError(f"{name} is {listed}, and {found} when recomputed")
    if d.kind != handle["kind"]:
        raise InputError(f"is listed as {handle['kind']}, and {d.kind} when recomputed")
