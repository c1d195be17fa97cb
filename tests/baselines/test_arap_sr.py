"""ARAP-SR against a small dense implementation, measured figures, and its limits in alpha."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.arap import arap
from baselines.arap_sr.arap_sr import arap_sr
from baselines.arap_sr.smooth_rotations import largest_turn, vertex_colours
from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import rigid_motion
from sshade.solver.start import initial_guess
from sshade.task import DeformationTask, Handles
from tests.shapes import QUARTER, bumpy, double_torus, family, held_ends, jittered, strip, tube

#: Area, volume and edge error in percent after so many iterations of the bar with raw cotangents and
#: alpha = 0.02, from an implementation in numpy that follows CGAL's order: its global step comes first.
BAR = {
    (3, 20): (21.2, 25.9, 8.7),
    (3, 120): (18.5, 23.7, 7.4),
    (3, 300): (18.5, 23.7, 7.4),
    (4, 20): (26.6, 32.6, 10.9),
    (4, 120): (18.6, 23.6, 7.4),
    (4, 300): (17.8, 23.1, 7.0),
    (5, 20): (31.0, 42.1, 11.7),
    (5, 120): (24.7, 29.4, 9.9),
}


def bent_bar(subdivisions: int) -> DeformationTask:
    """A jittered 4 x 1 x 1 bar, one end turned by 90 degrees: 386, 1538, 6146 vertices for 3, 4, 5."""
    import trimesh  # the jitter of a vertex depends on its place in the order

    bar = trimesh.creation.box(extents=(4, 1, 1))
    for _ in range(subdivisions):
        bar = bar.subdivide()
    mesh = Mesh(bar.vertices, bar.faces)
    noise = np.random.default_rng(0).normal(size=mesh.V.shape)
    mesh = Mesh(mesh.V + noise * 0.15 / 2**subdivisions, mesh.F)
    held = np.flatnonzero(np.abs(mesh.V[:, 0]) > 1.9)
    turned = mesh.V[held, 0] > 1.9
    target = np.where(turned[:, None], mesh.V[held] @ QUARTER.T, mesh.V[held])
    return DeformationTask("bar", mesh, Handles(held, target, dynamic=turned, group=turned.astype(int)))


def errors(task: DeformationTask, V: np.ndarray) -> np.ndarray:
    """Area, volume and mean edge error in percent, the last over the longest rest edge."""
    rest, deformed = task.mesh, Mesh(V, task.mesh.F)
    before, after = (np.linalg.norm(np.diff(P[rest.edges], axis=1)[:, 0], axis=1) for P in (rest.V, V))
    area, volume = deformed.area / rest.area - 1, deformed.volume / rest.volume - 1
    return 100 * np.abs([area, volume, np.abs(after - before).mean() / before.max()])


def dense_weights(mesh: Mesh, *, clamp: bool) -> np.ndarray:
    """(n, n) cotangent weights, corner by corner."""
    w = np.zeros((mesh.n, mesh.n))
    for face in mesh.F:
        for c in range(3):
            k, i, j = face[c], face[(c + 1) % 3], face[(c + 2) % 3]
            a, b = mesh.V[i] - mesh.V[k], mesh.V[j] - mesh.V[k]
            cotangent = a @ b / np.linalg.norm(np.cross(a, b))
            half = (max(cotangent, 0.0) if clamp else cotangent) / 2
            w[i, j] += half
            w[j, i] += half
    return w


def reference(task, *, alpha, clamp, iterations, start) -> np.ndarray:
    """The same iteration with dense matrices, loops and LAPACK's singular value decomposition."""
    mesh, held = task.mesh, task.handles.index
    w = dense_weights(mesh, clamp=clamp)
    stars = [np.unique(mesh.F[(i == mesh.F).any(axis=1)]) for i in range(mesh.n)]
    stars = [star[star != i] for i, star in enumerate(stars)]
    L = np.diag(w.sum(axis=1)) - w
    free = np.setdiff1d(np.arange(mesh.n), held)
    q = initial_guess(task, start)
    R0 = rigid_motion(mesh.V[held], task.handles.target)[0] if start == "rigid" else np.eye(3)
    R = np.tile(R0, (mesh.n, 1, 1))
    for _ in range(iterations):
        for i in np.argsort(vertex_colours(mesh), kind="stable"):
            S = alpha * mesh.area / len(stars[i]) * R[stars[i]].sum(axis=0).T
            for j in stars[i]:
                S += w[i, j] * np.outer(mesh.V[i] - mesh.V[j], q[i] - q[j])
            U, _, Vt = np.linalg.svd(S)
            U[:, 2] *= np.linalg.det(U @ Vt)
            R[i] = (U @ Vt).T
        b = np.zeros((mesh.n, 3))
        for i in range(mesh.n):
            for j in stars[i]:
                b[i] += w[i, j] / 2 * (R[i] + R[j]) @ (mesh.V[i] - mesh.V[j])
        q[free] = np.linalg.solve(L[np.ix_(free, free)], (b - L[:, held] @ q[held])[free])
    return q


