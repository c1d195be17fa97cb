"""Sentences of ``sshade deform`` on unusual handles."""

from __future__ import annotations

import numpy as np

from sshade.core.errors import counted
from sshade.files.handle_files import HandleFile
from sshade.mesh.mesh import Mesh
from sshade.problem.astray import astray
from sshade.problem.handle_checks import SAME_TARGET
from sshade.problem.handles import Handles

#: Largest number of vertices that a note names.
NAMED = 10


def handle_notes(
    file: HandleFile, handles: Handles, mesh: Mesh, *, original: np.ndarray | None = None
) -> list[str]:
    """Return a sentence for each unusual fact about the handles of a file on a mesh.

    The mesh file has other numbers of the vertices, `original` (n,), if they are given.
    """
    found = []
    own = [group.number for group in file.groups if group.moves and group.motion is None]
    placed = np.flatnonzero(np.isin(handles.group, own) & handles.hard)
    if len(far := placed[astray(mesh.V[handles.index[placed]], handles.target[placed])]):
        ids = np.sort(handles.index[far] if original is None else original[handles.index[far]])
        more = f" and {len(ids) - NAMED} more" if len(ids) > NAMED else ""
        found.append(
            f"{counted(len(ids), 'handle goes', 'handles go')} far from where neighbours go, which may shred "
            f"the surface: vertex {', '.join(map(str, ids[:NAMED]))}{more}; check the order of the targets"
        )
    if handles.merge_distance > SAME_TARGET * mesh.diagonal:
        merged = counted(handles.merged, "position was", "positions were")
        found.append(
            f"{merged} merged with another position of the group at the same vertex; the vertex goes to the "
            "mean of their targets, at most "
            f"{100 * handles.merge_distance / mesh.diagonal:.2g} % of the diagonal from each target"
        )
    turned = []
    for group in file.groups:
        if group.motion is not None and group.motion.center is None and not group.motion.is_translation:
            points = mesh.V[handles.index[handles.group == group.number]]
            if len(points) and not ((points.min(axis=0) <= 0) & (points.max(axis=0) >= 0)).all():
                turned.append(str(group.number))
    if turned:
        entries = "entry" if len(turned) == 1 else "entries"
        found.append(
            f"the rotation or scale of {entries} {', '.join(turned)} is about the origin, which lies outside "
            'of the bounding box of its vertices; "center": "centroid" moves them about their mean'
        )
    return found
