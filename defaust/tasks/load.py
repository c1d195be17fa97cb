"""Deformation tasks of a DeFAUST folder."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from defaust.build.handles import DYNAMIC, UNUSED
from defaust.edits import Edit
from defaust.folder.layout import (
    REST,
    REST_LOW,
    pose_file,
    pose_mesh,
    sha256,
    subject_folder,
)
from defaust.folder.record import POSE, read_dataset, read_record
from defaust.sources.shapes import ideal_pose
from defaust.tasks.full_size import Registered, find_skin, true_pose
from defaust.tasks.handle_kinds import Kind, of_kind
from defaust.tasks.transfers import transfer_task
from sshade import DeformationTask, Handles, InputError, Mesh, TransferTask
from sshade.io.meshes import read_mesh
from sshade.io.regions import rigidly_moved, vertices_in

RESOLUTIONS = ("high", "low")


class TaskId(NamedTuple):
    """What :func:`load_task` needs besides the folder."""

    subject: int
    pose: int


def list_tasks(
    root: str | os.PathLike[str],
    *,
    subjects: Sequence[int] | None = None,
    poses: Sequence[int] | None = None,
) -> list[TaskId]:
    """List the tasks of a DeFAUST folder, subject by subject.

    Parameters
    ----------
    root : path
    subjects, poses : sequence of int, optional
        Keep only these; poses count from 1.

    Raises
    ------
    InputError
        When the folder is no dataset, or has none of a subject or pose asked for.
    """
    return _tasks(read_dataset(root), root, subjects=subjects, poses=poses)


def load_task(
    root: str | os.PathLike[str],
    *,
    subject: int,
    pose: int,
    resolution: str = "high",
    raw: bool = False,
    source: str | None = None,
    edit: Edit | None = None,
    handles: Kind = "stored",
) -> DeformationTask | TransferTask:
    """Load rest mesh and handles of one subject and pose; with an edit, the pose transfer instead.

    Parameters
    ----------
    root : path
        A DeFAUST folder.
    subject, pose : int
        Poses count from 1.
    resolution : str
        ``high``: the remeshed rest mesh, handles snapped to its vertices; its truth is
        computed, which takes a second or two for 170,000 vertices.
        ``low``: the registered one, with the registered target pose as truth.
        They are the same, truth included, in a dataset built with target_vertices=null.
        Of a generated shape the truth is computed for either, where it is known; of a scan none is.
    raw : bool
        Keep the stored targets where a handle is snapped to another position.
    source : str, optional
        Name of the source that the dataset must have been built from.
    edit : Edit, optional
        One of :mod:`defaust.edits`: the task is to put the edited rest mesh into
        the pose, without handles. :class:`defaust.edits.Unedited` leaves the mesh
        as it is.
    handles : str
        ``stored``, ``points``, ``landmarks`` or ``regions``: the same pose asked for by another kind of
        handles, see :func:`defaust.tasks.handle_kinds.of_kind`. But for stored ones the kind ends the
        task's name.

    Returns
    -------
    DeformationTask or TransferTask
        For a transfer see :func:`defaust.tasks.transfers.transfer_task`. Otherwise the
        handles' groups are the ids of their landmarks (positions in the
        dataset's list); `meta` holds ``dataset``, ``subject``, ``pose``,
        ``source_pose``, ``note`` (of the source, for tables), ``resolution``, ``vertices``,
        ``handles`` (their kind), ``n_static``, ``n_dynamic``, ``snap_max``, ``merged``, ``checksum``
        (of the mesh and the pose file), and ``posed_by``, which says what `truth` was made
        by (``registration``, ``skinning``, ``subdivision`` or ``formulas``); where there is none,
        ``no_truth`` says why.

    Raises
    ------
    InputError
        When the folder is no dataset, is of another source, has no such subject
        or pose, or a file is missing or is not the one that the dataset lists.
    """
    root = Path(root)
    if resolution not in RESOLUTIONS:
        raise InputError(f"resolution {resolution!r} is unknown; use one of {', '.join(RESOLUTIONS)}")
    document = read_dataset(root)
    _tasks(document, root, subjects=[subject], poses=[pose])
    built_from = document["source"]["name"]
    if source not in (None, built_from):
        raise InputError(f"{root} was built with source={built_from}, not source={source}")
    folder = subject_folder(subject)
    name = f"{document['name']}/{folder}/pose_{pose}"
    mesh_name = f"{folder}/{REST if resolution == 'high' else REST_LOW}"
    pose_name = f"{folder}/{pose_file(pose)}"
    mesh = _mesh(root, mesh_name, document=document)
    content = read_record(_checked(root, pose_name, document=document), POSE)
    sums = [document["files"][file]["sha256"][:16] for file in (mesh_name, pose_name)]
    note = document["source"].get("note")
    facts = ({"note": note} if note else {}) | {
        "dataset": document["name"],
        "source": built_from,
        "seed": document["build"]["seed"],
        "subject": subject,
        "pose": pose,
        "source_pose": content["source_pose"],
        "resolution": resolution,
        "vertices": mesh.n,
        "checksum": "+".join(sums),
    }
    registered = resolution == "low" or document["build"]["target_vertices"] is None
    record = next(s for s in document["subjects"] if s["subject"] == subject)
    only = "the pose is known in its regions only"
    if "formulas" in document["source"]:
        if edit is not None:
            raise InputError(f"{name} is a generated shape, which has no registered pose to transfer")
        truth = ideal_pose(document["source"], subject, mesh)
        how = {"posed_by": "formulas"} if truth is not None else {"no_truth": only}
    elif not next(p for p in record["poses"] if p["pose"] == pose).get("registered", True):
        if edit is not None:
            raise InputError(f"{name} has no registered pose to transfer")
        truth, how = None, {"no_truth": only}
    else:
        low = mesh if registered else _mesh(root, f"{folder}/{REST_LOW}", document=document)
        posed = _mesh(root, f"{folder}/{pose_mesh(pose)}", document=document)
        meshes = Registered(mesh, low, posed, record["high"]["ls3_steps"])
        if edit is not None:
            if handles != "stored":
                raise InputError(f"a pose transfer has no handles; leave handles={handles} out")
            return transfer_task(meshes, document, name=name, edit=edit, facts=facts)
        truth, how = _truth(meshes, document["source"], facts)
    own = _handles(mesh, content["handles"], landmarks=document["landmarks"], raw=raw)
    are_regions = any("boxes" in record for record in content["handles"])
    own = of_kind(mesh, own, handles, are_regions=are_regions)
    return DeformationTask(
        name=name if handles == "stored" else f"{name}/{handles}",
        mesh=mesh,
        handles=own,
        truth=truth,
        meta=facts
        | how
        | {
            "handles": handles,
            "n_static": int((~own.dynamic).sum()),
            "n_dynamic": int(own.dynamic.sum()),
            "snap_max": float(own.snap_distance.max()),
            "merged": int(own.merged),
            "raw": raw,
        },
    )


def _tasks(
    document: dict[str, Any],
    root: str | os.PathLike[str],
    *,
    subjects: Sequence[int] | None,
    poses: Sequence[int] | None,
) -> list[TaskId]:
    tasks = [TaskId(s["subject"], p["pose"]) for s in document["subjects"] for p in s["poses"]]
    for what, wanted in (("subject", subjects), ("pose", poses)):
        if wanted is not None:
            known = {getattr(task, what) for task in tasks}
            for number in wanted:
                if number not in known:
                    raise InputError(f"{root} has no {what} {number}; it has {sorted(known)}")
            tasks = [task for task in tasks if getattr(task, what) in wanted]
    return tasks


def _truth(
    meshes: Registered, source: Mapping[str, Any], facts: Mapping[str, Any]
) -> tuple[np.ndarray | None, dict[str, str]]:
    """The true pose and what made it, or None and why there is none: a task by handles needs no truth."""
    try:
        skin = find_skin(meshes, source, subject=facts["subject"], pose=facts["source_pose"])
        truth, how = true_pose(meshes, skin)
    except InputError as error:
        return None, {"no_truth": str(error)}
    return truth, {"posed_by": how}


def _handles(mesh: Mesh, records: list[dict[str, Any]], *, landmarks: list[str], raw: bool) -> Handles:
    """The stored handles snapped to a mesh."""
    used = [h for h in records if h["kind"] != UNUSED]
    for handle in used:
        if handle["landmark"] not in landmarks:
            raise InputError(f"the dataset has no landmark {handle['landmark']!r}; build it again")
        if "source" in handle and len(handle["source"]) != len(handle["target"]):
            raise InputError(f"landmark {handle['landmark']} has other numbers of sources and targets")
    regions = [h for h in used if "boxes" in h]
    if regions:
        if len(regions) < len(used):
            raise InputError("a pose has both regions and positions as handles; build the dataset again")
        return _regions(mesh, regions, landmarks=landmarks)
    count = [len(h["source"]) for h in used]
    return Handles.from_positions(
        mesh,
        np.array([p for h in used for p in h["source"]]),
        np.array([p for h in used for p in h["target"]]),
        dynamic=np.repeat([h["kind"] == DYNAMIC for h in used], count),
        group=np.repeat([landmarks.index(h["landmark"]) for h in used], count),
        raw=raw,
    )


def _regions(mesh: Mesh, records: list[dict[str, Any]], *, landmarks: list[str]) -> Handles:
    """All vertices of a mesh in the stored regions; at rest where these are static."""
    index = [vertices_in(mesh.V, record["boxes"]) for record in records]
    target = [
        rigidly_moved(mesh.V[own], record["rotation"], record["translation"])
        if record["kind"] == DYNAMIC
        else mesh.V[own]
        for own, record in zip(index, records, strict=True)
    ]
    count = [len(own) for own in index]
    return Handles(
        np.concatenate(index),
        np.concatenate(target),
        dynamic=np.repeat([record["kind"] == DYNAMIC for record in records], count),
        group=np.repeat([landmarks.index(record["landmark"]) for record in records], count),
    )


def _mesh(root: Path, name: str, *, document: dict[str, Any]) -> Mesh:
    return read_mesh(_checked(root, name, document=document))


def _checked(root: Path, name: str, *, document: dict[str, Any]) -> Path:
    """Path of a file, which must be the one listed."""
    path = root / name
    if name not in document["files"]:
        raise InputError(f"{root} lists no {name}; rebuild the dataset")
    if not path.is_file():
        raise InputError(f"{path} is missing; run the same defaust build again to restore it")
    if sha256(path) != document["files"][name]["sha256"]:
        raise InputError(
            f"{path} is not the file that the dataset lists; run the same defaust build again, "
            f"or defaust verify {root} for all such files"
        )
    return path
