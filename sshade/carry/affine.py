"""Affine maps of triangles: frames that stretch with their triangle, where rigid ones only turn.

A triangle with first corner a, edges e1, e2 and unit normal n, deformed to a', e1', e2', n',
defines the affine map with the linear part A = [e1' e2' n'] [e1 e2 n]^-1:

    x' = a' + A (x - a) .

In the triangle's plane that is linear interpolation of the corners, so neighbouring triangles
agree along their edge; off the plane their normals differ, and x' jumps. An ablation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from sshade.carry.frames import ZERO_AREA
from sshade.carry.neighbours import adjacent_triangles, fill_from_neighbours
from sshade.carry.projection import Projection
from sshade.mesh.mesh import Mesh


@dataclass(frozen=True, eq=False)
class AffineFrames:
    """Frames that follow the affine maps of a proxy's triangles.

    Parameters
    ----------
    proxy : Mesh
        N at rest.
    """

    name: ClassVar[str] = "affine"

    proxy: Mesh

    def encode(self, V: np.ndarray, on: Projection) -> np.ndarray:
        """Offsets x - a from the triangle's first corner; see :class:`sshade.carry.frames.Frames`."""
        return V - self.proxy.V[self.proxy.F[on.face, 0]]

    def decode(
        self, local: np.ndarray, NV: np.ndarray, *, on: Projection, rotations: np.ndarray | None = None
    ) -> tuple[np.ndarray, int]:
        """Points a' + A (x - a); see :class:`sshade.carry.frames.Frames`.

        A triangle without area takes the mean A of its edge neighbours.
        """
        F = self.proxy.F
        A, known = affine_maps(self.proxy.V, NV, F=F)
        if not known.all():
            A = fill_from_neighbours(A, known, pairs=adjacent_triangles(F))
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
    return _maps(rest, deformed, F, ZERO_AREA)


@njit(cache=True, nogil=True)
def _edges_and_normal(V, a, b, c, E, zero_area):
    """Write e1, e2 and n to the rows of E; return the doubled area, 0 where there is no normal."""
    longest = 0.0
    for r in range(3):
        E[0, r], E[1, r] = V[b, r] - V[a, r], V[c, r] - V[a, r]
    for r in range(3):
        p, q = (r + 1) % 3, (r + 2) % 3
        E[2, r] = E[0, p] * E[1, q] - E[0, q] * E[1, p]
        longest += E[0, r] ** 2 + E[1, r] ** 2
    doubled = np.sqrt(E[2, 0] ** 2 + E[2, 1] ** 2 + E[2, 2] ** 2)
    if doubled <= zero_area * longest:
        return 0.0
    for r in range(3):
        E[2, r] /= doubled
    return doubled


@njit(cache=True, nogil=True)
def _maps(rest, deformed, F, zero_area):
    A, known = np.zeros((len(F), 3, 3)), np.ones(len(F), dtype=np.bool_)
    E, D = np.empty((3, 3)), np.empty((3, 3))
    for t in range(len(F)):
        a, b, c = F[t, 0], F[t, 1], F[t, 2]
        area = _edges_and_normal(rest, a, b, c, E, zero_area)
        if area == 0.0 or _edges_and_normal(deformed, a, b, c, D, zero_area) == 0.0:
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
