"""Marching tetrahedra: a closed manifold at the zero level of a function on a lattice."""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations

import numpy as np

#: Smallest distance of a vertex from the ends of its lattice edge, as a fraction of the edge.
END = 0.05


def marching_tetrahedra(
    level: Callable[[np.ndarray], np.ndarray], low: np.ndarray, high: np.ndarray, *, step: float
) -> tuple[np.ndarray, np.ndarray]:
    """Triangulate the surface where a function changes its sign.

    Each lattice cell is divided into six tetrahedra about its diagonal.

    Parameters
    ----------
    level : callable
        Values (k,) at points (k, 3), negative inside.
    low, high : (3,) float64
        Corners of a box that contains the surface.
    step : float
        Side of a lattice cell.

    Returns
    -------
    (n, 3) float64, (m, 3) int64
    """
    axes = [np.arange(a, b + step, step) for a, b in zip(low, high, strict=True)]
    sheets = [np.stack(np.meshgrid([x], *axes[1:], indexing="ij"), axis=-1).reshape(-1, 3) for x in axes[0]]
    points = np.concatenate(sheets)
    value = np.concatenate([level(sheet) for sheet in sheets])
    value = np.where(value == 0.0, 1e-12 * step, value)
    ids = np.arange(len(points)).reshape([len(axis) for axis in axes])
    corner = ids[:-1, :-1, :-1].ravel()
    strides = np.array([ids[1, 0, 0], ids[0, 1, 0], ids[0, 0, 1]])
    tetrahedra = np.concatenate(
        [corner[:, None] + np.concatenate([[0], np.cumsum(strides[list(p)])]) for p in permutations(range(3))]
    )
    inside = value[tetrahedra] < 0
    count = inside.sum(axis=1)
    # Corners of each tetrahedron, those inside first.
    tetrahedra = np.take_along_axis(tetrahedra, np.argsort(~inside, axis=1, kind="stable"), axis=1)
    edges = [_cut(tetrahedra[count == 1], ((0, 1), (0, 2), (0, 3)))]
    edges.append(_cut(tetrahedra[count == 3], ((0, 3), (1, 3), (2, 3))))
    two = tetrahedra[count == 2]
    edges += [_cut(two, ((0, 2), (0, 3), (1, 3))), _cut(two, ((0, 2), (1, 3), (1, 2)))]
    triangles = np.concatenate(edges)  # (m, 3, 2): an inner and an outer corner of each vertex
    keys, F = np.unique(triangles.reshape(-1, 2), axis=0, return_inverse=True)
    F = F.reshape(-1, 3)
    a, b = value[keys[:, 0]], value[keys[:, 1]]
    t = np.clip(a / (a - b), END, 1.0 - END)[:, None]
    V = (1.0 - t) * points[keys[:, 0]] + t * points[keys[:, 1]]
    outward = (points[triangles[:, :, 1]] - points[triangles[:, :, 0]]).sum(axis=1)
    normal = np.cross(V[F[:, 1]] - V[F[:, 0]], V[F[:, 2]] - V[F[:, 0]])
    flipped = (normal * outward).sum(axis=1) < 0
    return V, np.where(flipped[:, None], F[:, ::-1], F)


def _cut(tetrahedra: np.ndarray, ends: tuple[tuple[int, int], ...]) -> np.ndarray:
    """Lattice edges (k, 3, 2) of one triangle in each tetrahedron."""
    return tetrahedra[:, np.array(ends)]
