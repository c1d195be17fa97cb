"""Places, components and shared edges of a mesh whose file may repeat vertices."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from tools.corpus.document import Document

#: Distance of copies of a vertex, as a fraction of the diagonal.
COPIES = 1e-9


class Joints:
    """A mesh, and which of its vertices and edges are copies of each other.

    Attributes
    ----------
    F : (k, 3) int64
        Faces that do not repeat a vertex.
    diagonal : float
        Of the bounding box of the vertices with a face.
    tolerance : float
        Greatest distance of copies.
    place : (n,) int64
        Equal for vertices within the tolerance.
    component : (n,) int64
        Component of each vertex over vertex ids and shared edges; -1 for vertices without a face.
    """

    def __init__(self, mesh: Document) -> None:
        F = mesh.F
        self.F = F = F[(F[:, 0] != F[:, 1]) & (F[:, 1] != F[:, 2]) & (F[:, 2] != F[:, 0])]
        self.V = mesh.V
        used = np.unique(F)
        self.diagonal = float(np.linalg.norm(np.ptp(mesh.V[used], axis=0))) if len(used) else 0.0
        self.tolerance = max(COPIES * self.diagonal, 2 * mesh.step)
        pairs = cKDTree(mesh.V[used]).query_pairs(self.tolerance, output_type="ndarray")
        self.place = _labels(len(mesh.V), used[pairs])
        self.side = np.concatenate([F[:, [0, 1]], F[:, [1, 2]], F[:, [2, 0]]])
        swapped = self.place[self.side[:, 0]] > self.place[self.side[:, 1]]
        self.side[swapped] = self.side[swapped, ::-1]  # ends at the same places are in the same column
        low, high = self.place[self.side].T
        self._edge = np.unique(low * len(mesh.V) + high, return_inverse=True)[1].ravel()
        _, first = np.unique(self._edge, return_index=True)
        twin = self.side[first[self._edge]]
        links = [self.side, *(np.stack([self.side[:, c], twin[:, c]], axis=1) for c in (0, 1))]
        label = _labels(len(mesh.V), np.concatenate(links))
        self.component = np.full(len(mesh.V), -1)
        self.component[used] = np.unique(label[used], return_inverse=True)[1]

    def shared(self) -> list[np.ndarray]:
        """Return the edges that k > 1 sides share without sharing vertex ids, an array (e, k, 2) for each k.

        A side is a row of two vertices. Rows of one edge have copies of a vertex in the same column. Where
        edges are shorter than the tolerance, their ends are no copies.
        """
        ids = np.sort(self.side, axis=1)
        ids = np.unique(ids[:, 0] * len(self.V) + ids[:, 1], return_inverse=True)[1].ravel()
        low, high = self.place[self.side].T
        fine = np.zeros(len(self.V), dtype=bool)  # places of edges shorter than the tolerance
        fine[low[low == high]] = True
        alone = np.flatnonzero((np.bincount(ids)[ids] == 1) & ~fine[low] & ~fine[high])
        order = alone[np.argsort(self._edge[alone], kind="stable")]
        size = np.bincount(self._edge[order], minlength=len(self._edge))[self._edge[order]]
        return [self.side[order[size == k]].reshape(-1, k, 2) for k in np.unique(size) if k > 1]

    def edges(self) -> np.ndarray:
        """Return the edges (e, 2) by vertex ids."""
        return np.unique(np.sort(self.side, axis=1), axis=0)


def _labels(n: int, links: np.ndarray) -> np.ndarray:
    graph = coo_array((np.ones(len(links), dtype=bool), tuple(links.T)), shape=(n, n))
    return connected_components(graph, directed=False)[1].astype(np.int64)
