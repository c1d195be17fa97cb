"""Creases: changes of dihedral angles over the whole mesh, at the worst edges, and near handles.

A smooth bend of a joint and a sharp fold may have the same mean change of lengths and angles, but a fold is
visible. A handle of one vertex can pull a spike out of the surface, which changes the angles around it.
"""

from __future__ import annotations

import numpy as np

from eval.metrics.deformed import Deformed
from eval.metrics.registry import metric

#: Number of rings of edges around a group of handles in which spikes are measured.
RINGS = 3


@metric("deg", "mean over edges of |change of the dihedral angle|")
def bend(deformed: Deformed) -> float:
    """Return the mean absolute change of the dihedral angle over the edges of M, in degrees."""
    change = deformed.dihedral_changes
    return float(change.mean()) if len(change) else np.nan


@metric("deg", "99.9th percentile of |change of the dihedral angle|")
def bend_tail(deformed: Deformed) -> float:
    """Return the 99.9th percentile of the absolute change of the dihedral angle, in degrees."""
    change = deformed.dihedral_changes
    return float(np.percentile(change, 99.9)) if len(change) else np.nan


@metric(
    "deg", "99th percentile of |change of the dihedral angle| within 3 rings of a handle group", "handles"
)
def spike(deformed: Deformed) -> float:
    """Return the 99th percentile of the changes within three rings of a handle group, in degrees.

    The metric is the largest value of a group. An edge is within r rings if one of its ends is at most r - 1
    edges from a handle of the group.
    """
    topology, handles = deformed.rest.topology, deformed.task.handles
    ends = topology.dihedral[:2]
    worst = np.nan
    for group in np.unique(handles.group):
        near = np.unique(handles.index[handles.group == group])
        for _ in range(RINGS - 1):
            near = np.union1d(near, topology.neighbours[near].indices)
        inside = np.zeros(topology.n, dtype=bool)
        inside[near] = True
        around = deformed.dihedral_changes[inside[ends].any(axis=0)]
        if len(around):
            worst = np.fmax(worst, np.percentile(around, 99))
    return float(worst)
