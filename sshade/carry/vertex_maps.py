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
from numba import njit

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
        return cls(mesh.F, edges, *_dual(mesh.V, _normals(mesh.V, mesh.F, ZERO_AREA), edges, weight))

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
        A = _maps(V, _normals(V, self.F, ZERO_AREA), self.edges, self.c, self.d)
        known = _has_two_dimensions(A)
        return fill_from_neighbours(A.reshape(-1, 3, 3), known, pairs=self.edges), known


@njit(cache=True, nogil=True)
def _normals(V, F, zero_area):
    """(k, 3) unit normals at the vertices, by area; zero where they cancel."""
    N = np.zeros((len(V), 4))
    for t in range(len(F)):
        a, b, c = F[t, 0], F[t, 1], F[t, 2]
        ex, ey, ez = V[b, 0] - V[a, 0], V[b, 1] - V[a, 1], V[b, 2] - V[a, 2]
        fx, fy, fz = V[c, 0] - V[a, 0], V[c, 1] - V[a, 1], V[c, 2] - V[a, 2]
        x, y, z = ey * fz - ez * fy, ez * fx - ex * fz, ex * fy - ey * fx
        size = ex * ex + ey * ey + ez * ez + fx * fx + fy * fy + fz * fz
        for i in (a, b, c):
            N[i, 0] += x
            N[i, 1] += y
            N[i, 2] += z
            N[i, 3] += size
    for i in range(len(V)):
        length = np.sqrt(N[i, 0] ** 2 + N[i, 1] ** 2 + N[i, 2] ** 2)
        inverse = 1.0 / length if length > zero_area * N[i, 3] else 0.0
        for r in range(3):
            N[i, r] *= inverse
    return N[:, :3]


@njit(cache=True, nogil=True)
def _dual(V, normals, edges, weight):
    """c and d of :class:`VertexMaps`."""
    scatter = np.zeros((len(V), 6))
    for p in range(len(edges)):
        i, j, w = edges[p, 0], edges[p, 1], weight[p]
        x, y, z = V[j, 0] - V[i, 0], V[j, 1] - V[i, 1], V[j, 2] - V[i, 2]
        for r, product in enumerate((x * x, x * y, x * z, y * y, y * z, z * z)):
            scatter[i, r] += w * product
            scatter[j, r] += w * product
    d = np.empty((len(V), 3))
    for i in range(len(V)):
        G, (x, y, z) = scatter[i], normals[i]
        trace = G[0] + G[3] + G[5]
        half = 0.5 * trace
        xx, xy, xz = G[0] + half * x * x, G[1] + half * x * y, G[2] + half * x * z
        yy, yz, zz = G[3] + half * y * y, G[4] + half * y * z, G[5] + half * z * z
        G[0], G[1], G[2] = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
        G[3], G[4], G[5] = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
        determinant = xx * G[0] + xy * G[1] + xz * G[2]
        inverse = 1.0 / determinant if determinant > FLATTEST * trace**3 else 0.0
        for r in range(6):
            G[r] *= inverse
        d[i, 0], d[i, 1], d[i, 2] = _product(G, half * x, half * y, half * z)
    c = np.empty((len(edges), 2, 3))
    for p in range(len(edges)):
        i, j, w = edges[p, 0], edges[p, 1], weight[p]
        x, y, z = w * (V[j, 0] - V[i, 0]), w * (V[j, 1] - V[i, 1]), w * (V[j, 2] - V[i, 2])
        c[p, 0, 0], c[p, 0, 1], c[p, 0, 2] = _product(scatter[i], x, y, z)
        c[p, 1, 0], c[p, 1, 1], c[p, 1, 2] = _product(scatter[j], -x, -y, -z)
    return c, d


@njit(cache=True, nogil=True)
def _product(G, x, y, z):
    """A symmetric matrix (xx, xy, xz, yy, yz, zz) times a vector."""
    return G[0] * x + G[1] * y + G[2] * z, G[1] * x + G[3] * y + G[4] * z, G[2] * x + G[4] * y + G[5] * z


@njit(cache=True, nogil=True)
def _maps(V, normals, edges, c, d):
    A = np.zeros((len(V), 9))
    for i in range(len(V)):
        for r in range(3):
            for s in range(3):
                A[i, 3 * r + s] = normals[i, r] * d[i, s]
    for p in range(len(edges)):
        i, j = edges[p, 0], edges[p, 1]
        for r in range(3):
            e = V[j, r] - V[i, r]
            for s in range(3):
                A[i, 3 * r + s] += e * c[p, 0, s]
                A[j, 3 * r + s] -= e * c[p, 1, s]
    return A


@njit(cache=True, nogil=True)
def _has_two_dimensions(A):
    """(k,) bool: the cofactors, which are the areas that a map makes, are not all lost in rounding."""
    result = np.empty(len(A), dtype=np.bool_)
    for i in range(len(A)):
        entries, cofactors = 0.0, 0.0
        for r in range(3):
            p, q = 3 * ((r + 1) % 3), 3 * ((r + 2) % 3)
            for s in range(3):
                t, u = (s + 1) % 3, (s + 2) % 3
                entries += A[i, 3 * r + s] ** 2
                cofactors += (A[i, p + t] * A[i, q + u] - A[i, p + u] * A[i, q + t]) ** 2
        result[i] = np.sqrt(cofactors) > RANK_ONE * entries
    return result
