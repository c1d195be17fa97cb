"""Warps: where dense handles determine the deformation, interpolate between them instead of solving.

A handle is predicted if a smooth map through handles elsewhere (:mod:`sshade.pipeline.interpolation`) comes
near its target. The handles of a line or patch predict each other, which tells nothing about the surface
between lines and patches. Such a cluster is predicted from other clusters, or from handles that are far away.
Two rules give each vertex a weight from 0 (elastic) to 1 (interpolated):

- If the errors of all predictions are small in the mean, the weight is 1, except around handles that are far
  from predicted. Eight handles apart from each other are enough for a shape that is scaled or sheared.
- Otherwise the weight is 1 only around predicted handles, and only if handles lie near every vertex.

If the weights at the handles are small in the mean, all weights are 0. Where a weight is between 0 and 1, the
result is a mean of the interpolation and the elastic result, whose volume and area then follow the
interpolation, too. Soft handles are not interpolated; only volume and area follow. Landmarks of posed bodies
are neither dense nor predicted, so that their weight is 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import rigid_motion
from sshade.mesh.unconstrained import move_rigidly, without_handles
from sshade.options import Options
from sshade.pipeline.interpolation import fit_splines, interpolate, neighbours, points_elsewhere
from sshade.pipeline.regions import edge_vertices, enclosed_volume
from sshade.progress import Progress, silent
from sshade.task import DeformationTask

#: Least number of clusters of handles that can determine a deformation.
LEAST = 8
#: Over the distance to the nearest handle that the surface has: neighbouring handles of a cluster are nearer
#: than LINKED, handles of a cluster predict each other from FAR_AWAY on, and centres of splines are THINNED.
LINKED, FAR_AWAY, THINNED = 0.25, 2.0, 0.5
#: Handles nearer than this fraction of LINKED are one place where neighbours are listed: the number of pairs
#: grows with the square of the number of handles in one place.
SAME_PLACE = 1 / 16
#: Number of points whose neighbours are listed together; larger numbers take more memory in a crowd.
TOGETHER = 32
#: Largest number of splines.
SPLINES = 2000
#: Number of vertices at which the distance to the handles is measured, and the quantile of their area.
PROBES, NEARLY_ALL = 20_000, 0.95
#: Distance to the nearest handle, as a fraction of the square root of the area: handles are dense up to the
#: first and sparse from the second.
DENSE, SPARSE = 0.05, 0.1
#: Error of a prediction over the distance to other handles, up to which a handle is predicted, and from which
#: on it is not.
SURE, UNSURE = 0.03, 0.15
#: The same where most handles are predicted.
NEAR, FAR = 0.05, 0.3
#: The same for all handles: mean error (root mean square) over the mean motion that is not rigid.
ALL_SURE, ALL_UNSURE = 0.05, 0.3
#: Mean weight at the handles up to which nothing is interpolated, and from which on weights hold as they are.
#: A mean of two shapes stretches more than both, so that small weights do not pay.
LITTLE, MUCH = 0.4, 0.55
#: Largest weight of the area where half of it is interpolated.
YIELDING = 0.1
#: Largest distance of a weight from 1 that is rounding.
ROUNDING = 1e-9
#: Motion that is not rigid, as a fraction of the diagonal, up to which handles move rigidly.
RIGID = 1e-7


class Warp(NamedTuple):
    """The interpolation between the handles of a task.

    Attributes
    ----------
    vertices : (n, 3) float64
        Interpolated positions, with handles on their targets.
    weight : (n,) float64
        How much each vertex follows the interpolation, from 0 to 1.
    portion : float
        Mean weight over the area.
    exact : bool
        Whether the result follows the interpolation; otherwise volume and area alone do.
    """

    vertices: np.ndarray
    weight: np.ndarray
    portion: float
    exact: bool

    def constraints(self, mesh: Mesh, options: Options) -> dict[str, float]:
        """Return options of the elastic deformation with which volume and area follow the interpolation."""
        found = {"area": min(options.area, YIELDING * (1 - self.portion) / self.portion)}
        if options.volume and mesh.is_closed and mesh.is_oriented:
            implied = enclosed_volume(self.vertices, mesh.F) / enclosed_volume(mesh.V, mesh.F)
            ratio = 1 + self.portion * (implied - 1)
            found |= {"volume_goal": ratio} if ratio > 0 else {"volume": 0.0}
        return found

    def blend(self, V: np.ndarray) -> np.ndarray:
        """Return the weighted mean of the interpolation and elastically deformed positions V (n, 3)."""
        return V + self.weight[:, None] * (self.vertices - V) if self.exact else V


def find_warp(task: DeformationTask, mode: str, *, progress: Progress = silent) -> Warp | None:
    """Interpolate between handles that determine a deformation.

    Parameters
    ----------
    task : DeformationTask
    mode : {"auto", "always", "never"}
        Whether the weight follows from the handles, is 1, or is 0.
    progress : Progress

    Returns
    -------
    Warp or None
        None if the weight is 0 everywhere.

    Raises
    ------
    InputError
        If `mode` is "always", and handles are soft, slide, prescribe rotations, or are fewer than four.
    """
    handles, mesh = task.handles, task.mesh
    plain = handles.slide is None and handles.prescribed_rotations is None
    if mode == "never" or (mode == "auto" and (not plain or len(handles) < LEAST)):
        return None
    exact = bool(handles.hard.all())
    if not (plain and exact) and mode == "always":
        raise InputError("a warp interpolates hard handles; leave out weights, slides and rotations")
    x, y = _different(mesh.V[handles.index] - mesh.origin, handles.target)
    if len(x) < 4:
        raise InputError(
            f"a warp needs handles at four places; there are {len(x)}: give more, or leave warp=always out"
        )
    R, t = rigid_motion(x, y)
    bent = np.linalg.norm(x @ R.T + t - y, axis=1)
    if mode == "auto" and bent.max() <= RIGID * mesh.diagonal:
        return None
    if mode == "auto" and 2 * len(edge_vertices(mesh, handles.index)) < len(handles):  # handles are regions
        return None
    root, spacing = float(np.sqrt(mesh.area)), _distance_to_handles(task)
    places, place = _places(x, SAME_PLACE * LINKED * spacing)
    cluster = _clusters(x[places], LINKED * spacing)[place]
    if mode == "auto" and cluster.max() + 1 < LEAST:
        return None
    thinned = places[_places(x[places], THINNED * spacing)[0]]
    centres = thinned[np.linspace(0, len(thinned) - 1, min(SPLINES, len(thinned))).astype(np.int64)]
    reliable = np.ones(len(centres))
    if mode == "auto":
        predicting = places[_places(x[places], LINKED * spacing)[0]]
        elsewhere = points_elsewhere(x, predicting, centres, cluster, FAR_AWAY * spacing)
        error = fit_splines(x, y, elsewhere).left_out
        apart = np.linalg.norm(x[elsewhere[:, 1:4]] - x[centres][:, None], axis=2).mean(axis=1)
        all_sure = _falling(_root_mean_square(error) / _root_mean_square(bent[thinned]), ALL_SURE, ALL_UNSURE)
        dense = _falling(spacing / root, DENSE, SPARSE)
        reliable = all_sure * _falling(error / apart, NEAR, FAR)
        reliable = np.maximum(reliable, dense * _falling(error / apart, SURE, UNSURE))
        reliable *= 1 - _falling(float(reliable.mean()), LITTLE, MUCH)
        if not reliable.any():
            return None
    splines = fit_splines(x, y, neighbours(x, thinned, centres))
    progress("warp", 0, 1)
    V, weight = interpolate(splines, mesh.V - mesh.origin, reliable)
    V[handles.index] = handles.target
    if task.carry_unconstrained:
        move_rigidly(mesh, V, without_handles(mesh, handles.index))
    progress("warp", 1, 1)
    weight = np.minimum(weight, 1.0)
    weight[weight > 1 - ROUNDING] = 1.0
    area = mesh.vertex_areas
    # No dot product: the threads of BLAS would add in another order on another number of cores.
    portion = 1.0 if (weight == 1.0).all() else float((weight * area).sum() / area.sum())
    return Warp(V, weight, portion, exact)


def _different(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the places (k, 3) of handles, each once, and the mean targets there."""
    places, which, count = np.unique(x, axis=0, return_inverse=True, return_counts=True)
    if len(places) == len(x):
        return x, y
    mean = np.zeros_like(places)
    np.add.at(mean, which.ravel(), y)
    return places, mean / count[:, None]


