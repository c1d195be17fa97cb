"""Samples of a mesh: farthest points, cells, refinement, and valid proxies."""

import re
from collections import Counter
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from sshade import InputError, Mesh
from sshade.mesh.adjacency import VertexGraph, vertex_graph
from sshade.proxy import coarse, sample
from sshade.proxy import sample as module
from sshade.proxy.closed_ball import count_unions, refinements
from sshade.proxy.fronts import Fronts, farthest_point_sampling, thinned
from sshade.proxy.sample import Sampling, proxy_mesh, sample_proxy
from tests.shapes import bumpy, double_torus, icosphere, jittered, strip, tetrahedron, torus, tube

SURFACES = {
    "sphere": icosphere(2),
    "tetrahedron": tetrahedron(),
    "triangle": Mesh(np.eye(3), [[0, 1, 2]]),
    "bumpy": bumpy(2),
    "torus": torus(),
    "thin torus": torus(60, 3, tube=0.05),
    "double torus": double_torus(),
    "fine double torus": double_torus(cells=4),
    "tube": tube(),
    "tube of three sides": tube(3, 40),
    **{f"strip {width} wide": strip(40, width) for width in (2, 3, 5, 8)},
    **{f"jittered strip {width} wide": jittered(strip(40, width), 0.1) for width in (2, 3, 5, 8)},
}


def assert_valid_proxy(mesh: Mesh, result: Sampling) -> None:
    """Assert that the proxy is manifold and oriented, keeps the topology, and uses every sample."""
    proxy = proxy_mesh(mesh, result)  # the constructor refuses unreferenced samples
    proxy.require_manifold()
    assert proxy.topology == mesh.topology
    assert proxy.is_closed == mesh.is_closed
    k = len(result.samples)
    assert len(np.unique(result.samples)) == k
    assert np.array_equal(proxy.V, mesh.V[result.samples])
    assert np.array_equal(result.faces.min(axis=1), result.faces[:, 0])
    assert len(np.unique(result.faces, axis=0)) == len(result.faces)
    # Cell k contains sample k. Only samples have the distance zero.
    assert np.array_equal(result.cell[result.samples], np.arange(k))
    assert np.array_equal(result.distance == 0, np.isin(np.arange(mesh.n), result.samples))


def turned(faces: list[list[int]]) -> set[tuple[int, ...]]:
    """Return each face with its smallest id first."""
    return {min((a, b, c), (b, c, a), (c, a, b)) for a, b, c in faces}


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize("count", [1, 2, 3, 7, 0.1, 0.25, 1.0])
def test_the_proxy_keeps_the_topology(name, count):
    mesh = SURFACES[name]
    k = min(max(int(count * mesh.n) if isinstance(count, float) else count, 1), mesh.n)
    result = sample_proxy(mesh, k, seed=1)
    assert len(result.samples) == k + result.added
    assert_valid_proxy(mesh, result)
    # The faces are the triples of cells at triangles of the mesh, with its orientation.
    triples = [face for face in result.cell[mesh.F].tolist() if len(set(face)) == 3]
    assert turned(triples) == turned(result.faces.tolist())


@given(seed=st.integers(0, 10_000), k=st.integers(1, 150))
@pytest.mark.parametrize("name", ["double torus", "strip 3 wide", "tube"])
def test_the_proxy_is_valid_for_any_seed_and_size(name, seed, k):
    mesh = SURFACES[name]
    assert_valid_proxy(mesh, sample_proxy(mesh, min(k, mesh.n), seed=seed))


@pytest.mark.parametrize("k", [30, 31, 120])
def test_prescribed_samples_come_first_and_in_order(body, k):
    first = np.argsort(np.linalg.norm(body.V - body.V[17], axis=1))[:30]
    result = sample_proxy(body, k, first=first, seed=5)
    assert np.array_equal(result.samples[:30], first)
    assert_valid_proxy(body, result)


def test_the_random_vertex_follows_the_given_ones_and_is_none_of_them():
    mesh = tetrahedron()
    drawn = {int(sample_proxy(mesh, 4, first=np.array([2, 0]), seed=seed).samples[2]) for seed in range(30)}
    assert drawn == {1, 3}


