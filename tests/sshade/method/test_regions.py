"""Handles that are regions of any size, and many single vertices."""

from functools import partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eval.metrics.deformation import flips
from eval.metrics.deformed import Deformed
from sshade import DeformationTask, Handles, Mesh
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.harmonic import SHORT
from sshade.regions.handle_regions import HandleRegions, edge_vertices
from sshade.regions.normal_shift import shifted
from tests.shapes import bumpy, jittered, moved_parts, rotation, strip, tube
from tests.sshade.method.calls import fast, fine, paper

VERTICES = 600
METHODS = {
    "paper": partial(paper, vertices=VERTICES, samplings=2),
    "fast": partial(fast, vertices=VERTICES),
    "fine": partial(fine, vertices=VERTICES),
}


@pytest.fixture(scope="module")
def task() -> DeformationTask:
    """Fix the lowest 30 % of the vertices, and move and turn the highest 5 % by 20 degrees."""
    mesh = bumpy(5)
    order, turn = np.argsort(mesh.V[:, 2], kind="stable"), Rotation.from_euler("z", 20, degrees=True)
    moved = order[-int(0.05 * mesh.n) :], lambda V: turn.apply(V) + [0.2, 0.1, 0.2]
    return DeformationTask("body", mesh, moved_parts(mesh.V, (order[: int(0.3 * mesh.n)], 0), moved))


def test_a_region_that_grows_takes_its_volume_from_the_rest(task):
    """The proxy has few samples inside the region, but the volume of the mesh is still constrained."""
    z = task.mesh.V[:, 2]
    own = moved_parts(task.mesh.V, (z < -1.0, lambda V: V * [1.05, 1.05, 1]), (z > 1.6, 0))
    grown = DeformationTask("grown", task.mesh, own)
    for name in ("fast", "fine"):
        after = Mesh(METHODS[name](grown).vertices, task.mesh.F)
        assert after.volume == pytest.approx(task.mesh.volume, rel=1e-6)
    free = Mesh(METHODS["fast"](grown, volume=0.0).vertices, task.mesh.F)
    assert free.volume > 1.005 * task.mesh.volume


def half_a_plane(degrees: float) -> tuple[Mesh, np.ndarray, np.ndarray]:
    """Return a plane, the vertices of one half, and a rotation about the direction of the edge."""
    mesh = jittered(strip(80, 40), 0.1)
    turned = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    return mesh, np.flatnonzero(mesh.V[:, 0] < 39.5), turned


def beside_the_half(mesh: Mesh, handles: Handles) -> tuple[np.ndarray, float]:
    """Return all positions, and the slope in degrees of the surface beside the edge of the half."""
    regions = HandleRegions(mesh, handles, vertices=600, graph=vertex_graph(mesh))
    V = regions.on_targets(mesh.V, handles)
    beside = (np.abs(mesh.V[:, 0] - 40) < 0.2) & (mesh.V[:, 1] > 8) & (mesh.V[:, 1] < 32)
    edge = handles.index[np.abs(mesh.V[handles.index, 0] - 39) < 0.2]
    along = V[beside].mean(axis=0) - V[edge].mean(axis=0)
    return V, np.degrees(np.arctan2(-along[2], along[0]))


@pytest.mark.parametrize(("degrees", "least", "most"), [(10, 9, 11), (35, 10, 30), (80, 0, 2)])
def test_a_small_turn_is_taken_out_of_an_edge_and_a_bend_is_left(degrees, least, most):
    """The half is turned about the edge."""
    mesh, held, R = half_a_plane(degrees)
    targets = (mesh.V[held] - [39, 0, 0]) @ R.T + [39, 0, 0]
    V, slope = beside_the_half(mesh, Handles(held, targets))
    np.testing.assert_array_equal(V[held], targets)
    assert least <= abs(slope) <= most
    far = mesh.V[:, 0] > 41 + 3 * np.sqrt(mesh.area) * (600**-0.5 + mesh.n**-0.5)
    np.testing.assert_array_equal(V[far], mesh.V[far])