@pytest.mark.parametrize("mesh", [bumpy(2), jittered(strip(12, 3), 0.2)], ids=["closed", "boundary"])
@pytest.mark.parametrize("clamp", [True, False], ids=["clamped", "raw"])
@pytest.mark.parametrize(("alpha", "start"), [(0.02, "rest"), (0.02, "rigid"), (0.5, "rest"), (0.0, "rest")])
def test_equals_a_dense_implementation_to_rounding(mesh, clamp, alpha, start):
    task = held_ends(mesh, axis=int(np.argmax(np.ptp(mesh.V, axis=0))))
    result = arap_sr(task, alpha=alpha, clamp=clamp, start=start, tolerance=0, max_iterations=6)
    expected = reference(task, alpha=alpha, clamp=clamp, iterations=6, start=start)
    assert (dense_weights(mesh, clamp=False) < -1e-3).any()  # else clamping would change nothing
    assert np.abs(result.vertices - expected).max() < 1e-9 * mesh.diagonal


@pytest.mark.parametrize(("subdivisions", "iterations"), BAR)
def test_measured_figures_of_the_bar(subdivisions, iterations):
    task = bent_bar(subdivisions)
    result = arap_sr(task, clamp=False, tolerance=0, max_iterations=iterations)
    np.testing.assert_allclose(errors(task, result.vertices), BAR[subdivisions, iterations], rtol=0.1)


def test_without_smoothness_and_clamping_it_is_arap(body):
    task = held_ends(body)
    ours = arap_sr(task, alpha=0, clamp=False, tolerance=0, max_iterations=30)
    theirs = arap(task, tolerance=0, max_iterations=30)
    assert np.abs(ours.vertices - theirs.vertices).max() < 1e-4 * body.diagonal  # libigl's float32


def test_a_large_alpha_leaves_one_rotation(body):
    rotations = arap_sr(held_ends(body), alpha=1e6, max_iterations=200).extra["rotations"]
    assert np.abs(rotations - rotations[0]).max() < 1e-3
    loose = arap_sr(held_ends(body), alpha=1e-4, max_iterations=200).extra["rotations"]
    assert np.abs(loose - loose[0]).max() > 0.5


def test_converges_and_holds_the_handles(body):
    task = held_ends(body)
    result = arap_sr(task, tolerance=1e-6, max_iterations=3000)
    assert result.converged and result.iterations < 3000 and result.extra["residual"] < 1e-6
    np.testing.assert_array_equal(result.vertices[task.handles.index], task.handles.target)


def test_a_rigid_start_ends_at_once_where_the_motion_is_rigid(body):
    R, t = Rotation.from_rotvec([1.0, -2.0, 0.5]).as_matrix(), np.array([3.0, 0, -1])
    index = np.arange(0, body.n, 40)
    task = DeformationTask("rigid", body, Handles(index, body.V[index] @ R.T + t))
    result = arap_sr(task, start="rigid")
    assert result.iterations == 1 and result.converged
    assert np.abs(result.vertices - (body.V @ R.T + t)).max() < 1e-9 * body.diagonal


def test_permuted_vertices_change_little(body):
    """The colours change, and with them the order of the sweep, but not what it converges to."""
    order = np.random.default_rng(0).permutation(body.n)
    place = np.argsort(order)
    task = held_ends(body)
    other = DeformationTask(
        "permuted",
        Mesh(body.V[order], place[body.F]),
        Handles(place[task.handles.index], task.handles.target),
    )
    one, two = (arap_sr(t, tolerance=1e-9, max_iterations=5000).vertices for t in (task, other))
    assert np.abs(two[place] - one).max() < 1e-5 * body.diagonal