def test_giving_up_names_the_cells(monkeypatch):
    monkeypatch.setattr(module, "MAX_ROUNDS", 0)
    words = r"remeshing to 4 vertices failed: after 0 rounds .*raise the option"
    with pytest.raises(InputError, match=words):
        sample_proxy(SURFACES["torus"], 4)


@pytest.mark.parametrize("name", ["torus", "double torus", "strip 2 wide", "tube", "tube of three sides"])
def test_a_proxy_of_another_topology_is_never_returned(monkeypatch, name):
    nothing = (np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int32))
    monkeypatch.setattr(module, "refinements", lambda F, fronts: nothing)
    errors = []
    for k in range(4, 30):
        try:
            assert_valid_proxy(SURFACES[name], sample_proxy(SURFACES[name], k))
        except InputError as error:
            assert re.fullmatch(f"remeshing to {k} vertices failed: .*; {module.MORE}", str(error))
            errors.append(str(error))
    assert errors
    if "tube" in name:  # an end closes: manifold and complete, but another surface
        assert any("the proxy has Topology" in error for error in errors)


def shuffled(mesh: Mesh) -> Mesh:
    """The same surface with its vertices in random order."""
    number = np.random.default_rng(0).permutation(mesh.n)
    return Mesh(mesh.V[np.argsort(number)], number[mesh.F])


def two_ends() -> Mesh:
    """A tube with nearly all vertices at its two ends, so that most slabs are empty."""
    mesh = tube(40, 60)
    V = np.array(mesh.V)
    end = np.where(V[:, 2] < 3, 0.0, 6.0)
    V[:, 2] = end + 1e-3 * (V[:, 2] - end)
    return Mesh(V, mesh.F)


LARGE = {
    "sphere": icosphere(4),
    "bumpy": bumpy(4),
    "shuffled": shuffled(bumpy(4)),
    "strip, ties everywhere": strip(90, 30),
    "torus": torus(120, 40),
    "double torus": double_torus(cells=6),
    "tube": tube(40, 60),
    "needle": tube(5, 900),
    "all in two slabs": two_ends(),
}


