"""Cotangent Laplacians: weights of triangles and edges, and matrices in the mesh's and in the solver's order.

Functions for the solver's order need little more memory than their results. SciPy and NumPy would need ten
times as much to build a Laplacian from its entries, or to permute it.

U. Pinkall, K. Polthier, "Computing discrete minimal surfaces and their
conjugates", 1993.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from sshade.core.kernels import kernel
from sshade.core.threads import in_ranges
from sshade.mesh.incidence import sides_by_edge, sort_by_id
from sshade.mesh.mesh import Mesh

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


#: Largest number of vertices in a range, which a thread works on at a time, and smallest number of vertices
#: in each of two ranges.
CHUNK, HALF = 32_768, 3_000

#: Ranges of vertices for threads: the elements that touch the vertices, the first vertex, and the end.
Ranges = list[tuple[slice, int, int]]


def band_order(mesh: Mesh) -> np.ndarray:
    """Return (n,) int32 the vertices in reverse Cuthill-McKee order, where neighbours are near."""
    near = mesh.connectivity.neighbours
    pattern = np.ones(len(near.indices), dtype=np.int8)
    graph = csr_array((pattern, near.indices, near.indptr), shape=(mesh.n, mesh.n))
    return reverse_cuthill_mckee(graph, symmetric_mode=True)


def faces_in_order(F: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sort faces by the lowest place of their vertices; the sort is stable.

    Parameters
    ----------
    F : (m, 3) int
    place : (n,) int32
        Place of each vertex.

    Returns
    -------
    corners : (m, 3) uint32
        Places of the vertices of each sorted face.
    face : (m,) int32
        Number of each sorted face in F.
    """
    corners = place[F].astype(np.uint32)
    face = sort_by_id(np.minimum.reduce([*corners.T]), len(place))[1]
    return corners[face], face


def vertex_ranges(corners: np.ndarray, n: int) -> Ranges:
    """Divide n vertices into ranges for threads, and find the elements that touch each range.

    The ranges depend on n alone, so that results do not depend on the number of threads.

    Parameters
    ----------
    corners : (m, c) int
        Vertices of elements, which are sorted by their lowest vertices.
    n : int

    Returns
    -------
    Ranges
    """
    column = [*corners.T]  # NumPy takes twenty times as long along rows of two or three numbers
    low, high = np.minimum.reduce(column), np.maximum.accumulate(np.maximum.reduce(column))
    size = min(CHUNK, max(HALF, -(-n // 2)))
    bounds = [*range(0, n, size), n]
    return [
        (slice(int(np.searchsorted(high, first)), int(np.searchsorted(low, end))), first, end)
        for first, end in zip(bounds, bounds[1:], strict=False)
    ]


def pattern_in_order(mesh: Mesh, vertex: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return starts (n + 1,) and columns (2e + n,) int32 of a sparse matrix with an entry for each edge.

    Rows and columns are in the solver's order. Each row has its diagonal; columns ascend.
    """
    near = mesh.connectivity.neighbours
    start = np.zeros(mesh.n + 1, dtype=np.int32)
    np.cumsum(np.diff(near.indptr)[vertex] + 1, out=start[1:])
    column = np.empty(start[-1], dtype=np.int32)
    in_ranges(_rows_in_order, mesh.n, near.indptr, near.indices, vertex, place, start, column)
    return start, column


def weighted_laplacian(
    start: np.ndarray,
    column: np.ndarray,
    corners: np.ndarray,
    H: np.ndarray,
    weight: np.ndarray | None = None,
) -> csr_array:
    """Assemble the Laplacian of elements.

    Parameters
    ----------
    start, column
        From :func:`pattern_in_order`.
    corners, H
        As of :class:`sshade.solver.terms.arap.Edges` or :class:`sshade.solver.terms.arap.Triangles`.
    weight : (m,) float64, optional
        Weights of the elements; 1 if missing.
    """
    value, n = np.zeros(len(column)), len(start) - 1
    _add_weighted(start, column, corners, H, np.ones(len(corners)) if weight is None else weight, value)
    return csr_array((value, column, start), shape=(n, n))


@kernel
def _rows_in_order(first, end, indptr, indices, vertex, place, start, column):
    for i in range(first, end):
        p = begin = start[i]
        column[p] = i
        for k in range(indptr[vertex[i]], indptr[vertex[i] + 1]):
            j = place[indices[k]]
            p += 1
            q = p
            while q > begin and column[q - 1] > j:
                column[q] = column[q - 1]
                q -= 1
            column[q] = j


@kernel
def _add_weighted(start, column, corners, H, weight, value):
    """Add the Laplacian of elements, times weights (m,), to the values of a sparse matrix."""
    for t in range(len(corners)):
        for c in range(H.shape[1]):
            i, j, w = corners[t, c], corners[t, (c + 1) % corners.shape[1]], weight[t] * H[t, c]
            for p, q in ((i, j), (j, i)):
                for k in range(start[p], start[p + 1]):
                    if column[k] == q:
                        value[k] -= w
                    elif column[k] == p:
                        value[k] += w
