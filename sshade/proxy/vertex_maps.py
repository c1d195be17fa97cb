"""Affine maps of the 1-rings of a surface, by least squares: how the surface turns and stretches.

The linear part A_i at vertex i minimises, over the edges e_ij at the vertex and its unit normal n_i,

    sum_j w_ij |e_ij' - A e_ij|^2 + lambda_i |n_i' - A n_i|^2 ,
    w_ij = 1 / |e_ij|^3 ,   lambda_i = 1/2 sum_j w_ij |e_ij|^2 .

Short edges weigh most, because they are nearest to the derivative at the vertex. Edges in a plane do not
determine A n. The term with lambda_i, the mean weight of the edges along the two axes of the plane, does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sshade.core.kernels import kernel
from sshade.mesh.incidence import sides_by_edge
from sshade.mesh.mesh import Mesh
from sshade.proxy.frames import ZERO_AREA


def fill_from_neighbours(
    values: np.ndarray,
    known: np.ndarray,
    *,
    pairs: np.ndarray,
    onto: Callable[[np.ndarray], np.ndarray] | None = None,
) -> np.ndarray:
    """Replace unknown 3 x 3 matrices by the mean of their known neighbours, ring by ring inwards.

    Parameters
    ----------
    values : (k, 3, 3) float64
    known : (k,) bool
        Entries that are defined.
    pairs : (e, 2) int
        Pairs of neighbouring entries.
    onto : callable, optional
        Maps the means (j, 3, 3) of a ring to admissible matrices, for example to the nearest rotations.

    Returns
    -------
    (k, 3, 3) float64
        `values` itself if all are known. The identity where no known entry is connected.
    """
    if known.all():
        return values
    flat, known = np.where(known[:, None], values.reshape(-1, 9), 0.0), known.copy()
    one, two = np.concatenate([pairs, pairs[:, ::-1]]).T
    while True:
        use = known[two] & ~known[one]
        ready = np.unique(one[use])
        if len(ready) == 0:
            flat[~known] = np.eye(3).ravel()
            return flat.reshape(-1, 3, 3)
        count = np.bincount(one[use], minlength=len(known))
        mean = sums_by_index(one[use], flat[two[use]], len(known))[ready] / count[ready, None]
        flat[ready] = mean if onto is None else onto(mean.reshape(-1, 3, 3)).reshape(-1, 9)
        known[ready] = True


def sums_by_index(index: np.ndarray, rows: np.ndarray, count: int) -> np.ndarray:
    """Return the sums (count, r) of rows (m, r) with the same index (m,)."""
    return np.stack([np.bincount(index, column, count) for column in rows.T], axis=1)


def adjacent_triangles(F: np.ndarray) -> np.ndarray:
    """Return the pairs (p, 2) of triangles that share an edge; F (l, 3) int must be manifold."""
    sides = sides_by_edge(F, int(F.max()) + 1)
    first = sides.start[:-1][sides.faces == 2]
    return np.stack([sides.side[first], sides.side[first + 1]], axis=1) // 3


#: Least length of an edge in its weight, as a fraction of the mean: coincident vertices have a finite weight.
SHORTEST = 1e-3
#: Largest determinant of the scatter of a ring's edges, over its cubed trace, of a ring nearly on a line.
FLATTEST = 1e-6
#: Largest norm of the cofactors of a map, over its squared norm, of a map with fewer than two dimensions.
RANK_ONE = 1e-12


@dataclass(frozen=True, eq=False)
class VertexMaps:
    """The fit at each vertex of a rest shape, prepared for any deformed shape.

    A_i is a fixed combination of deformed edges and normals: A_i = sum_j e_ij' c_ij^T + n_i' d_i^T.

    Parameters
    ----------
    F : (l, 3) int64
        Faces.
    edges : (e, 2) int64
        Edges, as :attr:`sshade.mesh.mesh.Mesh.edges`.
    c : (e, 2, 3) float64
        c_ij and c_ji of each edge, in 1 / length. Zero where the edges at i lie on a line at rest.
    d : (k, 3) float64
        d_i of each vertex, without unit; zero in the same places.
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
            Deformed vertices.

        Returns
        -------
        A : (k, 3, 3) float64
            Linear parts of the maps.
        known : (k,) bool
            False where the rest or the deformed edges lie on a line or in a point. There A is the mean of
            the neighbours (:func:`sshade.proxy.vertex_maps.fill_from_neighbours`).
        """
        A = _normals(V, self.F)[:, :, None] * self.d[:, None, :]
        _add_edges(V, self.edges, self.c, A)
        # The cofactors of a map are the areas that it makes. A map of one dimension leaves only rounding.
        cofactors = np.cross(A[:, [1, 2, 0]], A[:, [2, 0, 1]])
        known = np.sqrt((cofactors**2).sum(axis=(1, 2))) > RANK_ONE * (A**2).sum(axis=(1, 2))
        return fill_from_neighbours(A, known, pairs=self.edges), known


def _normals(V: np.ndarray, F: np.ndarray) -> np.ndarray:
    """Return the unit normals (k, 3) at vertices, averaged by area; zero where they cancel."""
    normals, size = np.zeros((len(V), 3)), np.zeros(len(V))
    _add_normals(V, F, normals, size)
    length = np.linalg.norm(normals, axis=1)
    known = length > ZERO_AREA * size
    return normals * np.divide(1.0, length, out=np.zeros(len(V)), where=known)[:, None]


@kernel
def _add_edges(V, edges, c, A):
    """Add e_ij' c_ij^T to A_i (k, 3, 3), and the same for j."""
    for t in range(len(edges)):
        i, j = edges[t, 0], edges[t, 1]
        for r in range(3):
            e = V[j, r] - V[i, r]
            for s in range(3):
                A[i, r, s] += e * c[t, 0, s]
                A[j, r, s] -= e * c[t, 1, s]


@kernel
def _add_normals(V, F, normals, size):
    """Add the vector areas of faces to the normals of their corners, and two squared edges to their sizes."""
    for t in range(len(F)):
        a, b, c = F[t, 0], F[t, 1], F[t, 2]
        ux, uy, uz = V[b, 0] - V[a, 0], V[b, 1] - V[a, 1], V[b, 2] - V[a, 2]
        vx, vy, vz = V[c, 0] - V[a, 0], V[c, 1] - V[a, 1], V[c, 2] - V[a, 2]
        squares = (ux * ux + uy * uy + uz * uz) + (vx * vx + vy * vy + vz * vz)
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        for i in (a, b, c):
            normals[i, 0] += x
            normals[i, 1] += y
            normals[i, 2] += z
            size[i] += squares


def _dual(
    V: np.ndarray, normals: np.ndarray, edges: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return c = M^-1 w_ij e_ij and d = M^-1 lambda n of the maps, M = sum_j w_ij e e^T + lambda n n^T."""
    e = V[edges[:, 1]] - V[edges[:, 0]]
    # The six entries of symmetric matrices, xx, xy, xz, yy, yz, zz.
    row, column = [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]
    products = weight[:, None] * (e[:, row] * e[:, column])
    scatter = sums_by_index(edges.ravel(), np.repeat(products, 2, axis=0), len(V))
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
