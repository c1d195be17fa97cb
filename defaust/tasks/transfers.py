"""Pose transfers of a DeFAUST folder: its rest meshes, edited, and the poses to put them in."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from defaust.edits import Edit
from defaust.tasks.full_size import Skin, has_skin, subdivided_pose
from sshade import Mesh, TransferTask


class Registered(NamedTuple):
    """What a dataset stores of a subject in a pose.

    Attributes
    ----------
    rest : Mesh
        Rest mesh at the resolution of the task; `low` itself at low resolution.
    low, posed : Mesh
        Registered rest mesh and target pose.
    """

    rest: Mesh
    low: Mesh
    posed: Mesh


def transfer_task(
    meshes: Registered, document: Mapping[str, Any], *, name: str, edit: Edit, facts: Mapping[str, Any]
) -> TransferTask:
    """Make the task of transferring a pose to an edited rest mesh.

    The truth of the unedited mesh is the pose itself. An edited mesh has a truth
    only where the body can be skinned: the skinning of the edited vertices.

    Parameters
    ----------
    meshes : Registered
    document : mapping
        The content of dataset.json.
    name : str
        Of the task of the unedited mesh; an edit's name is added.
    edit : Edit
    facts : mapping
        ``subject``, ``source_pose``, and whatever else belongs into the task's `meta`.

    Returns
    -------
    TransferTask
        `meta` also holds ``edit``, ``class`` (the subject's, by name where the
        dataset has names) and ``posed_by`` (``skinning``, ``subdivision`` or ``registration``).

    Raises
    ------
    InputError
        When the edit does not fit the mesh, or the pose cannot be computed.
    """
    rest, low, posed = meshes
    subject = facts["subject"]
    edited = edit(rest)
    shape = rest if edited is rest.V else Mesh(edited, rest.F)
    steps = next(s["high"]["ls3_steps"] for s in document["subjects"] if s["subject"] == subject)
    skin = None
    if has_skin(document["source"]):
        skin = Skin(rest, low, steps=steps, subject=subject, pose=facts["source_pose"])
    if rest is low:
        target, how = posed.V, "registration"
    elif skin is not None:
        target, how = skin(rest.V), "skinning"
    else:
        target, how = subdivided_pose(rest, low, posed, steps=steps), "subdivision"
    truth = target if shape is rest else None if skin is None else skin(shape.V)
    classes = document["source"].get("classes")
    return TransferTask(
        name=f"{name}/{edit.name}" if edit.name else name,
        mesh=shape,
        rest=rest,
        posed=target,
        truth=truth,
        meta={
            **facts,
            "class": classes[subject] if classes else f"subject_{subject:02d}",
            "edit": edit.name or "none",
            "posed_by": how,
        },
    )
