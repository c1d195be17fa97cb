"""Solves that follow moving targets find the minimum of a new solve, without effects of earlier targets."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sshade import Handles
from sshade.problem.options import Options, Stop
from sshade.solver.aim import Aim
from sshade.solver.attachment import Attachment
from sshade.solver.descent import Descent
from sshade.solver.drag import LEAST, Drag
from tests.shapes import tube
from tests.sshade.solver.solver import Solver
from tests.sshade.solver.test_attachment import two_patches

BAR = tube(24, 60, length=6.0)
ENERGY = {"volume": np.inf, "area": np.inf, "stiffness": 0.1, "strain": 0.02}


def handles_at(angle: float) -> Handles:
    """Return handles at both ends of the bar; the upper end is turned and moved."""
    turn = Rotation.from_euler("x", angle).as_matrix()
    return two_patches(BAR, turn=turn, shift=[0.1 * angle, 0, 0], count=9)


@pytest.fixture(scope="module")
def attachment() -> Attachment:
    return Attachment(BAR, handles_at(0.0), 0.1)


@pytest.fixture(scope="module")
def solver(attachment) -> Solver:
    return Solver(BAR, attachment.vertex, stiffness=attachment.stiffness)


def at(attachment: Attachment, angle: float) -> Aim:
    target, fraction = attachment.pulls(handles_at(angle).target)
    return Aim(target, fraction=fraction)


def begun(solver: Solver, attachment: Attachment) -> Drag:
    still = np.broadcast_to(np.eye(3), (BAR.n, 3, 3))
    return Drag(solver.system, BAR.V, still, at(attachment, 0.0), Options(**ENERGY))


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
    assert np.abs(end.positions - anew.positions).max() < 1e-5 * BAR.diagonal
    assert end.constraints.area_error < 1e-6 and end.constraints.area_constraint == "exact"
    assert np.array_equal(end.positions[attachment.vertex[:18]], handles_at(0.4).target)


def test_targets_that_are_shifted_take_the_shape_along_before_any_iteration(solver, attachment):
    """The harmonic extension of a shift is the shift, for hard handles and for vertices with full pull."""
    following, shift = begun(solver, attachment), np.array([0.3, -0.2, 0.5]) * BAR.diagonal
    start = at(attachment, 0.0)
    before = following.solve(start, Stop(1e-9))
    after = following.solve(replace(start, targets=start.targets + shift), Stop(1e-4))
    assert after.residual_curve[0] < 1e-8
    assert np.abs(after.positions - before.positions - shift).max() < 1e-7 * BAR.diagonal


def test_targets_that_stop_are_not_overshot_and_those_that_turn_back_lead_back(solver, attachment):
    following = begun(solver, attachment)
    for angle in (0.1, 0.2):
        following.solve(at(attachment, angle), Stop(1e-7))
    stopped = following.solve(at(attachment, 0.2), Stop(1e-7))
    assert stopped.iterations <= 3  # the last moving step needs more
    for angle in (0.1, 0.0):
        back = following.solve(at(attachment, angle), Stop(1e-8))
    assert np.abs(back.positions - BAR.V).max() < 1e-5 * BAR.diagonal


def test_a_fraction_of_a_pull_is_a_weaker_pull_in_the_same_system(solver, attachment):
    """The minimum equals the minimum of a system that is built with the weaker pull."""
    target, fraction = attachment.pulls(handles_at(0.5).target)
    fraction = np.where(np.isinf(attachment.stiffness), 1.0, 0.3)
    weaker_pull = solver.solve(Aim(target, fraction=fraction), tolerance=1e-10, max_iterations=3000)
    weaker = Solver(BAR, attachment.vertex, stiffness=attachment.stiffness * fraction)
    expected = weaker.solve(Aim(target), tolerance=1e-10, max_iterations=3000)
    full = solver.solve(Aim(target), tolerance=1e-10, max_iterations=3000)
    assert weaker_pull.energy == pytest.approx(expected.energy, rel=1e-9)
    assert np.abs(weaker_pull.positions - expected.positions).max() < 1e-6 * BAR.diagonal
    assert np.abs(weaker_pull.positions - full.positions).max() > 1e-4 * BAR.diagonal
