"""The volume inside a set of faces whose boundary loops are capped.

Each boundary loop is closed by a fan of triangles around its centroid. The centroid is linear in the
positions, so the volume is a cubic polynomial of the positions. Its gradient at the centroid is distributed
equally over the loop.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sshade.solver.constraints import VOLUME_ALONE, add_gradients, volume_and_area


class CappedVolume:
    """The volume of a set of faces and its caps.

    Parameters
    ----------
    F : (m, 3) int
        The faces, consistently oriented, with any vertex ids. Loops that touch in a vertex have one cap.
    caps : bool
        Close boundary loops. Leave it out for all faces of a closed mesh, which saves a search.

    Attributes
    ----------
    vertex : (k,) int64
        Vertices of the faces.
    loops : int
        Number of caps.
    boundary : (b,) int64
        Vertices of the loops.
    """

    def __init__(self, F: np.ndarray, *, caps: bool = True) -> None:
        local, self.vertex = F, np.arange(F.max() + 1)
        tail = head = np.empty(0, dtype=np.int64)
        if caps:
            self.vertex, local = np.unique(F, return_inverse=True)
            local = local.reshape(-1, 3).astype(np.int64)
            tail, head = local.ravel(), np.roll(local, -1, axis=1).ravel()
            sides, twins = tail * len(self.vertex) + head, head * len(self.vertex) + tail
            boundary = ~np.isin(sides, twins)
            tail, head = tail[boundary], head[boundary]
        k = len(self.vertex)
        graph = coo_array((np.ones(len(tail), dtype=np.int8), (tail, head)), shape=(k, k))
        _, component = connected_components(graph, directed=False)
        _, self._loop = np.unique(component[tail], return_inverse=True)
        self._tail, self._count = tail, np.bincount(self._loop)
        self.loops, self.boundary = len(self._count), self.vertex[np.unique(tail)]
        fans = np.stack([head, tail, k + self._loop], axis=1)
        self._F = np.ascontiguousarray(np.concatenate([local, fans]), dtype=np.uint32)

    def measure(self, P: np.ndarray) -> np.ndarray:
        """Return (2,) volume, and area of faces and caps, at positions P (n, 3)."""
        X = self._with_centroids(P)
        return volume_and_area(0, len(self._F), self._F, X, X[self._F[0, 0]])

    def add_gradient(self, P: np.ndarray, factor: float, G: np.ndarray) -> None:
        """Add the gradient of the volume at P (n, 3), times a factor, to G (n, 3)."""
        X, k = self._with_centroids(P), len(self.vertex)
        gradient = np.zeros_like(X)
        add_gradients(self._F, VOLUME_ALONE, X, factor, 0.0, gradient, gradient, 0, len(X))
        for axis in range(3 if self.loops else 0):
            share = gradient[k:, axis] / self._count
            gradient[:k, axis] += np.bincount(self._tail, share[self._loop], minlength=k)
        G[self.vertex] += gradient[:k]

    def _with_centroids(self, P: np.ndarray) -> np.ndarray:
        """(k + loops, 3) positions of the vertices and the centroids."""
        X = np.empty((len(self.vertex) + self.loops, 3))
        X[: len(self.vertex)] = P[self.vertex]
        for axis in range(3 if self.loops else 0):
            sums = np.bincount(self._loop, X[self._tail, axis])
            X[len(self.vertex) :, axis] = sums / self._count
        return X
