"""Interpolate between dense handles instead of solving for an elastic shape.

Hundreds of handles all over a surface determine its deformation, as in registration, anatomical warping and
morphing of simulation meshes. A smooth map of space through the handles is then nearer to the truth than an
elastic surface, which keeps its volume and its area. The map: :mod:`sshade.interpolation.splines`.
"""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter

import numpy as np
from scipy.spatial import cKDTree

from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.interpolation.splines import fit_splines, interpolate, neighbours
from sshade.mesh.unconstrained import contacts, leaders, move_rigidly
from sshade.problem.facts import Facts
from sshade.problem.task import DeformationResult, DeformationTask
from sshade.regions.handle_regions import distance_to_handles, hard_positions_alone

#: Over the distance to the nearest handle that nearly all of the surface has at most: handles nearer than
#: SAME_PLACE are one place where centres are chosen, because the number of pairs grows with the square of the
#: number of handles in one place; centres of splines are THINNED apart.
SAME_PLACE, THINNED = 1 / 64, 0.5
#: Number of points whose neighbours are listed together; larger numbers take more memory in a crowd.
TOGETHER = 32
#: Largest number of splines.
SPLINES = 2000


def interpolate_handles(task: DeformationTask, *, progress: Progress = silent) -> DeformationResult:
    """Deform the mesh of a task by a smooth map of space through its handles.

    The faces play no part, so every mesh is allowed. Components without handles move rigidly with the nearest
    component.

    Parameters
    ----------
    task : DeformationTask
        With hard handles at four different places or more, and without prescribed rotations.
    progress : Progress

    Returns
    -------
    DeformationResult
        Handles are exactly on their targets.

    Raises
    ------
    InputError
        If handles are soft, prescribe rotations, or are at fewer than four places.
    """
    begin = perf_counter()
    handles, mesh = task.handles, task.mesh
    if not hard_positions_alone(task):
        raise InputError("the method 'interpolate' takes hard handles; leave out weights and rotations")
    x, y = _different(mesh.V[handles.index] - mesh.origin, handles.target)
    if len(x) < 4:
        raise InputError(f"the method 'interpolate' needs handles at four places; there are {len(x)}")
    progress("interpolate", 0, 1)
    spacing = distance_to_handles(task)
    places = _apart(x, SAME_PLACE * spacing)
    thinned = places[_apart(x[places], THINNED * spacing)]
    centres = thinned[np.linspace(0, len(thinned) - 1, min(SPLINES, len(thinned))).astype(np.int64)]
    splines = fit_splines(x, y, neighbours(x, thinned, centres))
    V = interpolate(splines, mesh.V - mesh.origin)
    V[handles.index] = handles.target
    facts = Facts(residual=0.0, hard_handle_error=0.0)
    if len(unconstrained := mesh.components_without(handles.index)):
        move_rigidly(mesh, V, leaders(mesh, unconstrained))
        contact = contacts(mesh, unconstrained)
        contact.warn()
        opening = contact.opening(V) / mesh.diagonal
        facts = replace(facts, unconstrained=len(unconstrained), touching=contact.components, opening=opening)
    progress("interpolate", 1, 1)
    return DeformationResult(V, 0, True, {"interpolate": perf_counter() - begin}, facts=facts)


def _different(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the places (k, 3) of handles, each once, and the mean targets there."""
    places, which, count = np.unique(x, axis=0, return_inverse=True, return_counts=True)
    if len(places) == len(x):
        return x, y
    mean = np.zeros_like(places)
    np.add.at(mean, which.ravel(), y)
    return places, mean / count[:, None]


def _apart(x: np.ndarray, radius: float) -> np.ndarray:
    """Choose points (c,) of which no two are nearer than a radius: each point that no chosen one is near."""
    tree, covered, chosen = cKDTree(x), np.zeros(len(x), dtype=bool), list[int]()
    for first in range(0, len(x), TOGETHER):
        free = [point for point in range(first, min(first + TOGETHER, len(x))) if not covered[point]]
        for point, near in zip(free, tree.query_ball_point(x[free], radius) if free else (), strict=True):
            if not covered[point]:
                covered[near] = True
                chosen.append(point)
    return np.array(chosen)
