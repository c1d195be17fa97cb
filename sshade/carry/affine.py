"""Affine maps of triangles: a frame that stretches with its triangle, in the place of one that only turns.

A triangle with edges e1, e2 and unit normal n, deformed to e1', e2', n', defines
the affine map A = [e1' e2' n'] [e1 e2 n]^-1. In the plane it is what linear
interpolation of the corners does, so neighbouring triangles agree along their
edge; across it only the normals differ.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from sshade.carry.frames import ZERO_AREA
from sshade.carry.projection import Projection
from sshade.carry.vertex_maps import spread_means
from sshade.mesh.mesh import Mesh


@dataclass(frozen=True, eq=False)
class AffineFrames:
    """Points carried by the affine maps of their triangles.

    An ablation: continuous in the plane of the proxy, but the normals jump.

    Parameters
    ----------
    proxy : Mesh
        N at rest.
    """

    proxy: Mesh

    def encode(self, V: np.ndarray, on: Projection) -> np.ndarray:
        """Offsets from the first corner of a point's triangle; see :class:`sshade.carry.frames.Frames`."""
        return V - self.proxy.V[self.proxy.F[on.face, 0]]

    def decode(
        self, local: np.ndarray, NV: np.ndarray, *, on: Projection, rotations: np.ndarray | None = None
    ) -> tuple[np.ndarray, int]:
        """Points on a deformed proxy; see :class:`sshade.carry.frames.Frames`.

        A triangle without area takes the mean map of its edge neighbours.
        """
        F = self.proxy.F
        A, known = affine_maps(self.proxy.V, NV, F=F)
        if not known.all():
            A = spread_means(A, known, pairs=adjacent_triangles(F))
        return _decode(local, on.face, A, NV, F), int((~known).sum())


def affine_maps(rest: np.ndarray, deformed: np.ndarray, *, F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The linear part A of each triangle's affine map.

    Parameters
    ----------
    rest, deformed : (k, 3) float64
        Vertices of N and N'.
    F : (l, 3) int

    Returns
    -------
    A : (l, 3, 3) float64
        Zero where there is none.
    known : (l,) bool
        False for triangles without area in N or N'.
    """
    return _maps(rest, deformed, F)


def adjacent_triangles(F: np.ndarray) -> np.ndarray:
    """(p, 2) pairs of triangles that share an edge; F (l, 3) must be manifold."""
    import igl

    beside = np.asarray(igl.triangle_triangle_adjacency(np.array(F))[0])
    pairs = np.stack([np.repeat(np.arange(len(F)), 3), beside.ravel()], axis=1)
    return pairs[pairs[:, 0] < pairs[:, 1]]


@njit(cache=True, nogil=True)
def _edges_and_normal(V, a, b, c, E):
    """Write e1, e2 and n to the rows of E; return the doubled area, 0 where there is no normal."""
    longest = 0.0
    for r in range(3):
        E[0, r], E[1, r] = V[b, r] - V[a, r], V[c, r] - V[a, r]
    for r in range(3):
        p, q = (r + 1) % 3, (r + 2) % 3
        E[2, r] = E[0, p] * E[1, q] - E[0, q] * E[1, p]
        longest += E[0, r] ** 2 + E[1, r] ** 2
    doubled = np.sqrt(E[2, 0] ** 2 + E[2, 1] ** 2 + E[2, 2] ** 2)
    if doubled <= ZERO_AREA * longest:
        return 0.0
    for r in range(3):
        E[2, r] /= doubled
    return doubled


@njit(cache=True, nogil=True)
def _maps(rest, deformed, F):
    A, known = np.zeros((len(F), 3, 3)), np.ones(len(F), dtype=np.bool_)
    E, D = np.empty((3, 3)), np.empty((3, 3))
    for t in range(len(F)):
        a, b, c = F[t, 0], F[t, 1], F[t, 2]
        area = _edges_and_normal(rest, a, b, c, E)
        if area == 0.0 or _edges_and_normal(deformed, a, b, c, D) == 0.0:
            known[t] = False
            continue
        for s in range(3):
            p, q = (s + 1) % 3, (s + 2) % 3
            # Rows of the inverse of [e1 e2 n]: e2 x n and n x e1 over the area, and n.
            first = (E[1, p] * E[2, q] - E[1, q] * E[2, p]) / area
            second = (E[2, p] * E[0, q] - E[2, q] * E[0, p]) / area
            for r in range(3):
                A[t, r, s] = D[0, r] * first + D[1, r] * second + D[2, r] * E[2, s]
    return A, known


@njit(cache=True, nogil=True)
def _decode(local, face, A, NV, F):
    V = np.empty_like(local)
    for i in range(len(local)):
        t = face[i]
        a = F[t, 0]
        x, y, z = local[i, 0], local[i, 1], local[i, 2]
        for r in range(3):
            V[i, r] = NV[a, r] + A[t, r, 0] * x + A[t, r, 1] * y + A[t, r, 2] * z
    return V