@pytest.mark.parametrize("name", LARGE)
@pytest.mark.parametrize("count", [24, 150])
def test_cells_are_exact_and_the_second_half_is_farthest(name, count):
    mesh = LARGE[name]
    graph = vertex_graph(mesh)
    first = np.random.default_rng(1).permutation(mesh.n)[:5]
    found = coarse.sample_coarsely(mesh, graph, count, first=first)
    samples = found.samples
    assert len(np.unique(samples)) == count and np.array_equal(samples[:5], first)
    all_at_once = Fronts(graph, samples)
    assert np.array_equal(found.distance, all_at_once.distance)
    assert np.array_equal(found.cell, all_at_once.cell)
    again = Fronts(graph, samples[: count // 2])
    again.insert_farthest(count - count // 2)
    assert np.array_equal(again.samples, samples)
    # The samples are about as dense as farthest points. The density of farthest points varies equally with
    # the first vertex.
    exact = farthest_point_sampling(graph, count, first=first)
    assert found.distance.max() <= 1.25 * exact.distance.max()
    assert found.distance.mean() <= 1.08 * exact.distance.mean()


def test_a_mesh_of_a_third_of_a_million_vertices_is_sampled_from_coarse_to_fine(monkeypatch):
    monkeypatch.setattr(coarse, "sample_coarsely", Mock(side_effect=InterruptedError))
    with pytest.raises(InterruptedError):
        sample_proxy(strip(600, 550), 5000)


def test_crumpled_surfaces_get_a_finer_net(monkeypatch):
    """Distances on them are short for their area, so the first radius leaves too few vertices."""
    mesh = LARGE["bumpy"]
    monkeypatch.setattr(coarse, "_NET_AREA", 1e4)
    found = coarse.sample_coarsely(mesh, vertex_graph(mesh), 60, first=np.array([0]))
    assert len(np.unique(found.samples)) == 60


@pytest.mark.parametrize("name", LARGE)
def test_proxies_of_large_meshes_keep_the_topology(name, monkeypatch):
    monkeypatch.setattr(sample, "LARGE", 0)
    monkeypatch.setattr(coarse, "FINER", 0)
    mesh = LARGE[name]
    for count in (5, 60, 300):
        assert_valid_proxy(mesh, sample_proxy(mesh, count, first=np.array([2, 9]), seed=3))


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


SMALL = {"sphere": jittered(icosphere(1), 0.05), "torus": torus(9, 6), "double torus": double_torus(cells=1)}
SMALL |= {"tube": tube(6, 8), "strip": strip(9, 3), "tetrahedron": tetrahedron()}


def random_cells(mesh: Mesh, k: int, rng: np.random.Generator) -> SimpleNamespace:
    """Return an arbitrary labelling of the vertices that can replace fronts."""
    samples = rng.permutation(mesh.n)[:k]
    cell, distance = rng.integers(0, k, mesh.n, dtype=np.int32), rng.uniform(0.1, 1, mesh.n)
    cell[samples], distance[samples] = np.arange(k), 0.0
    return SimpleNamespace(graph=vertex_graph(mesh), samples=samples, cell=cell, distance=distance)


def counts_of(mesh: Mesh, cell: np.ndarray) -> tuple[dict[tuple[int, ...], int], Counter]:
    """Return the Euler count of each union, and the arcs of each cell and pair.

    A union is a cell, a pair at an edge, or a triple at a triangle. Its Euler count is the number of its
    inner vertices, less the inner edges and plus the triangles that have a vertex in it. The arcs of a cell
    are its boundary vertices less the boundary edges in it; the arcs of a pair, boundary edges between both.
    """
    rim, label = set(map(tuple, mesh.boundary_edges.tolist())), cell.tolist()
    ends, edges = {v for edge in rim for v in edge}, set(map(tuple, mesh.edges.tolist()))
    parts = [[(v,) for v in range(mesh.n) if v not in ends], edges - rim, mesh.F.tolist()]
    labels = [[{label[v] for v in simplex} for simplex in part] for part in parts]
    euler = {}
    for simplex in [*((v,) for v in range(mesh.n)), *edges, *mesh.F.tolist()]:
        union = tuple(sorted({label[v] for v in simplex}))
        vertices, inner, faces = (sum(not own.isdisjoint(union) for own in part) for part in labels)
        euler[union] = vertices - inner + faces
    arcs = Counter((label[v],) for v in ends)
    arcs.subtract((label[u],) for u, v in rim if label[u] == label[v])
    arcs.update(tuple(sorted((label[u], label[v]))) for u, v in rim if label[u] != label[v])
    return euler, arcs


@pytest.mark.parametrize("voronoi", [True, False], ids=["voronoi", "random"])
@pytest.mark.parametrize("name", SMALL)
@given(seed=st.integers(0, 10_000), k=st.integers(1, 25))
def test_unions_fail_as_the_definition_says(name, voronoi, seed, k):
    mesh, rng = SMALL[name], np.random.default_rng(seed)
    k = min(k, mesh.n)
    if voronoi:
        fronts = farthest_point_sampling(vertex_graph(mesh), k, first=rng.permutation(mesh.n)[:1])
    else:
        fronts = random_cells(mesh, k, rng)
    euler, arcs = counts_of(mesh, fronts.cell)
    found = count_unions(mesh.F, fronts)
    pairs, triples = ([*map(tuple, part.tolist())] for part in (found.pairs, found.triples))
    cells = [(i,) for i in range(k)]
    chi = zip([*cells, *pairs, *triples], [*found.chi, *found.pair_chi, *found.triple_chi], strict=True)
    assert dict(chi) == euler
    traces = dict(zip([*cells, *pairs], [*found.trace, *found.arcs], strict=True))
    assert traces == {union: arcs.get(union, 2 - len(union)) for union in euler if len(union) < 3}
    vertices, failed = refinements(mesh.F, fronts)
    bad = {min(union) for union, count in euler.items() if count != 1}
    bad |= {min(union) for union, count in traces.items() if count > 1 or count < 2 - len(union)}
    assert set(failed.tolist()) == bad
    assert len(set(vertices.tolist())) == len(vertices)
    assert not set(vertices.tolist()) & set(fronts.samples.tolist())
    assert np.all(np.diff(fronts.distance[vertices]) <= 0)
