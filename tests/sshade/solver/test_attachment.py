"""Attachment: by formula, by invariances, without a rigid motion, and its effect on a shape."""

from dataclasses import replace
from typing import NamedTuple
from unittest.mock import Mock

import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.transform import Rotation

from sshade import DeformationTask, Handles, Mesh
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.rigid import rigid_motion
from sshade.problem.options import Options, Stop
from sshade.solver.aim import Aim
from sshade.solver.attachment import LINK, RADIUS, REACH, Attachment
from sshade.solver.descent import Descent
from sshade.solver.drag import LEAST, Drag
from sshade.solver.local_global import bind_system
from tests.shapes import moved_parts, rotation, tube
from tests.sshade.naive import vertex_areas
from tests.sshade.solver.solver import Solver

BAR = tube(24, 90, length=9.0)
TURN = rotation(3)


def patch(mesh: Mesh, point, count: int) -> np.ndarray:
    """Return the vertices nearest to a point."""
    return np.argsort(np.linalg.norm(mesh.V - np.asarray(point), axis=1), kind="stable")[:count]


def two_patches(mesh: Mesh, *, turn=TURN, shift=(0.4, 0.1, 0.2), count=7) -> Handles:
    """Return handles at both ends: the lower patch stays, and the upper patch is turned and shifted."""
    low, high = patch(mesh, [0, 1, mesh.V[:, 2].min()], count), patch(mesh, [0, 1, mesh.V[:, 2].max()], count)
    return moved_parts(mesh.V, (low, 0), (high, lambda V: V @ turn.T + shift))


class Pulled(NamedTuple):
    vertex: np.ndarray
    stiffness: np.ndarray
    target: np.ndarray


def attached(mesh: Mesh, handles: Handles, weight: float) -> Pulled:
    """Return the attachment of a single solve."""
    attachment = Attachment(mesh, handles, weight)
    target, fraction = attachment.pulls(handles.target, handles.rotation)
    pulled = fraction > 0
    return Pulled(attachment.vertex[pulled], (attachment.stiffness * fraction)[pulled], target[pulled])


def test_each_vertex_is_pulled_by_the_motion_of_the_nearest_group():
    handles, weight = two_patches(BAR), 0.3
    pulled = attached(BAR, handles, weight)
    r = RADIUS * np.sqrt(BAR.area)
    V, k, distances = BAR.V, len(handles), []
    for group in (0, 1):
        own = handles.index[handles.group == group]
        away = dijkstra(vertex_graph(BAR).matrix, indices=own, min_only=True)
        distances.append(away + np.linalg.norm(V[own] - V[own].mean(axis=0), axis=1).max())
    d, turns = np.min(distances, axis=0), distances[1] < distances[0]
    at = np.setdiff1d(np.flatnonzero(d < REACH * r), handles.index)
    stiffness = weight * vertex_areas(BAR) / r**2 * np.exp(-((d / r) ** 2))
    goal = np.where(turns[:, None], V @ TURN.T + [0.4, 0.1, 0.2], V)
    assert np.array_equal(pulled.vertex[:k], handles.index) and np.isinf(pulled.stiffness[:k]).all()
    assert np.array_equal(pulled.target[:k], handles.target)
    assert np.array_equal(pulled.vertex[k:], at)
    assert np.allclose(pulled.stiffness[k:], stiffness[at], rtol=1e-9)
    assert np.allclose(pulled.target[k:], goal[at], atol=1e-9)


LINE = np.flatnonzero(np.isclose(BAR.V[:, :2], BAR.V[0, :2]).all(axis=1))[:8]
WITHOUT_A_MOTION = {
    "one": two_patches(BAR, count=1),
    "two": two_patches(BAR, count=2),
    "a line": moved_parts(BAR.V, (LINE, 0)),
    "not rigid": moved_parts(BAR.V, (patch(BAR, [0, 1, 9], 12), lambda V: V * [1.0, 1.0, 4.0])),
    "region": moved_parts(BAR.V, (BAR.V[:, 2] < 7.2, 0)),
}


@pytest.mark.parametrize("case", [*WITHOUT_A_MOTION, "weight 0"])
def test_nothing_is_attached_to_handles_without_a_rigid_motion(case):
    handles = WITHOUT_A_MOTION.get(case, two_patches(BAR))
    pulled = attached(BAR, handles, 0.0 if case == "weight 0" else 0.1)
    assert np.array_equal(pulled.vertex, handles.index)
    options = Options(attachment=0.0 if case == "weight 0" else 0.1)
    bound = bind_system(DeformationTask("bar", BAR, handles), options)
    assert len(bound.aim.targets) == len(handles.index)  # no others are in the system


