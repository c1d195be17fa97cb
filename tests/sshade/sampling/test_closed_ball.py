from __future__ import annotations

from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sshade import Mesh
from sshade.mesh.adjacency import vertex_graph
from sshade.sampling import closed_ball
from sshade.sampling.closed_ball import refinements
from sshade.sampling.fronts import Fronts, farthest_point_sampling
from tests.shapes import double_torus, icosphere, jittered, strip, tetrahedron, torus, tube

MESHES = {
    "sphere": jittered(icosphere(1), 0.05),
    "torus": torus(9, 6),
    "double torus": double_torus(cells=1),
    "tube": tube(6, 8),
    "strip": strip(9, 3),
    "tetrahedron": tetrahedron(),
}


def regions_of(mesh: Mesh, samples: np.ndarray, region: np.ndarray, distance: np.ndarray) -> SimpleNamespace:
    """Any labelling of the vertices, in the place of fronts."""
    return SimpleNamespace(
        graph=vertex_graph(mesh), samples=samples, region=region.astype(np.int32), distance=distance
    )


def random_regions(mesh: Mesh, k: int, rng: np.random.Generator) -> SimpleNamespace:
    samples = rng.permutation(mesh.n)[:k]
    region = rng.integers(0, k, mesh.n)
    region[samples] = np.arange(k)
    distance = rng.uniform(0.1, 1, mesh.n)
    distance[samples] = 0.0
    return regions_of(mesh, samples, region, distance)


def unions_of(mesh: Mesh, label: list[int]) -> set[tuple[int, ...]]:
    """Single regions, pairs joined by an edge, triples met in a triangle."""
    unions = {(i,) for i in label}
    unions |= {tuple(sorted((label[u], label[v]))) for u, v in mesh.edges.tolist() if label[u] != label[v]}
    return unions | {
        tuple(sorted(label[v] for v in f)) for f in mesh.F.tolist() if len({label[v] for v in f}) == 3
    }


def euler_counts(mesh: Mesh, region: np.ndarray) -> dict[tuple[int, ...], int]:
    """The count of each union, straight from its definition."""
    border = {tuple(edge) for edge in mesh.boundary_edges.tolist()}
    on_border = set(mesh.boundary_edges.ravel().tolist())
    edges = [edge for edge in map(tuple, mesh.edges.tolist()) if edge not in border]
    label, counts = region.tolist(), {}
    for union in unions_of(mesh, label):
        inner_vertices = sum(label[v] in union and v not in on_border for v in range(mesh.n))
        inner_edges = sum(label[u] in union or label[v] in union for u, v in edges)
        triangles = sum(any(label[v] in union for v in f) for f in mesh.F.tolist())
        counts[union] = inner_vertices - inner_edges + triangles
    return counts


def boundary_counts(mesh: Mesh, region: np.ndarray) -> tuple[dict[int, int], dict[tuple[int, int], int]]:
    """Boundary vertices less boundary edges of each region on the boundary; boundary edges between pairs."""
    label = region.tolist()
    border = mesh.boundary_edges.tolist()
    trace = dict.fromkeys((label[v] for v in set(mesh.boundary_edges.ravel().tolist())), 0)
    for v in set(mesh.boundary_edges.ravel().tolist()):
        trace[label[v]] += 1
    crossings: dict[tuple[int, int], int] = {}
    for u, v in border:
        if label[u] == label[v]:
            trace[label[u]] -= 1
        else:
            pair = (min(label[u], label[v]), max(label[u], label[v]))
            crossings[pair] = crossings.get(pair, 0) + 1
    return trace, crossings


def failing_unions(mesh: Mesh, region: np.ndarray) -> tuple[set[tuple[int, ...]], set[tuple[int, ...]]]:
    """Unions whose Euler count is not 1, and regions and pairs whose trace is no single arc."""
    no_disc = {union for union, count in euler_counts(mesh, region).items() if count != 1}
    trace, crossings = boundary_counts(mesh, region)
    no_arc = {(i,) for i, count in trace.items() if count != 1}
    return no_disc, no_arc | {pair for pair, count in crossings.items() if count > 1}


def assert_same_as_the_definition(mesh: Mesh, fronts) -> None:
    vertices, failed = refinements(mesh.F, fronts)
    no_disc, no_arc = failing_unions(mesh, fronts.region)
    assert set(failed.tolist()) == {min(union) for union in no_disc | no_arc}
    assert len(set(vertices.tolist())) == len(vertices)
    assert not set(vertices.tolist()) & set(fronts.samples.tolist())
    assert np.all(np.diff(fronts.distance[vertices]) <= 0)


