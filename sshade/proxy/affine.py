"""Affine frames of triangles, an ablation: they stretch with the triangle, where rigid frames only turn.

A triangle with first corner a, edges e1, e2 and unit normal n, deformed to a', e1', e2', n', defines an
affine map with the linear part A = [e1' e2' n'] [e1 e2 n]^-1:

    x' = a' + A (x - a) .

In the plane of the triangle the map interpolates the corners linearly, so that neighbouring triangles agree
along their edge. Off the plane their normals differ, and x' jumps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sshade.core.threads import ThreadTeam
from sshade.mesh.mesh import Mesh
from sshade.proxy.frames import Frames, Placer, edges_and_normals, on_triangles
from sshade.proxy.neighbours import adjacent_triangles, fill_from_neighbours
from sshade.proxy.projection import Projection


@dataclass(frozen=True, eq=False)
class AffineFrames(Frames):
    """Frames that follow the affine maps of a proxy's triangles.

    A triangle without area gets the mean A of its edge neighbours.

    Parameters
    ----------
    proxy : Mesh
        N at rest.
    """

    name: ClassVar[str] = "affine"  # type: ignore[misc]

    proxy: Mesh

    def encode(self, V: np.ndarray, on: Projection) -> np.ndarray:
        """Return the offsets x - a from the first corners; see :class:`sshade.proxy.frames.Frames`."""
        return V - self.proxy.V[self.proxy.F[on.face, 0]]

    def posed(self, NV: np.ndarray, rotations: np.ndarray | None, team: ThreadTeam) -> tuple[Placer, int]:
        """Place points at a' + A (x - a); see :class:`sshade.proxy.frames.Frames`."""
        F = self.proxy.F
        A, known = affine_maps(self.proxy.V, NV, F=F)
        if not known.all():
            A = fill_from_neighbours(A, known, pairs=adjacent_triangles(F))
        return on_triangles(A, NV[F[:, 0]]), int((~known).sum())


def affine_maps(rest: np.ndarray, deformed: np.ndarray, *, F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the linear part A of the affine map of each triangle.

    Parameters
    ----------
    rest, deformed : (k, 3) float64
        Vertices of N and N'.
    F : (l, 3) int
        Triangles.

    Returns
    -------
    A : (l, 3, 3) float64
        Zero where undefined.
    known : (l,) bool
        False for triangles without area in N or N'.
    """
    e1, e2, n, doubled = edges_and_normals(rest, F)
    d1, d2, m, deformed_doubled = edges_and_normals(deformed, F)
    known = (doubled > 0) & (deformed_doubled > 0)
    doubled = np.where(known, doubled, 1.0)
    # Rows of the inverse of [e1 e2 n]: e2 x n and n x e1 over the doubled area, and n.
    rows = (np.cross(e2, n) / doubled[:, None], np.cross(n, e1) / doubled[:, None], n)
    A = sum(d[:, :, None] * row[:, None] for d, row in zip((d1, d2, m), rows, strict=True))
    A[~known] = 0.0
    return A, known
