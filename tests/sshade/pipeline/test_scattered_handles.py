"""Many single vertices as handles: more than a proxy's samples can hold, and no rotation at any."""

import numpy as np
import pytest

from eval.metrics.deformation import angle, edge, flips
from eval.metrics.deformed import Deformed
from sshade import DeformationTask, Handles
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.harmonic import SHORT
from sshade.options import Options
from sshade.pipeline.regions import HandleRegions, has_regions
from sshade.solver.local_global import local_global
from tests.shapes import bent, bumpy, rotation
from tests.sshade.pipeline.calls import fast, fine

METHODS = {"fast": fast, "fine": fine}
VERTICES = 600


def scattered(share: float, target, *, noise: float = 0.0, level: int = 5) -> DeformationTask:
    """A share of all vertices, at random, with targets ``target(V)`` and noise over the diagonal."""
    mesh, rng = bumpy(level), np.random.default_rng(3)
    index = rng.permutation(mesh.n)[: int(share * mesh.n)]
    goal = target(mesh.V)[index] + noise * mesh.diagonal * rng.normal(size=(len(index), 3))
    return DeformationTask("scattered", mesh, Handles(index, goal))


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("share", [0.1, 0.2, 0.4])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_the_surface_is_as_even_as_the_minimum_at_full_resolution(name, share, noise):
    task = scattered(share, lambda V: bent(V, 0.1), noise=noise)
    assert has_regions(task.mesh, task.handles.index, Options(vertices=VERTICES))
    V = METHODS[name](task, vertices=VERTICES).vertices
    np.testing.assert_array_equal(V[task.handles.index], task.handles.target)
    ours, full = (Deformed(task, V), Deformed(task, local_global(task, start="rigid").vertices))
    assert edge(ours) < 1.15 * edge(full)
    assert angle(ours) < 1.15 * angle(full)
    assert flips(ours) <= 1.5 * flips(full) + 2


@pytest.mark.parametrize("name", METHODS)
def test_handles_that_move_as_one_move_everything(name):
    R = rotation()
    task = scattered(0.2, lambda V: V @ R.T + [3, 1, 2])
    V = METHODS[name](task, vertices=VERTICES).vertices
    np.testing.assert_allclose(V, task.mesh.V @ R.T + [3, 1, 2], atol=1e-4 * task.mesh.diagonal)


def test_what_handles_lack_is_spread_harmonically():
    """Against a dense solution of the same equations; nothing exceeds what is lacking."""
    task = scattered(0.2, lambda V: V + np.sin(9 * V), level=4)
    mesh, index = task.mesh, task.handles.index
    graph = vertex_graph(mesh)
    regions = HandleRegions(mesh, task.handles, vertices=VERTICES, graph=graph)
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
    """A closed line around the body moves outwards: the surface beside it follows, without a fold."""
    mesh = bumpy(5)
    line = np.flatnonzero(np.abs(mesh.V[:, 2]) < 0.6 * mesh.mean_edge)
    ends = np.flatnonzero(np.abs(mesh.V[:, 2]) > 1.2)
    index = np.r_[line, ends]
    target = np.concatenate([mesh.V[line] * [1.1, 1.1, 1], mesh.V[ends]])
    task = DeformationTask("line", mesh, Handles(index, target))
    for method in METHODS.values():
        V = method(task, vertices=VERTICES).vertices
        np.testing.assert_array_equal(V[index], target)
        assert flips(Deformed(task, V)) == 0
