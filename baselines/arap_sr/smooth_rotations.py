"""The local step of ARAP-SR: fit each rotation to the edges and to the neighbours' rotations.

For fixed rotations of its neighbours, the rotation of vertex i maximises ``tr(R_i S~_i)`` with
``S~_i = sum_j w_ij e_ij e'_ij^T + (alpha A / deg(i)) sum_j R_j^T``; see :mod:`baselines.arap_sr.arap_sr`.
Vertices of one colour are not neighbours, so one call fits all their rotations.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from baselines.local_step import spokes
from sshade.core.kernels import kernel
from sshade.mesh.mesh import Mesh
from sshade.mesh.rotations import fit_rotations
from sshade.solver.laplacian import edge_weights, half_cotangents, laplacian_matrix


def vertex_colours(mesh: Mesh) -> np.ndarray:
    """Colour vertices greedily in their order, so that the ends of each edge have different colours.

    Returns
    -------
    (n,) int64
        Colours from 0; their number is at most the highest degree plus one.
    """
    adjacency = _symmetric(mesh, np.ones(len(mesh.edges)), edges=mesh.edges)
    return _greedy_colours(adjacency.indptr, adjacency.indices)


class Cells:
    """The vertex cells of a mesh whose vertices are sorted by colour.

    Parameters
    ----------
    mesh : Mesh
        Rest shape.
    alpha : float
        Weight of the rotations' smoothness.
    clamp : bool
        Raise negative cotangents to zero.
    colour : (n,) int64
        Colour of each vertex, in ascending order.

    Attributes
    ----------
    laplacian : (n, n) sparse float64
    elements : Edges
        The edges, as in the spokes energy.
    """

    def __init__(self, mesh: Mesh, *, alpha: float, clamp: bool, colour: np.ndarray) -> None:
        h = half_cotangents(mesh)
        if clamp:
            # At least two angles of a triangle are acute. The edges of positive weight therefore connect its
            # corners, and the Laplacian keeps its rank.
            h = np.maximum(h, 0.0)
        edges, weights = edge_weights(mesh, h)
        self.laplacian = laplacian_matrix(mesh.n, edges, weights)
        self.elements = spokes(mesh.V, edges, weights)
        star = _symmetric(mesh, weights, edges=edges)
        degree = np.diff(star.indptr)
        centre = np.repeat(np.arange(mesh.n), degree)
        self._start, self._neighbour = star.indptr, star.indices
        self._weight, self._edges = star.data, mesh.V[centre] - mesh.V[star.indices]
        self._weighted = self._weight[:, None] * self._edges
        self._smooth = alpha * mesh.area / degree
        self._first = np.searchsorted(colour, np.arange(colour[-1] + 2))

    def fit(self, P: np.ndarray, Q: np.ndarray, R: np.ndarray) -> None:
        """Fit Q and R to positions P (n, 3) by one Gauss-Seidel sweep over the colours."""
        for begin, end in pairwise(self._first):
            _covariances(self._start, self._neighbour, self._weighted, self._smooth, P, R, begin, end)
            fit_rotations(R[begin:end], Q[begin:end])

    def energy(self, P: np.ndarray, R: np.ndarray) -> float:
        """Return E of :mod:`baselines.arap_sr.arap_sr` at positions P (n, 3) and rotations R (n, 9)."""
        return float(_energy(self._start, self._neighbour, self._edges, self._weight, self._smooth, P, R))


def _symmetric(mesh: Mesh, values: np.ndarray, *, edges: np.ndarray):
    """Return the symmetric (n, n) matrix of values at edges, with stored zeros and ascending columns."""
    i, j = edges.T
    both = (np.concatenate([i, j]), np.concatenate([j, i]))
    matrix = coo_array((np.tile(values, 2), both), shape=(mesh.n, mesh.n)).tocsr()
    matrix.sort_indices()
    return matrix


def band_position(mesh: Mesh) -> np.ndarray:
    """Return the place (n,) of each vertex in an order that keeps neighbours close in memory."""
    adjacency = _symmetric(mesh, np.ones(len(mesh.edges)), edges=mesh.edges)
    return np.argsort(reverse_cuthill_mckee(adjacency, symmetric_mode=True))


@kernel
def _greedy_colours(start, neighbour):
    n = len(start) - 1
    colour = np.full(n, -1, dtype=np.int64)
    seen = np.full(n + 1, -1, dtype=np.int64)
    for i in range(n):
        for p in range(start[i], start[i + 1]):
            c = colour[neighbour[p]]
            if c >= 0:
                seen[c] = i
        c = 0
        while seen[c] == i:
            c += 1
        colour[i] = c
    return colour


@kernel
def _covariances(start, neighbour, edges, smooth, P, R, begin, end):
    """Replace the rotations of the vertices of a colour, from `begin` to `end`, by S~."""
    for i in range(begin, end):
        S = R[i]  # no vertex of this colour reads this row
        S[:] = 0.0
        for p in range(start[i], start[i + 1]):
            j = neighbour[p]
            x, y, z = P[i, 0] - P[j, 0], P[i, 1] - P[j, 1], P[i, 2] - P[j, 2]
            for r in range(3):
                e = edges[p, r]
                S[3 * r] += e * x + smooth[i] * R[j, r]
                S[3 * r + 1] += e * y + smooth[i] * R[j, 3 + r]
                S[3 * r + 2] += e * z + smooth[i] * R[j, 6 + r]


@kernel
def _energy(start, neighbour, edges, weight, smooth, P, R):
    total = 0.0
    for i in range(len(P)):
        for p in range(start[i], start[i + 1]):
            j = neighbour[p]
            for r in range(3):
                turned = 0.0
                for c in range(3):
                    turned += R[i, 3 * r + c] * edges[p, c]
                    total += 0.5 * smooth[i] * (R[i, 3 * r + c] - R[j, 3 * r + c]) ** 2
                total += weight[p] * (P[i, r] - P[j, r] - turned) ** 2
    return total


@kernel
def matrices(Q, R):
    """Bring quaternions to unit length and write their matrices, row by row."""
    for i in range(len(Q)):
        norm = np.sqrt(Q[i, 0] ** 2 + Q[i, 1] ** 2 + Q[i, 2] ** 2 + Q[i, 3] ** 2)
        for c in range(4):
            Q[i, c] /= norm
        w, x, y, z = Q[i, 0], Q[i, 1], Q[i, 2], Q[i, 3]
        R[i, 0], R[i, 1], R[i, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
        R[i, 3], R[i, 4], R[i, 5] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
        R[i, 6], R[i, 7], R[i, 8] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


def largest_turn(Q: np.ndarray, before: np.ndarray) -> float:
    """Return ``max_i |Q_i - before_i|`` of unit quaternions up to their signs: half the angle, if small."""
    minus, plus = (np.square(Q - other).sum(axis=1) for other in (before, -before))
    return float(np.sqrt(np.minimum(minus, plus).max()))
