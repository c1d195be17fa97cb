"""Sides, neighbours and connectivity of faces against sets, scipy and libigl."""

import igl
import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sshade import Mesh
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.faces import connectivity
from sshade.mesh.incidence import group_rows, sides_by_edge, sort_by_id
from tests.shapes import beside, block, double_torus, icosphere, jittered, strip, tetrahedron, torus, tube


def soup(seed: int, *, n: int = 12, m: int = 14) -> tuple[np.ndarray, int]:
    """Random triangles on few vertices: edges of many faces, split vertices, several components."""
    rng = np.random.default_rng(seed)
    F = np.array([rng.choice(n, 3, replace=False) for _ in range(m)])
    used, F = np.unique(F, return_inverse=True)
    return F.reshape(-1, 3), len(used)


#: Manifold and oriented meshes.
MESHES = {
    "closed": jittered(icosphere(1), 0.05),
    "genus one": jittered(torus(9, 6), 0.02),
    "genus two": double_torus(cells=1),
    "two boundary loops": jittered(tube(6, 8), 0.05),
    "one triangle": Mesh(np.eye(3) * [1, 2, 3], [[0, 1, 2]]),
    "grid": strip(9, 3),
    "lattice block": block(np.ones((4, 3, 2))),
    "inside out": Mesh(strip(6, 4).V, strip(6, 4).F[:, ::-1]),
    "a hole of one vertex's fan": Mesh(icosphere(1).V, icosphere(1).F[1:]),
    "two components": beside(tetrahedron(), Mesh(tetrahedron().V + 3, tetrahedron().F)),
}
CASES = [soup(seed) for seed in range(60)] + [(np.array(mesh.F), mesh.n) for mesh in MESHES.values()]
#: Faces of a fan: work that grows as the square of the faces at a vertex would take minutes.
MANY = 200_000


def labels(n: int, edges: list[tuple[int, int]]) -> tuple[int, np.ndarray]:
    i, j = np.array(edges, dtype=int).reshape(-1, 2).T
    return connected_components(coo_array((np.ones(len(i)), (i, j)), shape=(n, n)), directed=False)


@pytest.mark.parametrize("case", range(len(CASES)))
def test_tables_and_facts_equal_those_of_sets_scipy_and_libigl(case):
    F, n = CASES[case]
    sides: dict[tuple[int, int], list[int]] = {}
    for side, (i, j) in enumerate(zip(F.ravel(), F[:, [1, 2, 0]].ravel(), strict=True)):
        sides.setdefault((min(i, j), max(i, j)), []).append(side)
    table = sides_by_edge(F, n)
    assert [tuple(ends) for ends in table.ends.tolist()] == sorted(sides)
    at_edge = [part.tolist() for part in np.split(table.side, table.start[1:-1])]
    assert at_edge == [sides[edge] for edge in sorted(sides)]
    assert np.array_equal(table.ends[table.edge], np.sort(np.stack([F, F[:, [1, 2, 0]]], axis=2), axis=2))
    start, corner = sort_by_id(F.ravel(), n)
    face = corner // 3
    around = [np.flatnonzero((i == F).any(axis=1)).tolist() for i in range(n)]
    assert [part.tolist() for part in np.split(face, start[1:-1])] == around

    facts, rim = connectivity(F, n), [edge for edge, through in sides.items() if len(through) == 1]
    assert (facts.edges, facts.boundary_edges) == (len(sides), len(rim))
    count, component = labels(n, list(sides))
    assert facts.components == count
    np.testing.assert_array_equal(facts.component, component)
    touched = {v for edge in rim for v in edge}
    assert facts.boundary_loops == labels(n, rim)[0] - (n - len(touched))
    begins = [F.ravel()[through].tolist() for through in sides.values()]
    assert facts.oriented == all(len(set(tails)) == len(tails) for tails in begins)
    crowd = max(len(through) for through in sides.values())
    if crowd > 2:
        i, j, faces = facts.crowded_edge
        assert faces == crowd == len(sides[i, j])
    else:
        assert facts.crowded_edge.tolist() == [-1, -1, -1]
        split = ~np.asarray(igl.is_vertex_manifold(F)).ravel()
        assert facts.split_vertex == (int(np.argmax(split)) if split.any() else -1)


@pytest.mark.parametrize("name", MESHES)
def test_the_graph_has_every_edge_in_both_directions_with_its_length(name):
    mesh = MESHES[name]
    graph = vertex_graph(mesh)
    owner = np.repeat(np.arange(graph.n), np.diff(graph.indptr))
    pairs = np.concatenate([mesh.edges, mesh.edges[:, ::-1]])
    assert np.array_equal(np.stack([owner, graph.indices], axis=1), pairs[np.lexsort(pairs.T[::-1])])
    rim = {tuple(edge) for edge in mesh.boundary_edges.tolist()}
    ends = np.sort(np.stack([owner, graph.indices], axis=1), axis=1).tolist()
    assert graph.boundary.tolist() == [tuple(edge) in rim for edge in ends]
    lengths = np.linalg.norm(mesh.V[owner] - mesh.V[graph.indices], axis=1)
    assert np.allclose(graph.lengths, lengths, rtol=4e-16, atol=0)
    assert not (graph.matrix - graph.matrix.T).data.any()


@pytest.mark.parametrize("closed", [True, False])
def test_a_vertex_of_many_faces(closed):
    rim = 1 + np.random.default_rng(0).permutation(MANY)
    angle = 2 * np.pi * np.arange(MANY) / MANY
    V = np.zeros((MANY + 1, 3))
    V[rim, 0], V[rim, 1] = np.cos(angle), np.sin(angle)
    F = np.stack([np.zeros(MANY, dtype=int), rim, np.roll(rim, -1)], axis=1)
    mesh = Mesh(V, F if closed else F[:-1])
    graph = vertex_graph(mesh)
    assert np.array_equal(graph.indices[:MANY], np.arange(1, MANY + 1))
    assert np.allclose(graph.lengths[:MANY], 1)
    assert graph.boundary[:MANY].sum() == (0 if closed else 2)
    facts = mesh.connectivity
    assert (facts.edges, facts.components, facts.boundary_loops) == (2 * MANY - (not closed), 1, 1)
    assert facts.split_vertex == -1 and facts.oriented and len(mesh.edges) == facts.edges


@pytest.mark.parametrize("n", [4, 2**22])
@pytest.mark.parametrize("columns", [1, 2, 3])
def test_groups_of_rows_are_those_of_unique(n, columns):
    """With n = 2^22 three ids make no key of 64 bits."""
    rows = n - 1 - np.random.default_rng(columns).integers(0, 4, (40, columns))
    _, first, group = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    found = group_rows(rows, n)
    assert np.array_equal(found[0], first) and np.array_equal(found[1], group.ravel())