def test_soft_handles_pull_as_far_as_they_are_held():
    handles, k = two_patches(BAR), 14
    firm = attached(BAR, handles, 0.1).stiffness[k:]
    for weight, fraction in ((1.0, 0.5), (3.0, 0.75), (1e6, 1.0), (1e-6, 1e-6)):
        soft = Handles(handles.index, handles.target, group=handles.group, weight=weight).with_portions(BAR)
        assert np.allclose(attached(BAR, soft, 0.1).stiffness[k:], fraction * firm, rtol=1e-5)


def test_a_prescribed_rotation_attaches_to_a_single_handle():
    index = patch(BAR, [0, 1, BAR.V[:, 2].max()], 1)
    goal = np.array([[0.0, 0.5, 10.0]])
    pulled = attached(BAR, Handles(index, goal, rotation=TURN[None]), 0.1)
    assert len(pulled.vertex) > 10
    R, t = rigid_motion(BAR.V[pulled.vertex[1:]], pulled.target[1:])
    assert np.allclose(R, TURN, atol=1e-9) and np.allclose(R @ BAR.V[index[0]] + t, goal[0], atol=1e-9)


def test_of_several_prescribed_rotations_the_first_decides():
    index = patch(BAR, [0, 1, BAR.V[:, 2].max()], 4)
    turns = np.stack([np.full((3, 3), np.nan), TURN, rotation(1), rotation(2)])
    pulled = attached(BAR, Handles(index, BAR.V[index] @ TURN.T, rotation=turns), 0.1)
    assert np.allclose(rigid_motion(BAR.V[pulled.vertex[4:]], pulled.target[4:])[0], TURN, atol=1e-9)


def test_handles_of_one_group_that_are_far_apart_move_apart():
    apart, pulled = two_patches(BAR), attached(BAR, two_patches(BAR), 0.1)
    ends = np.ptp(BAR.V[:, 2])
    assert ends > 2 * LINK * RADIUS * np.sqrt(BAR.area)
    one_group = Handles(apart.index, apart.target)
    again = attached(BAR, one_group, 0.1)
    assert np.array_equal(again.vertex, pulled.vertex) and np.array_equal(again.target, pulled.target)
    still = Attachment(BAR, two_patches(BAR, turn=np.eye(3)), 0.1)  # targets are not part of it
    assert np.allclose(still.pulls(apart.target)[0], pulled.target, atol=1e-12)


@pytest.mark.parametrize("way", ["straight to a turn of 150 degrees", "flattened"])
def test_a_pull_fades_on_the_way_and_never_jumps(way):
    handles = two_patches(BAR, turn=np.eye(3), count=9)
    attachment, high = Attachment(BAR, handles, 0.1), handles.group == 1
    rest = BAR.V[handles.index[high]]
    centre = rest.mean(axis=0)
    if way == "flattened":  # to the mirror image; halfway the patch is a line
        u, _, vt = np.linalg.svd(rest - centre, full_matrices=False)
        turned = centre + (rest - centre) @ (np.eye(3) - 2 * np.outer(vt[1], vt[1]))
    else:
        turned = centre + (rest - centre) @ Rotation.from_rotvec([0, 0, np.radians(150)]).as_matrix().T
    fractions, pulls = [], []
    for step in np.linspace(0, 1, 401):
        target = handles.target.copy()
        target[high] = rest + step * (turned - rest)
        goal, fraction = attachment.pulls(target)
        own = fraction[len(handles) :], (goal - BAR.V[attachment.vertex])[len(handles) :]
        fractions.append(own[0].min())
        pulls.append(own[0][:, None] * own[1])
    assert max(fractions) == pytest.approx(1.0) and min(fractions) == 0.0
    jumps = [np.abs(b - a).max() for a, b in zip(pulls, pulls[1:], strict=False)]
    assert max(jumps) < 0.1 * np.abs(pulls).max()
    assert np.abs(np.diff(fractions)).max() < 0.05


SHORT_BAR = tube(24, 60, length=6.0)
ENERGY = {"volume": np.inf, "area": np.inf, "stiffness": 0.1, "strain": 0.02}


