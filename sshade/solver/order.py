"""The solver's order of vertices: triangles, ranges for threads and sparse matrices in that order.

Functions here need little more memory than their results. SciPy and NumPy would need ten times as much to
build a Laplacian from its entries, or to permute it.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from sshade.core.kernels import kernel
from sshade.core.threads import in_ranges
from sshade.mesh.mesh import Mesh
from sshade.mesh.sides import sort_by_id

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