def _distance_to_handles(task: DeformationTask) -> float:
    """Return the distance to the nearest handle that nearly all of the surface has at most."""
    mesh = task.mesh
    probes = np.linspace(0, mesh.n - 1, min(PROBES, mesh.n)).astype(np.int64)
    distance, _ = cKDTree(mesh.V[task.handles.index]).query(mesh.V[probes])
    order, area = np.argsort(distance), mesh.vertex_areas[probes]
    below = np.cumsum(area[order]) / area.sum()
    return float(distance[order[np.searchsorted(below, NEARLY_ALL)]])


def _places(x: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Choose points (c,) of which no two are nearer than a radius: each point that no chosen one is near.

    The second result (k,) is the number of a chosen point within the radius of each point.
    """
    tree, place, chosen = cKDTree(x), [-1] * len(x), list[int]()
    for first in range(0, len(x), TOGETHER):
        free = [point for point in range(first, min(first + TOGETHER, len(x))) if place[point] < 0]
        for point, near in zip(free, tree.query_ball_point(x[free], radius) if free else (), strict=True):
            if place[point] < 0:
                for other in near:
                    if place[other] < 0:
                        place[other] = len(chosen)
                chosen.append(point)
    return np.array(chosen), np.array(place)


def _clusters(x: np.ndarray, radius: float) -> np.ndarray:
    """Return the cluster (k,) of each point: points that are nearer than a radius are in the same."""
    k, near = len(x), cKDTree(x).query_pairs(radius, output_type="ndarray")
    graph = coo_array((np.ones(len(near), dtype=bool), near.T), shape=(k, k))
    return connected_components(graph, directed=False)[1]


def _root_mean_square(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _falling(values: np.ndarray | float, low: float, high: float) -> np.ndarray:
    """Fall smoothly from 1 at `low` to 0 at `high`, over the logarithms of values."""
    position = np.log(np.maximum(values, low) / low) / np.log(high / low)
    position = np.minimum(position, 1.0)
    return 1 - position * position * (3 - 2 * position)
