"""Tetrahedra in place of fTetWild's, where its extra is not installed."""

import numpy as np
from scipy.spatial import Delaunay, cKDTree

from baselines.volumetric.coarse_tetrahedra import six_volumes
from sshade import Mesh


def filled(V: np.ndarray, F: np.ndarray, *, edge: float, envelope: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the nodes and the tetrahedra that fill shapes of unit size that are nearly convex."""
    nodes, tetrahedra, component = np.zeros((0, 3)), [], Mesh(V, F).component
    for part in np.unique(component[F]):
        own = V[component == part]
        steps = [np.arange(low + edge / 2, high, edge) for low, high in np.stack([own.min(0), own.max(0)], 1)]
        grid = np.stack(np.meshgrid(*steps), axis=-1).reshape(-1, 3)
        inside = (Delaunay(own).find_simplex(grid) >= 0) & (cKDTree(own).query(grid)[0] > edge / 2)
        points = np.concatenate([own, grid[inside]])
        T = Delaunay(points).simplices.astype(np.int64)
        tetrahedra.append(T[abs(six_volumes(points, T)) > 1e-9] + len(nodes))
        nodes = np.concatenate([nodes, points])
    T = np.concatenate(tetrahedra)
    return nodes, np.where((six_volumes(nodes, T) < 0)[:, None], T[:, [0, 2, 1, 3]], T)
