"""Soft handles: the minimum of an independent energy, limits, invariance, and the meaning of a weight."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.accelerated import local_global
from sshade import DeformationTask, Handles, InputError, Mesh
from sshade.solver.aim import initial_guess
from tests.shapes import bumpy, moved_parts, rotation
from tests.sshade.naive import Naive, vertex_areas

BODY = bumpy(2)
#: Options that make errors of the solver far smaller than the differences that the tests measure.
EXACT = {"tolerance": 1e-11, "max_iterations": 20_000}


def task_of(mesh: Mesh, *, weight=5.0, held=(), **more) -> DeformationTask:
    """Return a task with two soft groups, of which the upper is turned and moved, and hard handles."""
    order, R = np.argsort(mesh.V[:, 2], kind="stable"), rotation()
    turned = order[-6:], lambda V: V @ R.T + [0.3, 0, 0.1]
    weights = [weight, weight, np.inf]
    own = moved_parts(mesh.V, (order[:6], 0), turned, (list(held), 0), weights=weights, **more)
    return DeformationTask("soft", mesh, own)


def energy(task: DeformationTask, P: np.ndarray, *, kind: str) -> float:
    """Return the energy of the definition, with each edge counted once, plus the pulls of soft handles."""
    naive, handles = Naive(task, kind), task.handles
    R = naive.rotations(P)
    if (prescribed := handles.prescribed_rotations) is not None:
        R[prescribed[0]] = prescribed[1]
    total = naive.energy(P, R) / (2 if kind == "spokes" else 3)
    area = vertex_areas(task.mesh)
    for group in np.unique(handles.group[np.isfinite(handles.weight)]):
        own = handles.group == group
        at, w = handles.index[own], handles.weight[own]
        squares = w * ((P[at] - handles.target[own]) ** 2).sum(1)
        total += float(np.average(squares, weights=area[at]))
    return total


@pytest.mark.parametrize("kind", ["spokes", "spokes_and_rims"])
@pytest.mark.parametrize(
    ("held", "turns"), [((), None), ((0, 5, 9), None), ((0, 5, 9), [None, rotation(4), rotation(5)])]
)
def test_the_minimum_is_stationary_in_an_energy_of_its_own(kind, held, turns):
    """Some or no handles are hard, and some groups have prescribed rotations."""
    task = task_of(BODY, held=held, rotations=turns)
    result = local_global(task, energy=kind, start="rigid", **EXACT)
    P, at = result.vertices, energy(task, result.vertices, kind=kind)
    factor = 2 if kind == "spokes" else 3
    assert result.extra["energy"] == pytest.approx(factor * at, rel=1e-9)
    free = np.setdiff1d(np.arange(BODY.n), held)
    rng = np.random.default_rng(3)
    for vertex in rng.choice(free, 5, replace=False).tolist() + task.handles.index[[0, 8]].tolist():
        step = np.zeros_like(P)
        step[vertex] = rng.normal(size=3)
        step *= 1e-4 / np.linalg.norm(step)
        slope = (energy(task, P + step, kind=kind) - energy(task, P - step, kind=kind)) / 2e-4
        assert abs(slope) < 2e-6
        assert energy(task, P + 10 * step, kind=kind) > at
    # Without the pull, the shape is no minimum: the spring of a soft handle has a force.
    k, target = task.handles.stiffness[8], task.handles.target[8]
    assert np.linalg.norm(2 * k * (P[task.handles.index[8]] - target)) > 0.01


def test_a_rigid_start_fits_soft_handles_by_their_weights():
    own = task_of(BODY).handles
    index, target = own.index, own.target + np.eye(3)[own.index % 3]
    task = DeformationTask("soft", BODY, Handles(index, target, group=own.group, weight=1.0 + index % 7))
    start, weights = initial_guess(task, "rigid"), task.handles.stiffness
    rest, goal = (X - np.average(X, axis=0, weights=weights) for X in (BODY.V[index], target))
    turn = Rotation.align_vectors(goal, rest, weights=weights)[0]
    np.testing.assert_allclose(start - start[0], turn.apply(BODY.V - BODY.V[0]), atol=1e-9)


def test_weights_near_0_leave_no_definite_matrix():
    with pytest.raises(InputError, match="weights near 0"):
        local_global(DeformationTask("m", BODY, Handles([0], BODY.V[:1], weight=1e-30)))
