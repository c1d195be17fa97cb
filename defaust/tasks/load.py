"""Deformation tasks of a DeFAUST folder."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
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
from defaust.tasks.transfers import Registered, transfer_task
from sshade import DeformationTask, Handles, InputError, Mesh, TransferTask
from sshade.io.meshes import read_mesh

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
    resolution: str = "high",
    vertices: tuple[int, int] | None = None,
) -> list[TaskId]:
    """Tasks of a DeFAUST folder, subject by subject.

    Parameters
    ----------
    root : path
    subjects, poses : sequence of int, optional
        Keep only these; poses count from 1.
    resolution : str
        ``high`` or ``low``: the mesh whose vertices count for `vertices`.
    vertices : (2,) int, optional
        Keep only tasks whose rest mesh has so many vertices, both ends included.

    Raises
    ------
    InputError
        When the folder is no dataset, or has none of a subject or pose asked for.
    """
    _check_resolution(resolution)
    low, high = (0, math.inf) if vertices is None else vertices
    if not low <= high:
        raise InputError(f"vertices is {vertices}; give the smallest and the largest number")
    document = read_dataset(root)
    count = {s["subject"]: s[resolution]["vertices"] for s in document["subjects"]}
    tasks = [TaskId(s["subject"], p["pose"]) for s in document["subjects"] for p in s["poses"]]
    for what, wanted, known in (
        ("subject", subjects, {t.subject for t in tasks}),
        ("pose", poses, {t.pose for t in tasks}),
    ):
        for number in wanted or ():
            if number not in known:
                raise InputError(f"{root} has no {what} {number}; it has {sorted(known)}")
    return [
        t
        for t in tasks
        if (subjects is None or t.subject in subjects)
        and (poses is None or t.pose in poses)
        and low <= count[t.subject] <= high
    ]


def load_task(
    root: str | os.PathLike[str],
    *,
    subject: int,
    pose: int,
    resolution: str = "high",
    raw: bool = False,
    source: str | None = None,
    edit: Edit | None = None,
) -> DeformationTask | TransferTask:
    """Rest mesh and handles of one subject and pose; or, with an edit, the pose to transfer.

    Parameters
    ----------
    root : path
        A DeFAUST folder.
    subject, pose : int
        Poses count from 1.
    resolution : str
        ``high``: the remeshed rest mesh, handles snapped to its vertices.
        ``low``: the registered one, with the registered target pose as truth.
        They are the same, truth included, in a dataset built with target_vertices=null.
    raw : bool
        Keep the stored targets where a handle is snapped to another position.
    source : str, optional
        Name of the source that the dataset must have been built from.
    edit : Edit, optional
        One of :mod:`defaust.edits`: the task is to put the edited rest mesh into
        the pose, without handles. :class:`defaust.edits.Unedited` leaves the mesh
        as it is.

    Returns
    -------
    DeformationTask or TransferTask
        For a transfer see :func:`defaust.tasks.transfers.transfer_task`. Otherwise the
        handles' groups are the ids of their landmarks (positions in the
        dataset's list); `meta` holds ``dataset``, ``subject``, ``pose``,
        ``source_pose``, ``note`` (of the source, for tables), ``resolution``, ``vertices``,
        ``n_static``, ``n_dynamic``, ``snap_max``, ``merged`` and ``checksum``
        (of the mesh and the pose file).

    Raises
    ------
    InputError
        When the folder is no dataset, is of another source, has no such subject
        or pose, or a file is missing or is not the one that the dataset lists.
    """
    root = Path(root)
    _check_resolution(resolution)
    list_tasks(root, subjects=[subject], poses=[pose])
    document = read_dataset(root)
    built_from = document["source"]["name"]
    if source not in (None, built_from):
        raise InputError(f"{root} was built with source={built_from}, not source={source}")
    folder = subject_folder(subject)
    name = f"{document['name']}/{folder}/pose_{pose}"
    mesh_name = f"{folder}/{REST if resolution == 'high' else REST_LOW}"
    pose_name = f"{folder}/{pose_file(pose)}"
    sums = [_checked(root, file, document=document) for file in (mesh_name, pose_name)]

    mesh = read_mesh(root / mesh_name)
    content = read_record(root / pose_name, POSE)
    facts = _facts(document, subject=subject, pose=pose, source_pose=content["source_pose"])
    facts |= {"resolution": resolution, "vertices": mesh.n, "checksum": "+".join(s[:16] for s in sums)}
    registered = resolution == "low" or document["build"]["target_vertices"] is None
    if edit is not None:
        meshes = _registered(root, document, folder=folder, pose=pose, rest=None if registered else mesh)
        return transfer_task(meshes, document, name=name, edit=edit, facts=facts)
    handles = _handles(mesh, content["handles"], landmarks=document["landmarks"], raw=raw)
    truth = None
    if registered:
        _checked(root, f"{folder}/{pose_mesh(pose)}", document=document)
        truth = read_mesh(root / folder / pose_mesh(pose)).V
    return DeformationTask(
        name=name,
        mesh=mesh,
        handles=handles,
        truth=truth,
        meta=facts
        | {
            "n_static": int((~handles.dynamic).sum()),
            "n_dynamic": int(handles.dynamic.sum()),
            "snap_max": float(handles.snap_distance.max()),
            "merged": int(handles.merged),
            "raw": raw,
        },
    )


def _registered(
    root: Path, document: dict[str, Any], *, folder: str, pose: int, rest: Mesh | None
) -> Registered:
    """The registered meshes of a pose, with the rest mesh of the task; None: the registered one."""
    for name in (REST_LOW, pose_mesh(pose)):
        _checked(root, f"{folder}/{name}", document=document)
    low, posed = (read_mesh(root / folder / name) for name in (REST_LOW, pose_mesh(pose)))
    return Registered(low if rest is None else rest, low, posed)


def _check_resolution(resolution: str) -> None:
    if resolution not in RESOLUTIONS:
        raise InputError(f"resolution {resolution!r} is unknown; use one of {', '.join(RESOLUTIONS)}")


def _handles(mesh: Mesh, records: list[dict[str, Any]], *, landmarks: list[str], raw: bool) -> Handles:
    """The stored handles snapped to a mesh."""
    used = [h for h in records if h["kind"] != UNUSED]
    for handle in used:
        if handle["landmark"] not in landmarks:
            raise InputError(f"the dataset has no landmark {handle['landmark']!r}; build it again")
        if len(handle["source"]) != len(handle["target"]):
            raise InputError(f"landmark {handle['landmark']} has other numbers of sources and targets")
    count = [len(h["source"]) for h in used]
    return Handles.from_positions(
        mesh,
        np.array([p for h in used for p in h["source"]]),
        np.array([p for h in used for p in h["target"]]),
        dynamic=np.repeat([h["kind"] == DYNAMIC for h in used], count),
        group=np.repeat([landmarks.index(h["landmark"]) for h in used], count),
        raw=raw,
    )


def _facts(document: dict[str, Any], *, subject: int, pose: int, source_pose: str) -> dict[str, Any]:
    note = document["source"].get("note")
    return ({"note": note} if note else {}) | {
        "dataset": document["name"],
        "source": document["source"]["name"],
        "seed": document["build"]["seed"],
        "subject": subject,
        "pose": pose,
        "source_pose": source_pose,
    }


def _checked(root: Path, name: str, *, document: dict[str, Any]) -> str:
    """sha256 of a file that must be the one listed."""
    if name not in document["files"]:
        raise InputError(f"{root} lists no {name}; rebuild the dataset")
    if not (root / name).is_file():
        raise InputError(f"{root / name} is missing; run the same defaust build again to restore it")
    found = sha256(root / name)
    if found != document["files"][name]["sha256"]:
        raise InputError(
            f"{root / name} is not the file that the dataset lists; run the same defaust build again, "
            f"or defaust verify {root} for all such files"
        )
    return found
