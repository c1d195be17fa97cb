"""Cotangent weights: per triangle, per edge, and as a Laplacian matrix.

U. Pinkall, K. Polthier, "Computing discrete minimal surfaces and their
conjugates", 1993.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array

from sshade.core.kernels import kernel
from sshade.core.threads import in_ranges
from sshade.mesh.mesh import Mesh
from sshade.mesh.sides import sides_by_edge

#: Least slack in the triangle inequalities of a zero-area triangle after its edges are lengthened, as a
#: fraction of the mesh's mean edge or of the triangle's longest edge, whichever is longer.
SLACK = 1e-5
#: Size of a triangle whose corners coincide at rest, as a fraction of the diagonal. Strains are relative to
#: it; any positive number would do.
POINT = 1e-10


def half_cotangents(mesh: Mesh) -> np.ndarray:
    """Compute half the cotangent of the angle opposite each triangle's edges 01, 12, 20.

    The edges of a zero-area triangle (:attr:`sshade.mesh.mesh.Mesh.without_area`) are first lengthened by
    the least equal amount that gives its triangle inequalities a slack of :data:`SLACK`. Cotangents
    are then at most 1 / (2 SLACK) + 1, and the quadratic form of the triangle stays positive. Other
    triangles are not changed.

    Returns
    -------
    (m, 3) float64
        Finite.

    References
    ----------
    N. Sharp, K. Crane, "A Laplacian for nonmanifold triangle meshes", SGP 2020 (intrinsic mollification of
    all triangles by one length).
    """
    flat, h = mesh.without_area, np.empty((mesh.m, 3))
    in_ranges(_half_cotangents, mesh.m, mesh.V, mesh.F, mesh.face_areas, h)
    if flat.any():
        h[flat] = _mollified(np.linalg.norm(_sides(mesh, flat), axis=2), mesh.mean_edge)
    return h


def _sides(mesh: Mesh, faces: np.ndarray) -> np.ndarray:
    """(k, 3, 3) vectors along the edges 01, 12, 20 of some faces."""
    corners = mesh.V[mesh.F[faces]]
    return corners - np.roll(corners, -1, axis=1)


def _mollified(lengths: np.ndarray, mean: float) -> np.ndarray:
    """Lengthen edges of lengths (k, 3), and compute their half cotangents; see :func:`half_cotangents`."""
    longest = lengths.max(axis=1)
    wanted = SLACK * np.maximum(longest, mean)
    slack = lengths.sum(axis=1) - 2.0 * longest
    lengths = lengths + np.maximum(wanted - slack, 0.0)[:, None]
    # Heron's formula in W. Kahan's order, which loses no digits; c - (a - b) is the slack.
    c, b, a = np.sort(lengths, axis=1).T
    double_area = 0.5 * np.sqrt((a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c)))
    squared = lengths**2
    return (squared.sum(axis=1)[:, None] - 2.0 * squared) / (4.0 * double_area[:, None])


def rest_energies(mesh: Mesh, h: np.ndarray) -> np.ndarray:
    """Compute the spokes-and-rims energy of each triangle shrunk to a point.

    Parameters
    ----------
    mesh : Mesh
    h : (m, 3) float64
        From :func:`half_cotangents`.

    Returns
    -------
    (m,) float64
        Six times the area, or 3 sum h |e|^2 for zero-area triangles; positive, unit length^2.
    """
    rest, flat = 6.0 * mesh.face_areas, mesh.without_area
    if flat.any():
        squared = (_sides(mesh, flat) ** 2).sum(axis=2)
        rest[flat] = np.maximum(3.0 * (h[flat] * squared).sum(axis=1), (POINT * mesh.diagonal) ** 2)
    return rest


def edge_weights(mesh: Mesh, h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sum the half cotangents of the triangles at each undirected edge.

    Parameters
    ----------
    mesh : Mesh
    h : (m, 3) float64
        From :func:`half_cotangents`.

    Returns
    -------
    edges : (e, 2) int32
        :attr:`sshade.mesh.mesh.Mesh.edges`.
    weights : (e,) float64
        ``(cot a + cot b) / 2`` inside, ``cot a / 2`` on the boundary; negative if the opposite angles add up
        to more than 180 degrees.
    """
    sides = sides_by_edge(mesh.F, mesh.n)
    return sides.ends, np.add.reduceat(h.ravel()[sides.side], sides.start[:-1])


def laplacian_matrix(n: int, edges: np.ndarray, weights: np.ndarray) -> csr_array:
    """Assemble the positive semi-definite Laplacian: ``L_ij = -w_ij``, ``L_ii = sum_j w_ij``.

    Parameters
    ----------
    n : int
        Number of vertices.
    edges, weights
        From :func:`edge_weights`.

    Returns
    -------
    (n, n) sparse float64, indices int32
    """
    i, j = edges.astype(np.int32, copy=False).T
    rows, columns = np.concatenate([i, j, i, j]), np.concatenate([j, i, i, j])
    values = np.concatenate([-weights, -weights, weights, weights])
    return coo_array((values, (rows, columns)), shape=(n, n)).tocsr()


@kernel(error_model="numpy")
def _half_cotangents(first, end, V, F, area, h):
    for t in range(first, end):
        for c in range(3):
            i, j, k = F[t, c], F[t, (c + 1) % 3], F[t, (c + 2) % 3]
            dot = (
                (V[i, 0] - V[k, 0]) * (V[j, 0] - V[k, 0])
                + (V[i, 1] - V[k, 1]) * (V[j, 1] - V[k, 1])
                + (V[i, 2] - V[k, 2]) * (V[j, 2] - V[k, 2])
            )
            h[t, c] = 0.25 * dot / area[t]
