"""Load the tasks of a DeFAUST folder."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from defaust.edits import EDITS, Edit
from defaust.folder.layout import REST, REST_LOW, pose_file, pose_mesh, sha256, subject_folder
from defaust.folder.record import read_dataset, read_json
from defaust.sources.generated.shapes import ideal_pose
from defaust.tasks.full_size import Registered, find_skin, true_pose
from defaust.tasks.handle_kinds import HandleKind, of_kind
from sshade import DeformationTask, InputError, Mesh, TransferTask
from sshade.files.meshes import read_mesh
from sshade.files.task_files import read_handles

RESOLUTIONS = ("high", "low")
#: Reason for a missing ground truth.
REGIONS_ONLY = "the pose is known in its regions only"


class TaskId(NamedTuple):
    """Identifier of a task in a folder, for :func:`load_task`."""

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
        List only these subjects and poses; poses count from 1.

    Raises
    ------
    InputError
        When the folder is not a dataset, or lacks a requested subject or pose.
    """
    subjects_of = read_dataset(root)["subjects"]
    tasks = [TaskId(s["subject"], p["pose"]) for s in subjects_of for p in s["poses"]]
    for kind, wanted in (("subject", subjects), ("pose", poses)):
        if wanted is not None:
            known = {getattr(task, kind) for task in tasks}
            for number in wanted:
                if number not in known:
                    raise InputError(f"{root} has no {kind} {number}; it has {sorted(known)}")
            tasks = [task for task in tasks if getattr(task, kind) in wanted]
    return tasks


def load_task(
    root: str | os.PathLike[str],
    *,
    subject: int,
    pose: int,
    resolution: str = "high",
    raw: bool = False,
    edit: Edit | str | None = None,
    handles: HandleKind = "stored",
    truth: bool = True,
) -> DeformationTask | TransferTask:
    """Load the rest mesh and handles of a subject and pose, or a pose transfer.

    Parameters
    ----------
    root : path
        A DeFAUST folder.
    subject, pose : int
        Poses count from 1.
    resolution : str
        ``high``: the remeshed rest mesh, with handles snapped to its vertices. The ground truth is computed,
        which takes a second or two for 170,000 vertices. ``low``: the registered rest mesh; its ground truth
        is the registered target pose, or the pose without noise if that registration has noise. Both are the
        same in a dataset built with target_vertices=null. Generated shapes have a ground truth at both
        resolutions, if it is known.
    raw : bool
        Keep the stored targets of handles whose vertex is at another position.
    edit : Edit or str, optional
        An edit of :mod:`defaust.edits`, or its name in :data:`defaust.edits.EDITS`. The task then transfers
        the pose to the edited rest mesh and has no handles. :class:`defaust.edits.Unedited` keeps the mesh.
    handles : str
        ``stored``, ``points``, ``landmarks`` or ``regions``: kind of the handles; see
        :func:`defaust.tasks.handle_kinds.of_kind`. All kinds except ``stored`` are added to the task's name.
    truth : bool
        Load the ground truth. Without it, a task is what the evaluator has in memory while a method runs.

    Returns
    -------
    DeformationTask or TransferTask
        The groups of the handles are landmark ids, which are positions in the dataset's list of landmarks.
        The ground truth of a transfer to an unedited mesh is the pose itself. An edited mesh has a ground
        truth only if the body can be skinned. `meta` holds:

        - ``dataset``, ``source``, ``seed``, ``subject``, ``pose``, ``source_pose``, ``resolution``,
          ``vertices``, ``raw``;
        - ``note``: a remark of the source, for tables;
        - ``handles``: the kind of the handles; ``n_static``, ``n_dynamic``: how many there are;
        - ``snap_max``: largest distance of a stored position to its vertex; ``merged``: number of handles
          merged because they share a vertex;
        - ``checksum``: of the mesh and the pose file;
        - for a transfer ``edit`` and ``class``, the name of the subject's class, or of the subject;
        - with `truth`, ``posed_by``: origin of the ground truth, ``registration``, ``skinning``,
          ``subdivision`` or ``formulas``; or ``no_truth``: the reason for a missing ground truth.

    Raises
    ------
    InputError
        When the folder is not a dataset, or lacks the subject or pose, or when a file is missing or differs
        from the dataset's list.
    """
    case = _case(Path(root), subject=subject, pose=pose, resolution=resolution)
    if edit is None:
        return _deformation(case, kind=handles, raw=raw, truth=truth)
    if isinstance(edit, str):
        if edit not in EDITS:
            raise InputError(f"there is no edit {edit!r}; choose one of {', '.join(EDITS)}")
        edit = EDITS[edit]
    if case.registered is None:
        raise InputError(f"{case.name} has no registered pose to transfer; leave the edit out")
    if handles != "stored":
        raise InputError(f"a pose transfer has no handles; leave handles={handles} out")
    return _transfer(case, case.registered(), edit=edit, truth=truth)


@dataclass(frozen=True)
class StoredCase:
    """A subject in a pose, as a dataset stores it.

    Attributes
    ----------
    name : str
    mesh : Mesh
        Rest mesh at the resolution of the task.
    pose : Path
        File of the handles.
    content : mapping
        Content of the file.
    source : mapping
        The dataset's record of its source.
    facts : mapping
        For the task's `meta`.
    registered : callable, optional
        Reads the registered meshes; None without a registered pose.
    """

    name: str
    mesh: Mesh
    pose: Path
    content: Mapping[str, Any]
    source: Mapping[str, Any]
    facts: Mapping[str, Any]
    registered: Callable[[], Registered] | None