@pytest.mark.parametrize("degrees", [10, 80])
def test_a_prescribed_turn_is_that_of_the_surface_beside_an_edge_however_large(degrees):
    """The half stays, and its handles have the rotation."""
    mesh, held, R = half_a_plane(degrees)
    handles = Handles(held, mesh.V[held], rotation=np.broadcast_to(R, (len(held), 3, 3)))
    assert beside_the_half(mesh, handles)[1] == pytest.approx(degrees, rel=0.1)


def test_an_edge_of_many_vertices_is_thinned_and_still_exact():
    """A comb of handle regions and free stripes has more vertices at edges than samples."""
    mesh = jittered(strip(120, 30), 0.1)
    held = np.flatnonzero(mesh.V[:, 0] % 6 < 3)
    moved = mesh.V[held] @ rotation().T
    task = DeformationTask("comb", mesh, Handles(held, moved))
    assert len(edge_vertices(mesh, held)) > 1000
    for name in ("paper", "fast", "fine"):
        V = METHODS[name](task, vertices=400).vertices
        np.testing.assert_array_equal(V[held], moved)
        np.testing.assert_allclose(V, mesh.V @ rotation().T, atol=1e-4 * mesh.diagonal)


def test_a_ring_divides_the_mesh():
    """The surface between two regions depends only on these two regions."""
    mesh = tube(32, 60, length=12.0)
    z = mesh.V[:, 2]
    own = moved_parts(mesh.V, (z < 1.5, 0), ((z > 5.5) & (z < 7.5), 0), (z > 10.5, [1, 0, 0.5]))
    V = fast(DeformationTask("ring", mesh, own), vertices=480).vertices
    lower = (z > 1.5) & (z < 5.5)
    assert np.abs(V[lower] - mesh.V[lower]).max() < 5e-3 * mesh.diagonal
    np.testing.assert_array_equal(V[own.index], own.target)


def test_a_hard_handle_among_soft_ones_is_a_sample():
    mesh = bumpy(4)
    index = np.argsort(mesh.V[:, 2])[: mesh.n // 2]
    weight = np.where(np.arange(len(index)) == 0, np.inf, 1.0)  # the lowest vertex, far from the edge
    handles, graph = Handles(index, mesh.V[index], weight=weight), vertex_graph(mesh)
    regions = HandleRegions(mesh, handles, vertices=300, graph=graph)
    assert regions.regional and index[0] in regions.first


@pytest.mark.parametrize("ratio", [0.9, 1.0, 1.1])
def test_moves_along_normals_reach_a_volume_within_their_limits(ratio):
    mesh = bumpy(3)
    F, weight = mesh.F.astype(np.uint32), np.where(mesh.V[:, 0] > 0, 1.0, 0.25)
    V = shifted(mesh.V, F, weight, ratio * mesh.volume, most=np.inf, error=1e-12)
    assert Mesh(V, mesh.F).volume == pytest.approx(ratio * mesh.volume, rel=1e-10)
    moved = np.linalg.norm(V - mesh.V, axis=1)
    assert moved == pytest.approx(weight * moved.max(), abs=1e-12)
    assert shifted(mesh.V, F, 0 * weight, 2 * mesh.volume, most=np.inf, error=1e-12) is mesh.V
    near = shifted(mesh.V, F, weight, 2 * mesh.volume, most=0.01, error=1e-12)
    assert np.linalg.norm(near - mesh.V, axis=1) == pytest.approx(0.01 * weight)


BOTH = (fast, fine)
FEW = 150


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
    index, V = task.handles.index, np.array(task.mesh.V)
    ends = next(edge for edge in task.mesh.edges if not np.isin(edge, index).any())
    V[ends[1]] = V[ends[0]]  # an edge without length
    mesh = Mesh(V, task.mesh.F)
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
    for method in BOTH:
        V = method(task, vertices=FEW).vertices
        np.testing.assert_array_equal(V[own.index], own.target)
        assert flips(Deformed(task, V)) == 0
