"""Detail: whether the relief of the surface turns with the surface."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array

from eval.metrics.geometry import corner_angles
from eval.metrics.registry import Task, metric

#: Cotangents are cut off at those of angles this near to 0 and to 180 degrees.
SMALLEST_ANGLE = np.radians(0.1)


@metric("deg", "mean angle between the Laplacian coordinates and the turned rest ones, by area x length")
def detail(task: Task, vertices: np.ndarray) -> float:
    """Mean angle between the Laplacian coordinates of M' and those of M turned with the vertex, in degrees.

    The coordinate of a vertex i is ``d_i = sum_j w_ij (v_i - v_j)`` with the
    cotangent weights of M; it is turned by the rotation that best carries the
    edges at i from M to M' (those weights, Kabsch). The mean is weighted by the
    area of the vertex times the length of d_i: where the surface is flat there is
    no detail to lose. On a boundary d_i runs along the surface, so that vertices
    there do not count. NaN where no vertex counts.
    """
    mesh = task.mesh
    i, j, w = _weights(mesh.V, mesh.F)
    rest, deformed = mesh.V[i] - mesh.V[j], vertices[i] - vertices[j]
    d = _sums(i, w[:, None] * rest, mesh.n)
    d_deformed = _sums(i, w[:, None] * deformed, mesh.n)
    # A negative weight would pull the rotation away from its edge.
    S = _sums(i, (np.abs(w)[:, None, None] * deformed[:, :, None] * rest[:, None, :]).reshape(-1, 9), mesh.n)
    U, _, Vt = np.linalg.svd(S.reshape(-1, 3, 3))
    U[:, :, 2] *= np.linalg.det(U @ Vt)[:, None]
    turned = np.einsum("nij,nj->ni", U @ Vt, d)
    angle = np.arctan2(
        np.linalg.norm(np.cross(turned, d_deformed), axis=1), np.einsum("ij,ij->i", turned, d_deformed)
    )
    area = np.bincount(mesh.F.ravel(), np.repeat(mesh.face_areas / 3, 3), minlength=mesh.n)
    weight = area * np.linalg.norm(d, axis=1)
    # Rounding leaves a coordinate of some 1e-16 edges where the surface is flat.
    weight[np.linalg.norm(d, axis=1) < 1e-12 * mesh.diagonal] = 0.0
    weight[mesh.boundary_edges.ravel()] = 0.0
    return float(np.degrees((weight * angle).sum() / weight.sum())) if weight.any() else np.nan


def _weights(V: np.ndarray, F: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Both directions (i, j) of each edge, and half the sum of the cotangents opposite to it."""
    angle = np.clip(corner_angles(V, F), SMALLEST_ANGLE, np.pi - SMALLEST_ANGLE)
    half = 0.5 / np.tan(angle)
    i, j = F[:, [1, 2, 0]].ravel(), F[:, [2, 0, 1]].ravel()
    w, n = half.ravel(), len(V)
    matrix = coo_array((np.r_[w, w], (np.r_[i, j], np.r_[j, i])), shape=(n, n)).tocsr().tocoo()
    return matrix.row, matrix.col, matrix.data


def _sums(index: np.ndarray, values: np.ndarray, n: int) -> np.ndarray:
    """(n, c) sums of the rows of `values` (k, c) by `index` (k,)."""
    return np.stack([np.bincount(index, column, minlength=n) for column in values.T], axis=1)