def _case(root: Path, *, subject: int, pose: int, resolution: str) -> StoredCase:
    """Check all files of a case, and read them except for the registered meshes."""
    if resolution not in RESOLUTIONS:
        raise InputError(f"resolution {resolution!r} is unknown; use one of {', '.join(RESOLUTIONS)}")
    document = read_dataset(root)
    list_tasks(root, subjects=[subject], poses=[pose])
    built_from = document["source"]
    folder = subject_folder(subject)
    mesh_name = f"{folder}/{REST if resolution == 'high' else REST_LOW}"
    pose_name = f"{folder}/{pose_file(pose)}"
    mesh = read_mesh(_checked(root, mesh_name, document=document))
    content = read_json(_checked(root, pose_name, document=document))
    sums = [document["files"][file]["sha256"][:16] for file in (mesh_name, pose_name)]
    facts = {"note": built_from["note"]} if built_from.get("note") else {}
    facts |= {
        "dataset": document["name"],
        "source": built_from["name"],
        "seed": document["build"]["seed"],
        "subject": subject,
        "pose": pose,
        "source_pose": content["source_pose"],
        "resolution": resolution,
        "vertices": mesh.n,
        "checksum": "+".join(sums),
    }
    record = next(s for s in document["subjects"] if s["subject"] == subject)
    is_registered = next(p for p in record["poses"] if p["pose"] == pose).get("registered", True)
    registered = None
    if is_registered and "formulas" not in built_from:
        is_low = resolution == "low" or document["build"]["target_vertices"] is None
        low = None if is_low else _checked(root, f"{folder}/{REST_LOW}", document=document)
        registered = partial(
            _registered,
            mesh,
            low,
            _checked(root, f"{folder}/{pose_mesh(pose)}", document=document),
            steps=record["high"]["ls3_steps"],
            noisy=built_from.get("noise_mm", 0) > 0,
        )
    return StoredCase(
        name=f"{document['name']}/{folder}/pose_{pose}",
        mesh=mesh,
        pose=root / pose_name,
        content=content,
        source=built_from,
        facts=facts,
        registered=registered,
    )


def _registered(mesh: Mesh, low: Path | None, posed: Path, *, steps: int, noisy: bool) -> Registered:
    """Read the registered meshes; without `low`, the rest mesh is one of them."""
    return Registered(mesh, mesh if low is None else read_mesh(low), read_mesh(posed), steps, noisy)


def _deformation(case: StoredCase, *, kind: HandleKind, raw: bool, truth: bool) -> DeformationTask:
    """Task of moving the handles of a case."""
    # The groups of the handles are the numbers of the entries, which are the ids of the landmarks.
    handles = read_handles(case.pose, case.mesh, raw=raw)
    handles = of_kind(
        case.mesh, handles, kind, are_regions=any("boxes" in h for h in case.content["handles"])
    )
    posed, origin = _truth(case) if truth else (None, {})
    return DeformationTask(
        name=case.name if kind == "stored" else f"{case.name}/{kind}",
        mesh=case.mesh,
        handles=handles,
        truth=posed,
        meta={
            **case.facts,
            **origin,
            "handles": kind,
            "n_static": int((~handles.dynamic).sum()),
            "n_dynamic": int(handles.dynamic.sum()),
            "snap_max": float(handles.snapping.distance.max()),
            "merged": handles.snapping.merged,
            "raw": raw,
        },
    )


def _truth(case: StoredCase) -> tuple[np.ndarray | None, dict[str, str]]:
    """Ground truth of a deformation, and the fact ``posed_by`` or ``no_truth``."""
    if case.registered is None:
        formulas = "formulas" in case.source
        posed = ideal_pose(case.source, case.facts["subject"], case.mesh) if formulas else None
        return posed, {"no_truth": REGIONS_ONLY} if posed is None else {"posed_by": "formulas"}
    meshes = case.registered()
    try:
        skin = find_skin(meshes, case.source, subject=case.facts["subject"], pose=case.facts["source_pose"])
        posed, origin = true_pose(meshes, skin)
    except InputError as error:  # a deformation task needs no ground truth
        return None, {"no_truth": str(error)}
    return posed, {"posed_by": origin}


def _transfer(case: StoredCase, meshes: Registered, *, edit: Edit, truth: bool) -> TransferTask:
    """Task of transferring a pose to an edited rest mesh."""
    rest, subject = meshes.rest, case.facts["subject"]
    edited = edit(rest)
    shape = rest if edited is rest.V else Mesh(edited, rest.F)
    skin = find_skin(meshes, case.source, subject=subject, pose=case.facts["source_pose"])
    posed, origin = true_pose(meshes, skin)
    true = None
    if truth:
        true = posed if shape is rest else None if skin is None else skin(shape.V)
    classes = case.source.get("classes")
    return TransferTask(
        name=f"{case.name}/{edit.name}" if edit.name else case.name,
        mesh=shape,
        rest=rest,
        posed=posed,
        truth=true,
        meta={
            **case.facts,
            "class": classes[subject] if classes else f"subject_{subject:02d}",
            "edit": edit.name or "none",
            "posed_by": origin,
        },
    )


def _checked(root: Path, name: str, *, document: dict[str, Any]) -> Path:
    """Path of a file after comparing it with the dataset's list."""
    path = root / name
    if not path.is_file():
        raise InputError(f"{path} is missing; run the same defaust build again to restore it")
    if sha256(path) != document["files"][name]["sha256"]:
        raise InputError(
            f"{path} is not the file that the dataset lists; run the same defaust build again, "
            f"or defaust verify {root} to find all such files"
        )
    return path
