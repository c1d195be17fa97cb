"""Many single vertices as handles: more handles than samples of a proxy, and no rotations."""

import numpy as np

from eval.metrics.deformation import flips
from eval.metrics.deformed import Deformed
from sshade import DeformationTask, Handles
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.harmonic import SHORT
from sshade.regions.handle_regions import HandleRegions
from tests.shapes import bumpy, moved_parts
from tests.sshade.method.calls import fast, fine

METHODS = (fast, fine)
VERTICES = 150


def scattered(share: float, target, *, noise: float = 0.0) -> DeformationTask:
    """Return a task with a random fraction of all vertices as handles.

    The targets are ``target(V)`` plus noise, which is given as a fraction of the diagonal.
    """
    mesh, rng = bumpy(4), np.random.default_rng(3)
    index = rng.permutation(mesh.n)[: int(share * mesh.n)]
    goal = target(mesh.V)[index] + noise * mesh.diagonal * rng.normal(size=(len(index), 3))
    return DeformationTask("scattered", mesh, Handles(index, goal))


def test_what_handles_lack_is_spread_harmonically():
    """The moves equal a dense solution of the same equations, and no vertex moves farther than a handle."""
    task = scattered(0.2, lambda V: V + np.sin(9 * V))
    mesh, index = task.mesh, task.handles.index
    graph = vertex_graph(mesh)
    regions = HandleRegions(mesh, task.handles, vertices=600, graph=graph)
    moved = regions.on_targets(mesh.V, task.handles) - mesh.V
    np.testing.assert_array_equal(moved[index], task.handles.target - mesh.V[index])
    assert np.abs(moved).max() <= np.abs(moved[index]).max()
    matrix = graph.matrix.tocsr()
    weights = matrix.copy()
    weights.data = 1.0 / np.maximum(matrix.data, SHORT * graph.lengths.mean())
    laplacian = np.diag(weights.sum(axis=1)) - weights.toarray()
    free = np.setdiff1d(np.flatnonzero(np.abs(moved).any(axis=1)), index)
    assert len(free) > 0.7 * mesh.n
    known = np.setdiff1d(np.arange(mesh.n), free)
    exact = np.linalg.solve(laplacian[np.ix_(free, free)], -laplacian[np.ix_(free, known)] @ moved[known])
    np.testing.assert_allclose(moved[free], exact, atol=1e-5 * np.abs(moved).max())


def test_handles_in_a_line_need_no_rotation():
    """A closed line around the body moves outwards, and the surface beside it follows without a fold."""
    mesh = bumpy(4)
    height = np.abs(mesh.V[:, 2])
    own = moved_parts(mesh.V, (height < 0.6 * mesh.mean_edge, lambda V: V * [1.1, 1.1, 1]), (height > 1.2, 0))
    task = DeformationTask("line", mesh, own)
    for method in METHODS:
        V = method(task, vertices=VERTICES).vertices
        np.testing.assert_array_equal(V[own.index], own.target)
        assert flips(Deformed(task, V)) == 0
