"""Harmonic functions agree with a direct solve."""

import numpy as np

from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.harmonic import SHORT, harmonic
from tests.shapes import bumpy


def test_it_is_the_solution_of_a_dense_solve():
    mesh = bumpy(3)
    graph = vertex_graph(mesh)
    free = np.arange(40, mesh.n)
    values = np.column_stack([mesh.V, np.zeros(mesh.n)])  # a column without values takes no step
    weight = 1 / np.maximum(graph.lengths, SHORT * graph.lengths.mean())
    W = np.zeros((mesh.n, mesh.n))
    W[np.repeat(np.arange(mesh.n), np.diff(graph.indptr)), graph.indices] = weight
    L = np.diag(W.sum(axis=1)) - W
    expected = np.linalg.solve(L[40:, 40:], -L[40:, :40] @ values[:40])
    found = harmonic(graph, free, values)
    np.testing.assert_allclose(found, expected, atol=1e-5)
    assert not found[:, 3].any()
