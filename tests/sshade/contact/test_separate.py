"""Self-intersections are resolved: by the counts of the test for them, and nothing else changes."""

from __future__ import annotations

import numpy as np
import pytest

from sshade import DeformationTask, Handles, InputError, Mesh
from sshade.contact.flips import new_flips
from sshade.contact.intersections import new_crossings
from sshade.contact.separate import separate
from sshade.pipeline.fine import sshade_fine
from sshade.solver.volume_area import CLOSE
from tests.shapes import bumpy, icosphere

SPHERE = icosphere(4)
BACK = np.flatnonzero(SPHERE.V[:, 0] < -0.9)


def dented(depth: float) -> np.ndarray:
    """The sphere's front pushed in, from a depth of 1.9 on out through its back."""
    V = SPHERE.V.copy()
    around = V[:, 1] ** 2 + V[:, 2] ** 2
    V[:, 0] -= np.where(V[:, 0] > 0, depth * np.exp(-8 * around), 0.0)
    return V


def intersecting_or_inverted(mesh: Mesh, V: np.ndarray) -> int:
    return int((new_crossings(mesh, V) | new_flips(mesh, V)).sum())


def bent_body(degrees: float) -> DeformationTask:
    """A body whose ends are turned towards each other."""
    mesh, half = bumpy(4), np.radians(degrees / 2)
    ends, targets = [], []
    for end, turn in ((mesh.V[:, 2] > 1.8, half), (mesh.V[:, 2] < -1.8, -half)):
        c, s = np.cos(turn), np.sin(turn)
        ends.append(np.flatnonzero(end))
        shift = [0, 0, -0.5 * np.sign(turn)]
        targets.append(mesh.V[end] @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]]).T + shift)
    return DeformationTask("bent", mesh, Handles(np.concatenate(ends), np.concatenate(targets)))


@pytest.mark.parametrize("depth", [2.0, 2.05, 2.1])
def test_a_dent_that_comes_out_at_the_back_goes_back_in(depth):
    V = dented(depth)
    found = separate(SPHERE, V, BACK)
    assert found.before == intersecting_or_inverted(SPHERE, V) > 0
    assert found.after == intersecting_or_inverted(SPHERE, found.positions) == 0
    assert np.array_equal(found.positions[BACK], V[BACK])
    # Only what is near the dent's tip moves.
    moved = np.linalg.norm(found.positions - V, axis=1)
    assert 0 < moved.max() < 0.7
    equator = np.abs(SPHERE.V[:, 0]) < 0.1
    assert not moved[equator].any()


def test_what_does_not_cross_stays_to_the_bit():
    V = dented(1.5)
    found = separate(SPHERE, V, BACK)
    assert found[1:4] == (0, 0, 0) and np.array_equal(found.positions, V)


def test_what_crosses_at_rest_may_go_on_crossing():
    V = dented(2.0)
    found = separate(Mesh(V, SPHERE.F), V + [0.5, 0, 0], BACK)
    assert found[1:4] == (0, 0, 0)


def test_without_rounds_all_stays_and_is_counted():
    V = dented(2.0)
    found = separate(SPHERE, V, BACK, rounds=0)
    assert found.before == found.after > 0 and found.rounds == 0 and np.array_equal(found.positions, V)


def test_a_rigid_motion_and_a_scale_move_the_result_along():
    V, turn = dented(2.0), np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    here = separate(SPHERE, V, BACK)
    there = separate(Mesh(4 * SPHERE.V, SPHERE.F), 4 * V @ turn.T + 1, BACK)
    assert there[1:4] == here[1:4]
    assert np.abs(there.positions - (4 * here.positions @ turn.T + 1)).max() < 1e-6


def test_threads_and_reruns_give_the_same_bits():
    V = dented(2.0)
    first = separate(SPHERE, V, BACK)
    for workers in (1, 3):
        assert np.array_equal(separate(SPHERE, V, BACK, workers=workers).positions, first.positions)


def test_positions_that_are_not_of_the_mesh():
    with pytest.raises(InputError, match="finite and of shape"):
        separate(SPHERE, SPHERE.V[1:], BACK)
    with pytest.raises(InputError, match="finite and of shape"):
        separate(SPHERE, np.full_like(SPHERE.V, np.nan), BACK)


def test_a_flipped_fan_is_smoothed_out():
    V = SPHERE.V.copy()
    V[100] = 0.9 * V[100] + 0.35 * np.cross(V[100], [0.0, 0.0, 1.0])  # out of its ring
    assert new_flips(SPHERE, V).any()
    found = separate(SPHERE, V, BACK)
    assert found.before > 0 == found.after == intersecting_or_inverted(SPHERE, found.positions)


def test_the_polish_ends_apart_with_handles_and_volume_exact():
    task, options = bent_body(50), {"vertices": 700, "polish_iterations": 30}
    through = sshade_fine(task, contact=False, **options)
    apart = sshade_fine(task, **options)
    assert (
        intersecting_or_inverted(task.mesh, through.vertices)
        == apart.extra["intersecting_or_inverted_polished"]
        > 20
    )
    assert apart.extra["intersecting_or_inverted"] == intersecting_or_inverted(task.mesh, apart.vertices) < 5
    assert np.array_equal(apart.vertices[task.handles.index], task.handles.target)
    assert apart.extra["volume_error"] <= CLOSE
    assert apart.iterations == through.iterations and apart.extra["residual"] == through.extra["residual"]
    assert through.extra["energy"] < apart.extra["energy"]  # what was separated is stretched
