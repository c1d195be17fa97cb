"""Cotangent weights: per triangle, per edge, and as a Laplacian matrix.

U. Pinkall, K. Polthier, "Computing discrete minimal surfaces and their
conjugates", 1993.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array

from sshade.errors import InputError
from sshade.mesh.mesh import Mesh


def half_cotangents(mesh: Mesh) -> np.ndarray:
    """Half the cotangent of the angle opposite each triangle's edges 01, 12, 20.

    Returns
    -------
    (m, 3) float64

    Raises
    ------
    InputError
        When triangles have no area.
    """
    double_area = 2.0 * mesh.face_areas
    A, B, C = (mesh.V[mesh.F[:, c]] for c in range(3))
    dots = np.stack(
        [((p - r) * (q - r)).sum(axis=1) for p, q, r in ((A, B, C), (B, C, A), (C, A, B))], axis=1
    )
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        h = 0.5 * dots / double_area[:, None]
    bad = int((~np.isfinite(h)).any(axis=1).sum())
    if bad:
        raise InputError(
            f"{bad} triangles of the rest mesh have no area, so their cotangent weights are infinite; "
            "remesh or remove them"
        )
    return h


def edge_weights(mesh: Mesh, h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sum the half cotangents of the triangles at each undirected edge.

    Parameters
    ----------
    mesh : Mesh
    h : (m, 3) float64
        From :func:`half_cotangents`.

    Returns
    -------
    edges : (e, 2) int64
    weights : (e,) float64
        ``(cot a + cot b) / 2`` inside, ``cot a / 2`` on the boundary; negative
        where opposite angles add up to more than 180 degrees.
    """
    return mesh.edges, np.bincount(mesh.face_edges.ravel(), h.ravel())


def corner_vectors(mesh: Mesh, h: np.ndarray) -> np.ndarray:
    """Sum h_kl (p_k - p_l) over the two edges kl at each corner k of each triangle.

    Returns
    -------
    (m, 2, 3) float64
        For the first two corners; the third is minus their sum.
    """
    A, B, C = (mesh.V[mesh.F[:, c]] for c in range(3))
    first = h[:, :1] * (A - B) + h[:, 2:] * (A - C)
    second = h[:, :1] * (B - A) + h[:, 1:2] * (B - C)
    return np.stack([first, second], axis=1)


def laplacian_matrix(n: int, edges: np.ndarray, weights: np.ndarray) -> csr_array:
    """Positive semi-definite Laplacian: ``L_ij = -w_ij``, ``L_ii = sum_j w_ij``.

    Parameters
    ----------
    n : int
        Number of vertices.
    edges, weights
        From :func:`edge_weights`.

    Returns
    -------
    (n, n) sparse float64
    """
    i, j = edges[:, 0], edges[:, 1]
    rows, columns = np.concatenate([i, j, i, j]), np.concatenate([j, i, i, j])
    values = np.concatenate([-weights, -weights, weights, weights])
    return coo_array((values, (rows, columns)), shape=(n, n)).tocsr()
