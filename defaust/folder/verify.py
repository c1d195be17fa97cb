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
    read_dataset,
    read_json,
    sha256,
    subject_folder,
)
from sshade import InputError, Mesh
from sshade.io.meshes import read_mesh
from sshade.task import Progress, silent

#: Displacements and facts are recomputed to this, relative to the diagonal.
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
    try:
        return _verify(root, document, progress=progress)
    except (KeyError, TypeError, IndexError, AttributeError) as error:
        # A record that parses but lacks an entry cannot be the one that was written.
        return [Fault(DATASET, f"damaged: no valid entry {error}")]


def _verify(root: Path, document: dict[str, Any], *, progress: Progress) -> list[Fault]:
    faults = []
    if checksum(document) != document["checksum"]:
        faults.append(Fault(DATASET, "its content does not match its own checksum"))
    total = len(document["files"])
    for number, (name, entry) in enumerate(document["files"].items(), start=1):
        path = root / name
        if not path.is_file():
            faults.append(Fault(name, "missing"))
        elif sha256(path) != entry["sha256"]:
            faults.append(Fault(name, "its sha256 is not the one listed"))
        progress("checksums", number, total)
    faults += _check_card(root, document)
    for number, subject in enumerate(document["subjects"], start=1):
        faults += _check_subject(root, document, subject=subject)
        progress("subjects", number, len(document["subjects"]))
    return faults


def _check_card(root: Path, document: dict[str, Any]) -> list[Fault]:
    if CARD not in document["files"]:
        return [Fault(DATASET, f"lists no {CARD}")]
    path = root / CARD
    if path.is_file() and path.read_text(encoding="utf-8", errors="replace") != render_card(document):
        return [Fault(CARD, "is not the card that this record gives")]
    return []


def _check_subject(root: Path, document: dict[str, Any], *, subject: dict[str, Any]) -> list[Fault]:
    folder = subject_folder(subject["subject"])
    poses = [pose["pose"] for pose in subject["poses"]]
    faults: list[Fault] = []
    meshes: dict[str, Mesh] = {}
    loops = subject["low"].get("boundary_loops", 0)
    for name in (REST, REST_LOW, *map(pose_mesh, poses)):
        found = _check_mesh(root, document, name=f"{folder}/{name}", loops=loops)
        if isinstance(found, Fault):
            faults.append(found)
        elif found is not None:
            meshes[name] = found
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


def _check_mesh(root: Path, document: dict[str, Any], *, name: str, loops: int) -> Mesh | Fault | None:
    """The mesh of a file, what is wrong with it, or None where it is missing (reported before)."""
    entry = document["files"].get(name)
    if entry is None:
        return Fault(DATASET, f"lists no {name}")
    if not (root / name).is_file():
        return None
    try:
        mesh = read_mesh(root / name)
        mesh.require_manifold()
        mesh.require_one_component()
    except InputError as error:
        return Fault(name, str(error))
    if not loops and not mesh.is_closed:
        return Fault(name, f"not closed: {len(mesh.boundary_edges)} boundary edges")
    if (mesh.n, mesh.m) != (entry["vertices"], entry["faces"]):
        return Fault(
            name, f"has {mesh.n} vertices and {mesh.m} faces, not {entry['vertices']} and {entry['faces']}"
        )
    if mesh.topology.boundary_loops != loops:
        return Fault(name, f"has {mesh.topology.boundary_loops} boundary loops, not {loops}")
    return mesh


def _check_handles(
    root: Path, document: dict[str, Any], *, name: str, rest: Mesh, posed: Mesh
) -> list[Fault]:
    try:
        handles = read_json(root / name)["handles"]
        if [h["landmark"] for h in handles] != document["landmarks"]:
            return [Fault(name, "its landmarks are not those of the dataset")]
        taken: set[int] = set()
        vertex = {tuple(p): i for i, p in enumerate(rest.V.tolist())}
        for handle in handles:
            text = _handle_fault(
                handle, document["build"], rest=rest, posed=posed, vertex=vertex, taken=taken
            )
            if text:
                return [Fault(name, f"landmark {handle['landmark']}: {text}")]
    except InputError as error:
        return [Fault(name, str(error))]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        return [Fault(name, f"not a pose file ({type(error).__name__}: {error})")]
    return []


def _handle_fault(
    handle: dict[str, Any],
    build: dict[str, Any],
    *,
    rest: Mesh,
    posed: Mesh,
    vertex: dict[tuple[float, ...], int],
    taken: set[int],
) -> str:
    """What is wrong with one landmark's handles, or nothing; adds their vertices to `taken`."""
    if handle["kind"] == UNUSED:
        return "unused, but it has handles" if handle["source"] or handle["target"] else ""
    index = [vertex.get(tuple(p), -1) for p in handle["source"]]
    if len(index) != build["handles_per_landmark"]:
        return f"has {len(index)} handles, not {build['handles_per_landmark']}"
    if -1 in index:
        return f"handle {index.index(-1)} is no vertex of {REST_LOW}"
    if len(set(index) | taken) < len(index) + len(taken):
        return "a vertex serves twice"
    taken.update(index)
    if not np.array_equal(posed.V[index], np.array(handle["target"])):
        return "a target is not its vertex of the registered pose"
    d = displacement(
        rest.V[index], posed.V[index], diagonal=rest.diagonal, static_below=build["static_below"]
    )
    if abs(d.delta - handle["delta"]) > SAME * rest.diagonal * len(index):
        return f"delta is {handle['delta']}, and {d.delta} when recomputed"
    if abs(d.delta_mean - handle["delta_mean"]) > SAME * rest.diagonal:
        return f"delta_mean is {handle['delta_mean']}, and {d.delta_mean} when recomputed"
    if d.kind != handle["kind"]:
        return f"is listed as {handle['kind']}, and {d.kind} when recomputed"
    return ""
