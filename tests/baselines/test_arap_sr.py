"""ARAP-SR against a small dense implementation; its start, its stopping rule, its acceleration."""

import igl
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.arap_sr.arap_sr import arap_sr
from baselines.arap_sr.smooth_rotations import largest_turn, vertex_colours
from defaust.sources.generated.lattices import bar
from sshade import DeformationTask, Handles, Mesh
from sshade.mesh.rigid import rigid_motion
from sshade.solver.aim import initial_guess
from tests.shapes import bumpy, end_handles, held_ends, jittered, strip
from tests.sshade.naive import svd_rotations


def dense_weights(mesh: Mesh, *, clamp: bool) -> np.ndarray:
    """(n, n) cotangent weights from libigl's corners."""
    half = igl.cotmatrix_entries(np.array(mesh.V), np.array(mesh.F))
    half = np.maximum(half, 0.0) if clamp else half
    w = np.zeros((mesh.n, mesh.n))
    for (i, j), own in zip(((1, 2), (2, 0), (0, 1)), half.T, strict=True):
        np.add.at(w, (mesh.F[:, i], mesh.F[:, j]), own)
    return w + w.T


def reference(task, *, alpha, clamp, iterations, start) -> np.ndarray:
    """Run the same iteration with dense matrices, loops and LAPACK's singular value decomposition."""
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
            R[i] = svd_rotations(S[None])[0]
        b = np.zeros((mesh.n, 3))
        for i in range(mesh.n):
            for j in stars[i]:
                b[i] += w[i, j] / 2 * (R[i] + R[j]) @ (mesh.V[i] - mesh.V[j])
        q[free] = np.linalg.solve(L[np.ix_(free, free)], (b - L[:, held] @ q[held])[free])
    return q


@pytest.mark.parametrize("mesh", [bumpy(1), jittered(strip(8, 3), 0.2)], ids=["closed", "boundary"])
@pytest.mark.parametrize("clamp", [True, False], ids=["clamped", "raw"])
@pytest.mark.parametrize(("alpha", "start"), [(0.02, "rest"), (0.02, "rigid"), (0.5, "rest"), (0.0, "rest")])
def test_equals_a_dense_implementation_to_rounding(mesh, clamp, alpha, start):
    task = held_ends(mesh, axis=int(np.argmax(np.ptp(mesh.V, axis=0))))
    result = arap_sr(task, alpha=alpha, clamp=clamp, start=start, tolerance=0, max_iterations=6)
    expected = reference(task, alpha=alpha, clamp=clamp, iterations=6, start=start)
    assert (dense_weights(mesh, clamp=False) < -1e-3).any()  # else clamping would change nothing
    assert np.abs(result.vertices - expected).max() < 1e-9 * mesh.diagonal


def test_the_change_of_rotations_is_part_of_the_residual(body):
    """A task at rest converges at once. `largest_turn` compares quaternions up to their sign."""
    task = DeformationTask("still", body, Handles(np.arange(4), body.V[:4]), guess=body.V)
    assert arap_sr(task, max_iterations=1).converged
    before = np.tile([1.0, 0, 0, 0], (2, 1))
    after = np.array([[-1.0, 0, 0, 0], [np.cos(0.1), np.sin(0.1), 0, 0]])
    assert largest_turn(after, before) == pytest.approx(2 * np.sin(0.05), rel=1e-12)
    assert largest_turn(after[:1], before[:1]) == 0


@pytest.mark.parametrize("vertices", [1500, 2500])
def test_acceleration_from_rest_untwists_a_bar(vertices):
    # Its upper end turns by 135 degrees. Without a check of descent it ends at ten times the energy.
    mesh, turn = Mesh(*bar(vertices, length=4.0)), Rotation.from_euler("z", 135, degrees=True).as_matrix()
    task = DeformationTask("bar", mesh, end_handles(mesh.V, share=0.125, turn=turn))
    options = {"accelerate": True, "tolerance": 1e-6, "max_iterations": 400}
    rest, rigid = (arap_sr(task, start=start, **options) for start in ("rest", "rigid"))
    assert rest.converged and rigid.converged
    assert np.abs(rest.vertices - rigid.vertices).max() < 1e-3 * task.mesh.diagonal
