"""Least-squares affine maps of the 1-rings of a surface: how it turns and stretches at its vertices.

The linear part A_i minimises, over the edges e_ij at vertex i and its unit normal n_i,

    sum_j w_ij |e_ij' - A e_ij|^2 + lambda_i |n_i' - A n_i|^2 ,
    w_ij = 1 / |e_ij|^3 ,   lambda_i = 1/2 sum_j w_ij |e_ij|^2 .

Short edges weigh most, as they are nearest to the derivative at the vertex. Edges in a plane
leave A n open; lambda_i, the mean of their weight along the plane's two axes, settles it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sshade.carry.frames import ZERO_AREA
from sshade.carry.neighbours import fill_from_neighbours
from sshade.mesh.mesh import Mesh

#: Edges shorter than this, times the mean, count as so long; coincident vertices have a finite weight.
SHORTEST = 1e-3
#: A ring whose edges' scatter has a determinant under this, times its trace cubed, is nearly on a line.
FLATTEST = 1e-6
#: The same for a map, relative to its largest entries: it has fewer than two dimensions.
RANK_ONE = 1e-12


@dataclass(frozen=True, eq=False)
class VertexMaps:
    """The linear fit at each vertex of a rest shape, ready for any deformed one.

    A_i is a fixed combination of the deformed edges and normals:
    A_i = sum_j e_ij' c_ij^T + n_i' d_i^T.

    Parameters
    ----------
    F : (l, 3) int64
    edges : (e, 2) int64
    c : (e, 2, 3) float64
        c_ij and c_ji of each edge, in 1 / length. Zero, like d_i, where the rest
        edges at i are on a line.
    d : (k, 3) float64
    """

    F: np.ndarray
    edges: np.ndarray
    c: np.ndarray
    d: np.ndarray

    @classmethod
    def at_rest(cls, mesh: Mesh) -> VertexMaps:
        """Prepare the fit for a rest shape."""
        edges = mesh.edges
        length = np.linalg.norm(mesh.V[edges[:, 1]] - mesh.V[edges[:, 0]], axis=1)
        weight = np.maximum(length, SHORTEST * length.mean()) ** -3.0
        return cls(mesh.F, edges, *_dual(mesh.V, _normals(mesh.V, mesh.F), edges, weight))

    def __call__(self, V: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Fit the maps to a deformed shape.

        Parameters
        ----------
        V : (k, 3) float64

        Returns
        -------
        A : (k, 3, 3) float64
        known : (k,) bool
            False where the rest or the deformed edges lie on a line or in a point; in place of such
            a map stands the mean of the neighbours' (:func:`sshade.carry.neighbours.fill_from_neighbours`).
        """
        e = V[self.edges[:, 1]] - V[self.edges[:, 0]]
        of_edges = np.stack([e, -e], axis=1)[:, :, :, None] * self.c[:, :, None, :]
        of_normals = _normals(V, self.F)[:, :, None] * self.d[:, None, :]
        index = np.concatenate([np.arange(len(V)), self.edges.ravel()])
        terms = np.concatenate([of_normals.reshape(-1, 9), of_edges.reshape(-1, 9)])
        A = _sums(index, terms, len(V)).reshape(-1, 3, 3)
        # The cofactors are the areas that a map makes: of one dimension, nothing but rounding.
        cofactors = np.cross(A[:, [1, 2, 0]], A[:, [2, 0, 1]])
        known = np.sqrt((cofactors**2).sum(axis=(1, 2))) > RANK_ONE * (A**2).sum(axis=(1, 2))
        return fill_from_neighbours(A, known, pairs=self.edges), known


def _normals(V: np.ndarray, F: np.ndarray) -> np.ndarray:
    """(k, 3) unit normals at the vertices, means by area; zero where they cancel."""
    a, b, c = (V[F[:, corner]] for corner in range(3))
    e1, e2 = b - a, c - a
    size = (e1**2).sum(axis=1) + (e2**2).sum(axis=1)
    faces = np.column_stack([np.cross(e1, e2), size])
    total = _sums(F.ravel(), np.repeat(faces, 3, axis=0), len(V))
    normals = total[:, :3]
    length = np.linalg.norm(normals, axis=1)
    known = length > ZERO_AREA * total[:, 3]
    return normals * np.divide(1.0, length, out=np.zeros(len(V)), where=known)[:, None]


def _dual(
    V: np.ndarray, normals: np.ndarray, edges: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """M^-1 w_ij e_ij and M^-1 lambda n, with M = sum_j w_ij e e^T + lambda n n^T: c and d of the maps."""
    e = V[edges[:, 1]] - V[edges[:, 0]]
    # The six entries of symmetric matrices, xx, xy, xz, yy, yz, zz.
    row, column = [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]
    products = weight[:, None] * (e[:, row] * e[:, column])
    scatter = _sums(edges.ravel(), np.repeat(products, 2, axis=0), len(V))
    trace = scatter[:, 0] + scatter[:, 3] + scatter[:, 5]
    pull = 0.5 * trace[:, None] * normals
    M = (scatter + pull[:, row] * normals[:, column])[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
    inverse = np.cross(M[:, [1, 2, 0]], M[:, [2, 0, 1]])
    determinant = (M[:, 0] * inverse[:, 0]).sum(axis=1)
    known = determinant > FLATTEST * trace**3
    inverse *= np.divide(1.0, determinant, out=np.zeros(len(V)), where=known)[:, None, None]
    ends = weight[:, None, None] * np.stack([e, -e], axis=1)
    c = (inverse[edges] * ends[:, :, None, :]).sum(axis=3)
    return c, (inverse * pull[:, None, :]).sum(axis=2)


def _sums(index: np.ndarray, rows: np.ndarray, count: int) -> np.ndarray:
    """(count, r) sums of the rows (m, r) that have the same index (m,)."""
    return np.stack([np.bincount(index, column, count) for column in rows.T], axis=1)
