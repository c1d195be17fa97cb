"""Make pose transfer tasks: an edited rest mesh, and the pose to transfer to it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from defaust.edits import Edit
from defaust.tasks.full_size import Registered, find_skin, true_pose
from sshade import Mesh, TransferTask


def transfer_task(
    meshes: Registered, document: Mapping[str, Any], *, name: str, edit: Edit, facts: Mapping[str, Any]
) -> TransferTask:
    """Make the task of transferring a pose to an edited rest mesh.

    The ground truth of an unedited mesh is the pose itself. An edited mesh has a ground truth only if the
    body can be skinned: the edited vertices, skinned into the pose.

    Parameters
    ----------
    meshes : Registered
    document : mapping
        The content of dataset.json.
    name : str
        Name of the task for the unedited mesh; the name of the edit is added.
    edit : Edit
    facts : mapping
        ``subject``, ``source_pose``, and further entries for the task's `meta`.

    Returns
    -------
    TransferTask
        `meta` also holds ``edit``, ``class`` (name of the subject's class, or of the subject) and
        ``posed_by`` (``skinning``, ``subdivision`` or ``registration``).

    Raises
    ------
    InputError
        When the edit does not fit the mesh, or the pose cannot be computed.
    """
    rest, subject = meshes.rest, facts["subject"]
    edited = edit(rest)
    shape = rest if edited is rest.V else Mesh(edited, rest.F)
    skin = find_skin(meshes, document["source"], subject=subject, pose=facts["source_pose"])
    target, how = true_pose(meshes, skin)
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
