from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sshade import Mesh
from sshade.mesh.adjacency import vertex_graph
from sshade.proxy.closed_ball import refinements
from sshade.proxy.fronts import farthest_point_sampling
from tests.shapes import double_torus, icosphere, jittered, strip, tetrahedron, torus, tube

MESHES = {
    "sphere": jittered(icosphere(1), 0.05),
    "torus": torus(9, 6),
    "double torus": double_torus(cells=1),
    "tube": tube(6, 8),
    "strip": strip(9, 3),
    "tetrahedron": tetrahedron(),
}


def cells_of(mesh: Mesh, samples: np.ndarray, cell: np.ndarray, distance: np.ndarray) -> SimpleNamespace:
    """Return an arbitrary labelling of the vertices that can replace fronts."""
    cell = cell.astype(np.int32)
    return SimpleNamespace(graph=vertex_graph(mesh), samples=samples, cell=cell, distance=distance)


def random_cells(mesh: Mesh, k: int, rng: np.random.Generator) -> SimpleNamespace:
    samples = rng.permutation(mesh.n)[:k]
    cell = rng.integers(0, k, mesh.n)
    cell[samples] = np.arange(k)
    distance = rng.uniform(0.1, 1, mesh.n)
    distance[samples] = 0.0
    return cells_of(mesh, samples, cell, distance)


def unions_of(mesh: Mesh, label: list[int]) -> set[tuple[int, ...]]:
    """Return all single cells, pairs at an edge, and triples at a triangle."""
    unions = {(i,) for i in label}
    unions |= {tuple(sorted((label[u], label[v]))) for u, v in mesh.edges.tolist() if label[u] != label[v]}
    triples = {tuple(sorted(label[v] for v in f)) for f in mesh.F.tolist()}
    return unions | {triple for triple in triples if len(set(triple)) == 3}


def euler_counts(mesh: Mesh, cell: np.ndarray) -> dict[tuple[int, ...], int]:
    """Return the Euler count of each union, directly from its definition."""
    border = {tuple(edge) for edge in mesh.boundary_edges.tolist()}
    on_border = set(mesh.boundary_edges.ravel().tolist())
    edges = [edge for edge in map(tuple, mesh.edges.tolist()) if edge not in border]
    label, counts = cell.tolist(), {}
    for union in unions_of(mesh, label):
        inner_vertices = sum(label[v] in union and v not in on_border for v in range(mesh.n))
        inner_edges = sum(label[u] in union or label[v] in union for u, v in edges)
        triangles = sum(any(label[v] in union for v in f) for f in mesh.F.tolist())
        counts[union] = inner_vertices - inner_edges + triangles
    return counts


def boundary_counts(mesh: Mesh, cell: np.ndarray) -> tuple[dict[int, int], dict[tuple[int, int], int]]:
    """Return boundary vertices minus boundary edges of each cell, and boundary edges between pairs."""
    label = cell.tolist()
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


def failing_unions(mesh: Mesh, cell: np.ndarray) -> tuple[set[tuple[int, ...]], set[tuple[int, ...]]]:
    """Return unions with an Euler count other than 1, and cells and pairs whose trace is not one arc."""
    no_disc = {union for union, count in euler_counts(mesh, cell).items() if count != 1}
    trace, crossings = boundary_counts(mesh, cell)
    no_arc = {(i,) for i, count in trace.items() if count != 1}
    return no_disc, no_arc | {pair for pair, count in crossings.items() if count > 1}


@pytest.mark.parametrize("voronoi", [True, False], ids=["voronoi", "random"])
@pytest.mark.parametrize("name", MESHES)
@given(seed=st.integers(0, 10_000), k=st.integers(1, 25))
def test_unions_fail_as_the_definition_says(name, voronoi, seed, k):
    mesh, rng = MESHES[name], np.random.default_rng(seed)
    k = min(k, mesh.n)
    if voronoi:
        fronts = farthest_point_sampling(vertex_graph(mesh), k, first=rng.permutation(mesh.n)[:1])
    else:
        fronts = random_cells(mesh, k, rng)
    vertices, failed = refinements(mesh.F, fronts)
    no_disc, no_arc = failing_unions(mesh, fronts.cell)
    assert set(failed.tolist()) == {min(union) for union in no_disc | no_arc}
    assert len(set(vertices.tolist())) == len(vertices)
    assert not set(vertices.tolist()) & set(fronts.samples.tolist())
    assert np.all(np.diff(fronts.distance[vertices]) <= 0)
