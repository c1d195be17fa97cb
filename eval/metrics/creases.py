"""Creases: how much dihedral angles change, on the whole, at their worst, and near handles.

A bend that is spread over a joint and one that is folded into a single line may
have the same mean change of lengths and angles; the eye sees the fold. A handle
of one vertex draws a spike out of the surface, which shows in the edges around it.
"""

from __future__ import annotations

import numpy as np

from eval.metrics.geometry import dihedral_angles, dihedral_edges
from eval.metrics.registry import Task, metric

#: Rings of edges around a group of handles in which spikes are looked for.
RINGS = 3


def angle_changes(task: Task, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The edges ijkl (d, 4) of M that have a dihedral angle, and its absolute change in degrees (d,)."""
    corners = dihedral_edges(task.mesh.F, task.mesh.n)
    change = dihedral_angles(vertices, corners) - dihedral_angles(task.mesh.V, corners)
    return corners, np.degrees(np.abs((change + np.pi) % (2 * np.pi) - np.pi))


@metric("deg", "mean over edges of |change of the dihedral angle|")
def bend(task: Task, vertices: np.ndarray) -> float:
    """Mean absolute change of the dihedral angle over the edges of M, in degrees."""
    _, change = angle_changes(task, vertices)
    return float(change.mean()) if len(change) else np.nan


@metric("deg", "99.9th percentile of |change of the dihedral angle|")
def bend_tail(task: Task, vertices: np.ndarray) -> float:
    """99.9th percentile of the absolute change of the dihedral angle, in degrees."""
    _, change = angle_changes(task, vertices)
    return float(np.percentile(change, 99.9)) if len(change) else np.nan


@metric(
    "deg",
    "99th percentile of |change of the dihedral angle| within 3 rings of a handle group",
    needs="handles",
)
def spike(task: Task, vertices: np.ndarray) -> float:
    """Largest, over the groups of handles, 99th percentile of the changes within three rings, in degrees.

    An edge is within r rings of a group if one of its ends is at most r - 1 edges from a handle of it.
    """
    corners, change = angle_changes(task, vertices)
    handles, edges = task.handles, task.mesh.edges
    worst = np.nan
    for group in np.unique(handles.group):
        near = np.zeros(task.mesh.n, dtype=bool)
        near[handles.index[handles.group == group]] = True
        for _ in range(RINGS - 1):
            near[edges[near[edges].any(axis=1)]] = True
        around = change[near[corners[:, :2]].any(axis=1)]
        if len(around):
            worst = np.fmax(worst, np.percentile(around, 99))
    return float(worst)
