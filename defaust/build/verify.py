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
from sshade.task import Progress, silent

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
    no vertex serves twice, and displacement and kind.

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
    faults: list[Fault] = []
    meshes: dict[str, Mesh] = {}
    loops = subject["low"].get("boundary_loops", 0)
    for name in (REST, REST_LOW, *map(pose_mesh, poses)):
        file = f"{folder}/{name}"
        if file not in document["files"]:
            faults.append(Fault(DATASET, f"lists no {file}"))
        elif (root / file).is_file():  # a missing one was reported before
            try:
                meshes[name] = _read_listed(root / file, document["files"][file], loops=loops)
            except InputError as error:
                faults.append(Fault(file, str(error)))
    rest = meshes.get(REST_LOW)
    if rest is None:
        return faults  # nothing to compare the poses with
    if REST in meshes and meshes[REST].topology != rest.topology:
        faults.append(Fault(f"{folder}/{REST}", "its topology is not that of the registered mesh"))
    for k in poses:
        posed = meshes.get(pose_mesh(k))
        if posed is None:
            continue
        if not np.array_equal(posed.F, rest.F):
            faults.append(Fault(f"{folder}/{pose_mesh(k)}", f"its faces are not those of {REST_LOW}"))
        elif (root / folder / pose_file(k)).is_file():
            faults += _check_handles(root, document, name=f"{folder}/{pose_file(k)}", rest=rest, posed=posed)
    return faults


def _read_listed(path: Path, entry: dict[str, Any], *, loops: int) -> Mesh:
    """The mesh of a file; InputError where it is not the one listed."""
    mesh = read_mesh(path)
    mesh.require_manifold()
    mesh.require_one_component()
    if not loops and not mesh.is_closed:
        raise InputError(f"not closed: {len(mesh.boundary_edges)} boundary edges")
    listed = entry.get("vertices"), entry.get("faces")
    if (mesh.n, mesh.m) != listed:
        raise InputError(f"has {mesh.n} vertices and {mesh.m} faces, not {listed[0]} and {listed[1]}")
    if mesh.topology.boundary_loops != loops:
        raise InputError(f"has {mesh.topology.boundary_loops} boundary loops, not {loops}")
    return mesh


def _check_handles(
    root: Path, document: dict[str, Any], *, name: str, rest: Mesh, posed: Mesh
) -> list[Fault]:
    try:
        handles = read_record(root / name, POSE)["handles"]
    except InputError as error:
        return [Fault(name, str(error))]
    if [h["landmark"] for h in handles] != document["landmarks"]:
        return [Fault(name, "its landmarks are not those of the dataset")]
    taken: set[int] = set()
    vertex = {tuple(p): i for i, p in enumerate(rest.V.tolist())}
    for handle in handles:
        index = [vertex.get(tuple(p), -1) for p in handle["source"]]
        text = _handle_fault(handle, document["build"], index=index, taken=taken, rest=rest, posed=posed)
        if text:
            return [Fault(name, f"landmark {handle['landmark']}: {text}")]
        taken.update(index)
    return []


def _handle_fault(
    handle: dict[str, Any],
    build: dict[str, Any],
    *,
    index: list[int],
    taken: set[int],
    rest: Mesh,
    posed: Mesh,
) -> str:
    """What is wrong with the handles of one landmark, or nothing.

    Parameters
    ----------
    index : list of int
        Vertices of the rest mesh at their sources; -1 where there is none.
    taken : set of int
        Vertices of other landmarks' handles.
    """
    if handle["kind"] == UNUSED:
        return "unused, but it has handles" if handle["source"] or handle["target"] else ""
    if len(index) != build["handles_per_landmark"]:
        return f"has {len(index)} handles, not {build['handles_per_landmark']}"
    if -1 in index:
        return f"handle {index.index(-1)} is no vertex of {REST_LOW}"
    if len(set(index) | taken) < len(index) + len(taken):
        return "a vertex serves twice"
    if not np.array_equal(posed.V[index], np.array(handle["target"])):
        return "a target is not its vertex of the registered pose"
    d = displacement(
        rest.V[index], posed.V[index], diagonal=rest.diagonal, static_below=build["static_below"]
    )
    for name, found in (("delta", d.delta), ("delta_mean", d.delta_mean)):
        listed = handle[name]
        if listed is None or abs(found - listed) > SAME * rest.diagonal * len(index):
            return f"{name} is {listed}, and {found} when recomputed"
    return "" if d.kind == handle["kind"] else f"is listed as {handle['kind']}, and {d.kind} when recomputed"
