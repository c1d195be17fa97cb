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

from sshade.carry.frames import ZERO_AREA, in_rows
from sshade.carry.neighbours import adjacent_triangles, fill_from_neighbours
from sshade.carry.projection import Projection
from sshade.mesh.mesh import Mesh
from sshade.threads import ThreadTeam


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
        self,
        local: np.ndarray,
        NV: np.ndarray,
        *,
        on: Projection,
        rotations: np.ndarray | None = None,
        team: ThreadTeam | None = None,
        out: np.ndarray | None = None,
    ) -> tuple[np.ndarray, int]:
        """Points a' + A (x - a); see :class:`sshade.carry.frames.Frames`.

        A triangle without area takes the mean A of its edge neighbours.
        """
        F = self.proxy.F
        A, known = affine_maps(self.proxy.V, NV, F=F)
        if not known.all():
            A = fill_from_neighbours(A, known, pairs=adjacent_triangles(F))
        given = local, on.face, A, NV, F
        V = in_rows(lambda first, end, V: _decode(first, end, *given, V), len(local), team, out)
        return V, int((~known).sum())


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
    e1, e2, n, doubled = _edges_and_normals(rest, F)
    d1, d2, m, deformed_doubled = _edges_and_normals(deformed, F)
    known = (doubled > 0) & (deformed_doubled > 0)
    doubled = np.where(known, doubled, 1.0)
    # Rows of the inverse of [e1 e2 n]: e2 x n and n x e1 over the doubled area, and n.
    rows = (np.cross(e2, n) / doubled[:, None], np.cross(n, e1) / doubled[:, None], n)
    A = sum(d[:, :, None] * row[:, None] for d, row in zip((d1, d2, m), rows, strict=True))
    A[~known] = 0.0
    return A, known


def _edges_and_normals(V: np.ndarray, F: np.ndarray) -> tuple[np.ndarray, ...]:
    """(l, 3) e1, e2 and n of triangles, and (l,) doubled areas; n and that are 0 where there is no normal."""
    a, b, c = (V[F[:, corner]] for corner in range(3))
    e1, e2 = b - a, c - a
    n = np.cross(e1, e2)
    doubled = np.linalg.norm(n, axis=1)
    doubled[doubled <= ZERO_AREA * ((e1**2).sum(axis=1) + (e2**2).sum(axis=1))] = 0.0
    return e1, e2, np.divide(n, doubled[:, None], out=np.zeros_like(n), where=doubled[:, None] > 0), doubled


@njit(cache=True, nogil=True)
def _decode(first, end, local, face, A, NV, F, V):
    for i in range(first, end):
        t = face[i]
        a = F[t, 0]
        x, y, z = local[i, 0], local[i, 1], local[i, 2]
        for r in range(3):
            V[i, r] = NV[a, r] + A[t, r, 0] * x + A[t, r, 1] * y + A[t, r, 2] * z
