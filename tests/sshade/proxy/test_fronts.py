import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from sshade import InputError, Mesh
from sshade.mesh.adjacency import VertexGraph, vertex_graph
from sshade.proxy.fronts import Fronts, farthest_point_sampling, thinned
from tests.shapes import strip


def naive_sampling(graph: VertexGraph, count: int, first: np.ndarray):
    """Farthest point sampling by definition: a whole Dijkstra for each sample, ties to the older sample."""
    matrix, samples = graph.matrix, []
    distance, cell = np.full(graph.n, np.inf), np.full(graph.n, -1)
    for i in range(count):
        v = int(first[i]) if i < len(first) else int(np.argmax(distance))
        own = dijkstra(matrix, directed=False, indices=v)
        nearer = own < distance
        distance[nearer], cell[nearer] = own[nearer], i
        samples.append(v)
    return np.array(samples), distance, cell


def assert_same(fronts: Fronts, expected: tuple[np.ndarray, ...]) -> None:
    for array, other in zip((fronts.samples, fronts.distance, fronts.cell), expected, strict=True):
        assert np.array_equal(array, other)


@given(seed=st.integers(0, 10_000), starts=st.integers(1, 5), extra=st.integers(0, 20))
def test_sampling_equals_the_naive_algorithm_on_random_lengths(seed, starts, extra):
    # Whole lengths from 1 to 3 on a random graph: ties everywhere.
    rng = np.random.default_rng(seed)
    lengths = np.triu(rng.integers(1, 4, (40, 40)) * (rng.random((40, 40)) < 0.1), 2)
    lengths += np.diag(rng.integers(1, 4, 39), 1)  # a path, which connects all
    rows = csr_array((lengths + lengths.T).astype(float))
    graph = VertexGraph(rows.indptr, rows.indices, rows.data, np.zeros(rows.nnz, bool))
    first = rng.permutation(40)[:starts]
    fronts = farthest_point_sampling(graph, starts + extra, first=first)
    assert_same(fronts, naive_sampling(graph, starts + extra, first))


@pytest.mark.parametrize(
    ("count", "first", "words"),
    [
        (9, [], "needs a vertex"),
        (9, [0, 20], r"0\.\.19"),
        (9, [-1], r"0\.\.19"),
        (9, [3, 5, 3], "repeat a vertex"),
        (21, [0], "21 samples were asked for, but the mesh has only 20"),
        (2, [0, 1, 2], "2 samples cannot hold 3 given first ones"),
    ],
)
def test_unusable_samples_are_refused(count, first, words):
    with pytest.raises(InputError, match=words):
        farthest_point_sampling(vertex_graph(strip(4, 3)), count, first=np.array(first, dtype=np.int64))


def test_coincident_vertices_are_sampled_apart():
    """Two coincident vertices have separate cells, although their distance is at most a rounding error."""
    V = strip(2, 1).V.copy()
    V[1] = V[0]
    graph = vertex_graph(Mesh(V, strip(2, 1).F))
    fronts = farthest_point_sampling(graph, 6, first=np.array([0]))
    assert sorted(fronts.samples.tolist()) == [0, 1, 2, 3, 4, 5] and fronts.samples[-1] == 1
    assert np.array_equal(fronts.samples[fronts.cell], np.arange(6))


def test_thinned_vertices_are_each_the_farthest_of_them():
    graph = vertex_graph(strip(9, 4))
    vertices = np.random.default_rng(3).permutation(graph.n)[:20]
    distances = dijkstra(graph.matrix, directed=False)
    expected = [vertices[0]]
    for _ in range(7):
        expected.append(max(np.sort(vertices), key=lambda v: distances[expected, v].min()))
    assert np.array_equal(thinned(graph, vertices, 8), expected)
    assert thinned(graph, vertices, 20) is vertices
