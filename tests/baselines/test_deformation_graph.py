"""The deformation graph against plain loops: its bindings, its solver and its blend."""

import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra

from baselines.deformation_graph.deformation_graph import deformation_graph
from baselines.deformation_graph.node_graph import FEWEST_NEIGHBOURS, bind_to_nodes, node_graph
from sshade import DeformationTask, Handles, InputError
from sshade.mesh.adjacency import vertex_graph
from sshade.proxy.fronts import farthest_point_sampling
from tests.shapes import beside, family, held_ends, icosphere, jittered, strip
from tests.sshade.naive import svd_rotations


def sampled(mesh, nodes, first=(0,)):
    graph = vertex_graph(mesh)
    return graph, farthest_point_sampling(graph, nodes, first=np.array(first))


def neighbours_of(edges, k):
    star = [set() for _ in range(k)]
    for i, j in edges.tolist():
        star[i].add(j)
        star[j].add(i)
    return star


@pytest.mark.parametrize("mesh", [jittered(strip(60, 1), 0.05), strip(20, 6)], ids=["chain", "flat"])
def test_nodes_get_edges_until_every_rotation_is_determined_and_no_more(mesh):
    _, fronts = sampled(mesh, 12)
    P, edges = mesh.V[fronts.samples], node_graph(mesh, fronts)
    touching = {tuple(sorted(pair)) for pair in fronts.cell[mesh.edges].tolist() if pair[0] != pair[1]}

    def determined(i, star):
        singular = np.linalg.svd(P[sorted(star)] - P[i], compute_uv=False)
        return len(star) >= FEWEST_NEIGHBOURS and singular[1] ** 2 > 1e-6 * singular[0] ** 2

    poor = {i for i, star in enumerate(neighbours_of(np.array([*touching]), 12)) if not determined(i, star)}
    assert poor and all(determined(i, star) for i, star in enumerate(neighbours_of(edges, 12)))
    assert all(poor & {*edge} for edge in {*map(tuple, edges.tolist())} - touching)


@pytest.mark.parametrize("name", family())
@pytest.mark.parametrize("blended", [1, 4, 8])
def test_binding_equals_plain_loops(name, blended):
    mesh = family()[name]
    graph, fronts = sampled(mesh, 30)
    edges = node_graph(mesh, fronts)
    bound = bind_to_nodes(graph, fronts, edges=edges, blended=blended)
    star = neighbours_of(edges, 30)
    distance = np.full((mesh.n, 30), np.inf)
    for m in range(30):
        inside = np.flatnonzero(np.isin(fronts.cell, [m, *star[m]]))
        at = int(np.searchsorted(inside, fronts.samples[m]))
        within = graph.matrix[inside][:, inside]
        distance[inside, m] = dijkstra(within, directed=False, indices=at)
    for v in range(mesh.n):
        order = [m for m in np.argsort(distance[v], kind="stable") if np.isfinite(distance[v, m])]
        used = order[: min(blended, len(order) - 1)]
        d_max = distance[v, order[len(used)]]
        phi = (1 - distance[v, used] / d_max) ** 2
        phi = phi / phi.sum() if phi.sum() > 0 else np.full(len(used), 1 / len(used))
        own = slice(*bound.indptr[v : v + 2])
        assert bound.indices[own].tolist() == used
        np.testing.assert_allclose(bound.data[own], phi, atol=1e-12)


def reference(task, *, nodes, iterations):
    """Solve the graph by local/global with dense matrices and LAPACK's SVD, then blend vertex by vertex."""
    mesh, h = task.mesh, len(task.handles)
    graph, fronts = sampled(mesh, nodes, first=task.handles.index)
    edges = node_graph(mesh, fronts)
    bound = bind_to_nodes(graph, fronts, edges=edges, blended=4)
    P, star = mesh.V[fronts.samples], [sorted(s) for s in neighbours_of(edges, nodes)]
    L = np.zeros((nodes, nodes))
    for i, s in enumerate(star):
        L[i, i], L[i, s] = len(s), -1

    def rotations(q):
        return svd_rotations(np.stack([(P[i] - P[s]).T @ (q[i] - q[s]) for i, s in enumerate(star)]))

    q = P.copy()
    q[:h] = task.handles.target
    for _ in range(iterations):
        R = rotations(q)
        b = np.stack([sum((R[i] + R[j]) / 2 @ (P[i] - P[j]) for j in s) for i, s in enumerate(star)])
        q[h:] = np.linalg.solve(L[h:, h:], b[h:] - L[h:, :h] @ q[:h])
    R = rotations(q)
    V = np.zeros_like(mesh.V)
    for v in range(mesh.n):
        for p in range(*bound.indptr[v : v + 2]):
            m = bound.indices[p]
            V[v] += bound.data[p] * (R[m] @ (mesh.V[v] - P[m]) + q[m])
    return V


def test_equals_a_dense_implementation_to_rounding(body):
    task = held_ends(body, share=0.05)
    result = deformation_graph(task, nodes=120, tolerance=0, max_iterations=15)
    expected = reference(task, nodes=120, iterations=15)
    index, target = task.handles.index, task.handles.target
    before = np.linalg.norm(expected[index] - target, axis=1).mean() / body.diagonal
    assert before > 1e-6
    assert result.extra["handle_before"] == pytest.approx(before, rel=1e-6)
    np.testing.assert_array_equal(result.vertices[index], target)
    expected[index] = target
    assert np.abs(result.vertices - expected).max() < 1e-9 * body.diagonal


def test_a_component_without_a_node_is_refused():
    both = beside(strip(10, 10), icosphere(1))  # the sphere consists of handles, and has no edge of a region
    index = np.concatenate([[0, 1, 2], 121 + np.arange(42)])
    task = DeformationTask("two", both, Handles(index, both.V[index]))
    assert deformation_graph(task, nodes=4).converged
    with pytest.raises(InputError, match="3 nodes leave a component of the mesh without one; ask for more"):
        deformation_graph(task, nodes=3)
