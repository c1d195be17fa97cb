"""Handles at both ends of any mesh, for two motions."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from sshade import Handles, Mesh
from tests.shapes import end_handles, of_all, rotation

#: "whole" moves all handles as one body; in "bend", one end of each component moves away.
Motion = Literal["whole", "bend"]
#: Motion of the whole: a rotation, and a shift as a fraction of the diagonal.
TURN, SHIFT = rotation(3), np.array([0.05, -0.03, 0.08])
#: Shift of a moving end, as a fraction of the diagonal.
LIFT = np.array([0.03, 0.02, 0.05])


def whole(mesh: Mesh) -> np.ndarray:
    """Return the positions of a mesh that moves as one body."""
    return mesh.V @ TURN.T + SHIFT * mesh.diagonal


def given(mesh: Mesh, motion: Motion, *, share: float = 0.15) -> Handles:
    """Return handles at both ends of each component along its longest axis."""
    parts = []
    for number in range(mesh.component.max() + 1):
        own = np.flatnonzero(mesh.component == number)
        V = mesh.V[own]
        ends = end_handles(V, axis=int(np.ptp(V, axis=0).argmax()), share=share, shift=LIFT * mesh.diagonal)
        ends = replace(ends, index=own[ends.index])
        parts.append((replace(ends, target=whole(mesh)[ends.index]) if motion == "whole" else ends, 0))
    return of_all(*parts)


def write_pose(mesh: Mesh, handles: Handles) -> None:
    """Write pose.json with positions, because vertices of the file may have other numbers."""
    groups = [handles.group == number for number in np.unique(handles.group)]
    entries = [
        {"source": mesh.V[handles.index[own]].tolist(), "target": handles.target[own].tolist()}
        for own in groups
    ]
    Path("pose.json").write_text(json.dumps({"handles": entries}))
