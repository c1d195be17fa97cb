"""Creases: how much dihedral angles change, on the whole, at their worst, and near handles.

A bend that is spread over a joint and one that is folded into a single line may
have the same mean change of lengths and angles; the eye sees the fold. A handle
of one vertex draws a spike out of the surface, which shows in the edges around it.
"""

from __future__ import annotations

import numpy as np

from eval.metrics.deformed import Deformed
from eval.metrics.registry import metric

#: Rings of edges around a group of handles in which spikes are looked for.
RINGS = 3


@metric("deg", "mean over edges of |change of the dihedral angle|")
def bend(deformed: Deformed) -> float:
    """Mean absolute change of the dihedral angle over the edges of M, in degrees."""
    change = deformed.dihedral_changes
    return float(change.mean()) if len(change) else np.nan


@metric("deg", "99.9th percentile of |change of the dihedral angle|")
def bend_tail(deformed: Deformed) -> float:
    """99.9th percentile of the absolute change of the dihedral angle, in degrees."""
    change = deformed.dihedral_changes
    return float(np.percentile(change, 99.9)) if len(change) else np.nan


@metric(
    "deg", "99th percentile of |change of the dihedral angle| within 3 rings of a handle group", "handles"
)
def spike(deformed: Deformed) -> float:
    """Largest, over the groups of handles, 99th percentile of the changes within three rings, in degrees.

    An edge is within r rings of a group if one of its ends is at most r - 1 edges from a handle of it.
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
