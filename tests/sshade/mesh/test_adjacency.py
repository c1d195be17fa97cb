"""Tables of edges, faces and neighbours against sets; linear time, also with all faces at one vertex."""

from __future__ import annotations

from time import process_time

import numpy as np
import pytest

from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.connectivity import connectivity
from sshade.mesh.mesh import Mesh
from sshade.mesh.sides import faces_around_vertices, sides_by_edge
from tests.shapes import block, icosphere, jittered, strip, tetrahedron, torus, tube

MESHES = {
    "closed": jittered(icosphere(2), 0.05),
    "genus one": jittered(torus(18, 10), 0.02),
    "two boundary loops": jittered(tube(9, 14), 0.05),
    "one triangle": Mesh(np.eye(3) * [1, 2, 3], [[0, 1, 2]]),
    "grid": strip(12, 9),
    "lattice block": block(np.ones((4, 3, 2))),
    "inside out": Mesh(strip(6, 4).V, strip(6, 4).F[:, ::-1]),
    "a hole of one vertex's fan": Mesh(icosphere(1).V, icosphere(1).F[1:]),
    "two components": Mesh(
        np.concatenate([tetrahedron().V, tetrahedron().V + 3]),
        np.concatenate([tetrahedron().F, tetrahedron().F + 4]),
    ),
}
#: Faces of the fan and of the grid that it is compared with.
MANY = 200_000


def fan(m: int, *, closed: bool) -> Mesh:
    """A circle's m triangles around vertex 0, the last of them left out unless it is closed."""
    rim = 1 + np.random.default_rng(0).permutation(m)
    angle = 2 * np.pi * np.arange(m) / m
    V = np.zeros((m + 1, 3))
    V[rim, 0], V[rim, 1] = np.cos(angle), np.sin(angle)
    F = np.stack([np.zeros(m, dtype=int), rim, np.roll(rim, -1)], axis=1)
    return Mesh(V, F if closed else F[:-1])


@pytest.mark.parametrize("name", MESHES)
def test_tables_equal_those_of_sets(name):
    mesh = MESHES[name]
    at: dict[tuple[int, int], list[int]] = {}
    for f, face in enumerate(mesh.F.tolist()):
        for c, (i, j) in enumerate(zip(face, face[1:] + face[:1], strict=True)):
            at.setdefault((min(i, j), max(i, j)), []).append(3 * f + c)
    edges = sides_by_edge(mesh.F, mesh.n)
    assert [tuple(ends) for ends in edges.ends.tolist()] == sorted(at)
    assert [own.tolist() for own in np.split(edges.side, edges.start[1:-1])] == [at[e] for e in sorted(at)]
    assert [tuple(ends) for ends in mesh.boundary_edges.tolist()] == [
        e for e in sorted(at) if len(at[e]) == 1
    ]
    assert np.array_equal(mesh.edges, edges.ends) and np.array_equal(mesh.face_edges, edges.edge)
    start, face = faces_around_vertices(mesh.F, mesh.n)
    around = [np.flatnonzero((i == mesh.F).any(axis=1)).tolist() for i in range(mesh.n)]
    assert [own.tolist() for own in np.split(face, start[1:-1])] == around

    graph = vertex_graph(mesh)
    count = {pair: len(sides) for (i, j), sides in at.items() for pair in ((i, j), (j, i))}
    owner = np.repeat(np.arange(graph.n), np.diff(graph.indptr))
    # Ascending neighbours make the directed pairs come in lexicographic order.
    assert list(zip(owner.tolist(), graph.indices.tolist(), strict=True)) == sorted(count)
    assert graph.boundary.tolist() == [count[pair] == 1 for pair in sorted(count)]
    lengths = np.linalg.norm(mesh.V[owner] - mesh.V[graph.indices], axis=1)
    assert np.allclose(graph.lengths, lengths, rtol=4e-16, atol=0)
    length = dict(zip(sorted(count), graph.lengths.tolist(), strict=True))
    assert all(length[i, j] == length[j, i] for i, j in length)


def test_the_graph_of_a_mesh_inside_out_is_the_same():
    mesh = MESHES["two boundary loops"]
    flipped = Mesh(mesh.V, mesh.F[:, ::-1])
    for a, b in zip(vars(vertex_graph(mesh)).values(), vars(vertex_graph(flipped)).values(), strict=True):
        assert np.array_equal(a, b)


def seconds(make, mesh: Mesh) -> float:
    """The shortest of a few calls."""
    times = []
    for _ in range(3):
        begin = process_time()
        make(mesh)
        times.append(process_time() - begin)
    return min(times)


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize(
    "make",
    [
        lambda mesh: sides_by_edge(mesh.F, mesh.n),
        lambda mesh: faces_around_vertices(mesh.F, mesh.n),
        lambda mesh: connectivity(mesh.F, mesh.n),
        vertex_graph,
    ],
    ids=["sides", "faces", "connectivity", "graph"],
)
def test_a_vertex_of_many_faces_costs_no_more_than_many_vertices_of_few(make, closed):
    """With work that grows as the square of a vertex's faces the ratio is a thousand and more."""
    grid = strip(MANY // 200, 100)
    make(grid)  # compiled, and what the mesh itself remembers
    hub = fan(MANY, closed=closed)
    make(hub)
    assert seconds(make, hub) < 20 * seconds(make, grid)


@pytest.mark.parametrize("closed", [True, False])
def test_the_tables_of_a_wide_fan(closed):
    mesh = fan(MANY, closed=closed)
    graph = vertex_graph(mesh)
    assert np.array_equal(graph.indices[:MANY], np.arange(1, MANY + 1))
    assert np.allclose(graph.lengths[:MANY], 1)
    assert graph.boundary[:MANY].sum() == (0 if closed else 2)
    facts = mesh.connectivity
    assert (facts.edges, facts.components, facts.boundary_loops) == (2 * MANY - (not closed), 1, 1)
    assert facts.split_vertex == -1 and facts.oriented