@pytest.mark.parametrize("name", MESHES)
@given(seed=st.integers(0, 10_000), k=st.integers(1, 12))
def test_random_labels_fail_where_the_definition_says(name, seed, k):
    mesh = MESHES[name]
    k = min(k, mesh.n)
    assert_same_as_the_definition(mesh, random_regions(mesh, k, np.random.default_rng(seed)))


@pytest.mark.parametrize("name", MESHES)
@given(seed=st.integers(0, 10_000), k=st.integers(1, 25))
def test_voronoi_regions_fail_where_the_definition_says(name, seed, k):
    mesh = MESHES[name]
    first = np.array([np.random.default_rng(seed).integers(mesh.n)])
    fronts = farthest_point_sampling(vertex_graph(mesh), min(k, mesh.n), first=first)
    assert_same_as_the_definition(mesh, fronts)


@pytest.mark.parametrize("name", MESHES)
@given(seed=st.integers(0, 10_000), k=st.integers(1, 12), voronoi=st.booleans())
def test_inclusion_and_exclusion_counts_every_union_as_the_definition_does(name, seed, k, voronoi):
    mesh = MESHES[name]
    k, rng, graph = min(k, mesh.n), np.random.default_rng(seed), vertex_graph(mesh)
    if voronoi:
        region = farthest_point_sampling(graph, k, first=rng.permutation(mesh.n)[:1]).region
    else:
        region = random_regions(mesh, k, rng).region
    table = closed_ball._pair_table(graph.indptr, graph.indices, region, k)
    chi, trace = np.zeros((2, k), dtype=np.int64)
    c, crossings = np.zeros((2, len(table)), dtype=np.int64)
    closed_ball._count_edges(
        graph.indptr, graph.indices, graph.boundary, region, table, chi, trace, c, crossings
    )
    three = closed_ball._count_triangles(mesh.F, region, table, chi, c)

    met = [tuple(sorted(region[f].tolist())) for f in mesh.F[three]]
    slot = {(i, j): closed_ball._slot(table, i * k + j) for i, j in combinations(range(k), 2)}
    naive = euler_counts(mesh, region)
    for union, expected in naive.items():
        shared = sum(c[slot[pair]] for pair in combinations(union, 2))
        assert chi[list(union)].sum() - shared + (met.count(union) if len(union) == 3 else 0) == expected
    pairs = {(int(key) // k, int(key) % k) for key in table[table >= 0]}
    assert pairs == {union for union in naive if len(union) == 2}
    assert set(met) == {union for union in naive if len(union) == 3}
    traces, crossed = boundary_counts(mesh, region)
    assert {i: int(trace[i]) for i in traces} == traces
    assert {pair: int(crossings[slot[pair]]) for pair in pairs if crossings[slot[pair]]} == crossed


@pytest.mark.parametrize("name", ["sphere", "torus", "tube", "strip"])
def test_every_vertex_a_sample_passes(name):
    mesh = MESHES[name]
    vertices, failed = refinements(mesh.F, Fronts(vertex_graph(mesh), np.arange(mesh.n)))
    assert len(vertices) == 0 and len(failed) == 0


def test_one_region_fails_with_its_farthest_vertex():
    mesh = MESHES["sphere"]
    fronts = Fronts(vertex_graph(mesh), np.array([0]))
    vertices, failed = refinements(mesh.F, fronts)
    assert failed.tolist() == [0]
    assert vertices.tolist() == [int(np.argmax(fronts.distance))]


def test_an_annulus_of_two_regions_fails_at_the_farthest_end_of_their_crossing_edges():
    # Rings of a torus: each region is an annulus, and so fails by itself too.
    mesh = torus(12, 6)
    region = np.repeat([0, 1, 2], 24)
    fronts = regions_of(mesh, np.array([0, 24, 48]), region, np.linspace(0, 1, mesh.n))
    no_disc, no_arc = failing_unions(mesh, region)
    assert no_disc >= {(0,), (1,), (2,)} and not no_arc
    assert refinements(mesh.F, fronts)[1].tolist() == [0, 1, 2]


def test_a_region_across_a_strip_is_caught_by_its_trace_alone():
    # The Euler count leaves the boundary out, so that bands across a strip pass it.
    mesh = strip(12, 2)
    region = np.repeat([0, 1, 2, 3], [9, 9, 9, 12])
    fronts = regions_of(mesh, np.array([0, 9, 18, 27]), region, np.linspace(1, 2, mesh.n))
    no_disc, no_arc = failing_unions(mesh, region)
    assert not no_disc and no_arc >= {(1,), (2,)}
    vertices, failed = refinements(mesh.F, fronts)
    assert {1, 2} <= set(failed.tolist())
    border = set(mesh.boundary_edges.ravel().tolist())
    assert len(vertices) and set(vertices.tolist()) <= border