@pytest.mark.parametrize("name", family())
def test_colours_are_a_greedy_colouring(name):
    mesh = family()[name]
    colour = vertex_colours(mesh)
    a, b = colour[mesh.edges].T
    assert (a != b).all() and colour.min() == 0
    neighbours = [set() for _ in range(mesh.n)]
    for i, j in mesh.edges:
        neighbours[i].add(colour[j])
        neighbours[j].add(colour[i])
    assert all(set(range(colour[i])) <= neighbours[i] for i in range(mesh.n))
    assert colour.max() <= 10


def test_several_components(small_body):
    n = small_body.n
    both = Mesh(
        np.concatenate([small_body.V, double_torus().V + 9]),
        np.concatenate([small_body.F, double_torus().F + n]),
    )
    index = np.array([0, 5, n, n + 7])
    result = arap_sr(DeformationTask("two", both, Handles(index, both.V[index])), max_iterations=5)
    assert np.abs(result.vertices - both.V).max() < 1e-9


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"alpha": -0.1}, "alpha=-0.1 is out of range"),
        ({"alpha": np.inf}, "alpha=inf"),
        ({"alpha": np.nan}, "alpha=nan"),
    ],
)
def test_bad_parameters_are_refused(small_body, change, message):
    with pytest.raises(InputError, match=message):
        arap_sr(held_ends(small_body), **change)


def test_begins_from_the_guess_of_the_task(body):
    """Its rotations are fitted to the guess: from the result, one iteration is as small as the last."""
    task = held_ends(body)
    result = arap_sr(task, alpha=1e-5, tolerance=1e-5, max_iterations=2000)
    again = DeformationTask("again", body, task.handles, guess=result.vertices)
    assert result.converged
    moves = [
        np.abs(arap_sr(t, alpha=1e-5, tolerance=0, max_iterations=1).vertices - result.vertices).max()
        for t in (again, task)
    ]
    assert moves[0] < 1e-4 * body.diagonal
    assert moves[1] > 1e-2 * body.diagonal


def test_the_change_of_rotations_is_part_of_the_residual(body):
    """A rest shape is; the change of a rotation is that of its quaternion, whatever the sign."""
    task = DeformationTask("still", body, Handles(np.arange(4), body.V[:4]), guess=body.V)
    assert arap_sr(task, max_iterations=1).converged
    before, after = (
        np.tile([1.0, 0, 0, 0], (2, 1)),
        np.array([[-1.0, 0, 0, 0], [np.cos(0.1), np.sin(0.1), 0, 0]]),
    )
    assert largest_turn(after, before) == pytest.approx(2 * np.sin(0.05), rel=1e-12)
    assert largest_turn(after[:1], before[:1]) == 0


@pytest.mark.parametrize("mesh", [bumpy(3), jittered(tube(), 0.02)], ids=["closed", "boundary"])
def test_acceleration_reaches_the_same_minimum_sooner(mesh):
    task = held_ends(mesh, axis=int(np.argmax(np.ptp(mesh.V, axis=0))))
    plain, fast = (arap_sr(task, tolerance=1e-9, max_iterations=2000, accelerate=a) for a in (False, True))
    assert plain.converged and fast.converged
    assert fast.iterations < plain.iterations / 3
    assert np.abs(fast.vertices - plain.vertices).max() < 1e-6 * mesh.diagonal
    R = fast.extra["rotations"]
    assert np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max() < 1e-12


def test_an_acceleration_that_always_begins_anew_is_the_plain_iteration(body, monkeypatch):
    monkeypatch.setattr("baselines.arap_sr.arap_sr.LONGER", 0.0)
    task = held_ends(body)
    plain = arap_sr(task, tolerance=0, max_iterations=40)
    restarted = arap_sr(task, tolerance=0, max_iterations=40, accelerate=True)
    assert restarted.extra["restarts"] == 38  # not after the first step, and no mixing after the last
    assert plain.extra["restarts"] == 0
    assert np.abs(restarted.vertices - plain.vertices).max() < 1e-12 * body.diagonal