def handles_at(angle: float) -> Handles:
    """Return handles at both ends of the bar; the upper end is turned and moved."""
    turn = Rotation.from_euler("x", angle).as_matrix()
    return two_patches(SHORT_BAR, turn=turn, shift=[0.1 * angle, 0, 0], count=9)


@pytest.fixture(scope="module")
def attachment() -> Attachment:
    return Attachment(SHORT_BAR, handles_at(0.0), 0.1)


@pytest.fixture(scope="module")
def solver(attachment) -> Solver:
    return Solver(SHORT_BAR, attachment.vertex, stiffness=attachment.stiffness)


def at(attachment: Attachment, angle: float) -> Aim:
    target, fraction = attachment.pulls(handles_at(angle).target)
    return Aim(target, fraction=fraction)


def begun(solver: Solver, attachment: Attachment) -> Drag:
    still = np.broadcast_to(np.eye(3), (SHORT_BAR.n, 3, 3))
    return Drag(solver.system, SHORT_BAR.V, still, at(attachment, 0.0), Options(**ENERGY))


def test_steps_end_in_the_minimum_that_a_solve_from_there_finds(solver, attachment, monkeypatch):
    following, renewed = begun(solver, attachment), Mock(wraps=Descent.project)
    monkeypatch.setattr(Descent, "project", lambda state: renewed(state))
    for angle in np.linspace(0.02, 0.4, 20):
        last = following.solve(at(attachment, angle), Stop(1e-4))
    assert renewed.call_count <= 1  # directions of constraints last from step to step
    assert last.iterations == LEAST  # the last move is repeated
    end = following.solve(at(attachment, 0.4), Stop(1e-9))
    anew = solver.solve(at(attachment, 0.4), start=last.positions, tolerance=1e-9, **ENERGY)
    assert end.converged and anew.converged and end.energy == pytest.approx(anew.energy, rel=1e-6)
    assert np.abs(end.positions - anew.positions).max() < 1e-5 * SHORT_BAR.diagonal
    assert end.constraints.area_error < 1e-6 and end.constraints.area_constraint == "exact"
    assert np.array_equal(end.positions[attachment.vertex[:18]], handles_at(0.4).target)


def test_targets_that_are_shifted_take_the_shape_along_before_any_iteration(solver, attachment):
    """The harmonic extension of a shift is the shift, for hard handles and for vertices with full pull."""
    following, shift = begun(solver, attachment), np.array([0.3, -0.2, 0.5]) * SHORT_BAR.diagonal
    start = at(attachment, 0.0)
    before = following.solve(start, Stop(1e-9))
    after = following.solve(replace(start, targets=start.targets + shift), Stop(1e-4))
    assert after.residual_curve[0] < 1e-8
    assert np.abs(after.positions - before.positions - shift).max() < 1e-7 * SHORT_BAR.diagonal


def test_targets_that_stop_are_not_overshot_and_those_that_turn_back_lead_back(solver, attachment):
    following = begun(solver, attachment)
    for angle in (0.1, 0.2):
        following.solve(at(attachment, angle), Stop(1e-7))
    stopped = following.solve(at(attachment, 0.2), Stop(1e-7))
    assert stopped.iterations <= 3  # the last moving step needs more
    for angle in (0.1, 0.0):
        back = following.solve(at(attachment, angle), Stop(1e-8))
    assert np.abs(back.positions - SHORT_BAR.V).max() < 1e-5 * SHORT_BAR.diagonal


def test_a_fraction_of_a_pull_is_a_weaker_pull_in_the_same_system(solver, attachment):
    """The minimum equals the minimum of a system that is built with the weaker pull."""
    target, fraction = attachment.pulls(handles_at(0.5).target)
    fraction = np.where(np.isinf(attachment.stiffness), 1.0, 0.3)
    weaker_pull = solver.solve(Aim(target, fraction=fraction), tolerance=1e-10, max_iterations=3000)
    weaker = Solver(SHORT_BAR, attachment.vertex, stiffness=attachment.stiffness * fraction)
    expected = weaker.solve(Aim(target), tolerance=1e-10, max_iterations=3000)
    full = solver.solve(Aim(target), tolerance=1e-10, max_iterations=3000)
    assert weaker_pull.energy == pytest.approx(expected.energy, rel=1e-9)
    assert np.abs(weaker_pull.positions - expected.positions).max() < 1e-6 * SHORT_BAR.diagonal
    assert np.abs(weaker_pull.positions - full.positions).max() > 1e-4 * SHORT_BAR.diagonal
