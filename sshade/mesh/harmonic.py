"""Harmonic functions on the vertices of a mesh: smooth interpolation of values known at some vertices."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, diags_array

from sshade.mesh.adjacency import VertexGraph
from sshade.mesh.conjugate_gradients import conjugate_gradients

#: Edges shorter than this fraction of the mean length get the weight of an edge of this length.
SHORT = 0.1
#: Relative residual at which conjugate gradients stop.
TOLERANCE = 1e-6


def harmonic(graph: VertexGraph, free: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return values at free vertices such that each is the weighted mean of its neighbours' values.

    The weight of an edge is 1 / length. Up to :data:`TOLERANCE`, the results lie between the least and
    the largest known value.

    Parameters
    ----------
    graph : VertexGraph
        A path must lead from each free vertex to a vertex with known values.
    free : (f,) int
        Vertices whose values are computed.
    values : (n, d) float64
        Known values at the other vertices; rows of free vertices are ignored.

    Returns
    -------
    (f, d) float64
    """
    weight = 1.0 / np.maximum(graph.lengths, SHORT * graph.lengths.mean())
    rows = csr_array((weight, graph.indices, graph.indptr), shape=(graph.n, graph.n))[free]
    degree = rows.sum(axis=1)
    known = values.copy()
    known[free] = 0.0
    laplacian = diags_array(degree, format="csr") - rows[:, free]
    B, diagonal = rows @ known, degree[:, None]
    limit = TOLERANCE**2 * _product(B, B)
    return conjugate_gradients(
        B,
        B / diagonal,
        times=lambda P, Q: np.copyto(Q, laplacian @ P),
        precondition=lambda R, Q: np.divide(R, diagonal, out=Q),
        converged=lambda R, now, start: bool((_product(R, R) <= limit).all()),
        product=_product,
        most_steps=10 * len(B),
    )


def _product(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    # No BLAS: its threads change the last digits, and wait for each other on a busy machine.
    return np.einsum("ic,ic->c", one, other)
