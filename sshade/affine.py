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

from sshade.frames import ZERO_AREA
from sshade.mesh import Mesh
from sshade.projection import Projection


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
    missing : (l,) bool
        Triangles without area in N or N'.
    """
    inverse, flat = _inverse_edge_frames(rest, F)
    frames, folded = _edge_frames(deformed, F)
    missing = flat | folded
    A = frames @ inverse
    A[missing] = 0.0
    return A, missing


def spread_means(values: np.ndarray, known: np.ndarray, *, pairs: np.ndarray) -> np.ndarray:
    """Fill unknown 3 x 3 matrices with the mean of their known neighbours', ring by ring inwards.

    Parameters
    ----------
    values : (k, 3, 3) float64
    known : (k,) bool
    pairs : (e, 2) int
        Which entries are neighbours.

    Returns
    -------
    (k, 3, 3) float64
        The identity where no known entry is connected.
    """
    if known.all():
        return values
    values, known = values.reshape(-1, 9) * known[:, None], known.copy()
    one, two = np.concatenate([pairs, pairs[:, ::-1]]).T
    while True:
        use = known[two] & ~known[one]
        ready = np.unique(one[use])
        if len(ready) == 0:
            values[~known] = np.eye(3).ravel()
            return values.reshape(-1, 3, 3)
        count = np.bincount(one[use], minlength=len(known))
        total = [np.bincount(one[use], values[two[use], c], len(known)) for c in range(9)]
        values[ready] = np.stack(total, axis=1)[ready] / count[ready, None]
        known[ready] = True


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
        """Offsets of points from the first corner of their triangle; arguments as of :meth:`decode`."""
        return V - self.proxy.V[self.proxy.F[on.face, 0]]

    def decode(
        self, local: np.ndarray, NV: np.ndarray, *, on: Projection, rotations: np.ndarray | None = None
    ) -> tuple[np.ndarray, int]:
        """Points on a deformed proxy; see :class:`sshade.frames.Frames`.

        A triangle without area takes the mean map of its edge neighbours.
        """
        F = self.proxy.F
        A, missing = affine_maps(self.proxy.V, NV, F=F)
        if missing.any():
            A = spread_means(A, ~missing, pairs=_beside(F))
        return _carry(local, on.face, A, NV[F[:, 0]]), int(missing.sum())


def _beside(F: np.ndarray) -> np.ndarray:
    """(e, 2) pairs of triangles that share an edge."""
    import igl

    neighbours = np.asarray(igl.triangle_triangle_adjacency(np.array(F))[0])
    pairs = np.stack([np.repeat(np.arange(len(F)), 3), neighbours.ravel()], axis=1)
    return pairs[pairs[:, 0] < pairs[:, 1]]


def _edge_frames(V: np.ndarray, F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(l, 3, 3) matrices [e1 e2 n] with columns e1, e2, n, and where n does not exist (zero there)."""
    e1, e2 = V[F[:, 1]] - V[F[:, 0]], V[F[:, 2]] - V[F[:, 0]]
    normal = np.cross(e1, e2)
    doubled = np.linalg.norm(normal, axis=1)
    longest = np.max([(e1**2).sum(axis=1), (e2**2).sum(axis=1), ((e1 - e2) ** 2).sum(axis=1)], axis=0)
    missing = doubled <= ZERO_AREA * longest
    normal = np.divide(normal, doubled[:, None], out=np.zeros_like(normal), where=~missing[:, None])
    return np.stack([e1, e2, normal], axis=2), missing


def _inverse_edge_frames(V: np.ndarray, F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(l, 3, 3) inverses of [e1 e2 n], zero for triangles without area, and which those are."""
    frames, missing = _edge_frames(V, F)
    e1, e2, n = frames.transpose(2, 0, 1)
    rows = np.stack([np.cross(e2, n), np.cross(n, e1)], axis=1)
    doubled = np.linalg.norm(np.cross(e1, e2), axis=1)[:, None, None]
    rows = np.divide(rows, doubled, out=np.zeros_like(rows), where=~missing[:, None, None])
    return np.concatenate([rows, n[:, None]], axis=1), missing


@njit(cache=True, nogil=True)
def _carry(local, face, A, origin):
    V = np.empty_like(local)
    for i in range(len(local)):
        t = face[i]
        x, y, z = local[i, 0], local[i, 1], local[i, 2]
        for r in range(3):
            V[i, r] = origin[t, r] + A[t, r, 0] * x + A[t, r, 1] * y + A[t, r, 2] * z
    return V
