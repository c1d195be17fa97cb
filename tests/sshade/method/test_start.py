"""Where the solve on a proxy begins: on a coarser proxy, and at the minimum of the guide energy."""

from dataclasses import replace
from functools import partial
from threading import Event
from time import sleep

import numpy as np
import pytest

from baselines.accelerated import local_global as solved_alone
from sshade import DeformationTask, Handles
from sshade.method import proxy_solver
from sshade.method.proxy_solver import ProxySolver
from sshade.problem.options import Options
from sshade.solver.solution import Solution
from tests.shapes import bent, bumpy
from tests.sshade.method.calls import fast

SOLVER = partial(solved_alone, volume=np.inf, start="rest", max_iterations=5000)
OPTIONS = Options(volume=np.inf, max_iterations=5000, multilevel=True)


def solve(task, *, volume_goal=1.0, **changes) -> Solution:
    """Solve a task as a proxy's."""
    options = replace(OPTIONS, **changes)
    solver = ProxySolver(task.mesh, options, guess=task.guess)
    return solver.solve(task.handles, volume_goal=volume_goal, stop=options.stop)


@pytest.fixture
def task() -> DeformationTask:
    mesh = bumpy(4)
    index = np.flatnonzero(np.abs(mesh.V[:, 2]) > 0.85 * np.abs(mesh.V[:, 2]).max())
    return DeformationTask("bent", mesh, Handles(index, bent(mesh.V)[index]))


@pytest.fixture
def always(monkeypatch) -> None:
    monkeypatch.setattr("sshade.method.proxy_solver.SMALLEST", 100)


def test_it_ends_in_the_same_minimum_with_fewer_iterations(task, always):
    assert fast(task, vertices=task.mesh.n // 2).facts.coarser_iterations > 0
    alone = SOLVER(task, tolerance=1e-7)
    found = solve(task, tolerance=1e-7)
    assert found.converged and found.coarser_iterations > 5
    assert found.iterations < alone.iterations
    assert found.energy == pytest.approx(alone.extra["energy"], rel=1e-6)
    assert np.abs(found.positions - alone.vertices).max() < 1e-4 * task.mesh.diagonal


@pytest.mark.parametrize("levels", [1, 2])
@pytest.mark.parametrize("ratio", [0.5, 0.89, 0.91, 2.0])
def test_the_guide_decides_unless_another_start_ends_clearly_lower(monkeypatch, task, levels, ratio):
    """The solver has the energy 1 from the result of the guide, and the energy `ratio` without a guess."""
    monkeypatch.setattr("sshade.method.proxy_solver.SMALLEST", 100 if levels == 2 else 10_000)
    far = np.array([3.0, 0.0, 0.0])
    begun = []

    def solver(system, aim, options, *, start, stop, softened=False, **_):
        mesh = system.mesh
        if options.attachment == options.guide_attachment:
            return Solution(mesh.V + far, None, 1, True)
        own = not softened and np.median(np.linalg.norm(start - mesh.V, axis=1)) < 1
        begun.append((mesh.n, own))
        assert stop.tolerance == (1 if mesh is task.mesh else 10) * OPTIONS.stop.tolerance
        return Solution(mesh.V if own else start, None, 1, True, energy=ratio if own else 1.0)

    monkeypatch.setattr(proxy_solver, "solve", solver)
    found = solve(task, guide_attachment=3.0)
    own_wins = ratio < 0.9
    moved = np.linalg.norm(found.positions - task.mesh.V, axis=1)
    if levels == 1:
        assert np.median(moved) == pytest.approx(0 if own_wins else 3)
        assert sorted(begun) == [(task.mesh.n, False), (task.mesh.n, True)]  # at the same time
    else:
        assert np.median(moved) < 0.1 if own_wins else np.median(moved) > 2.9
        assert sorted(own for _, own in begun[:2]) == [False, True]
        assert not begun[2][1] and begun[2][0] == task.mesh.n > begun[0][0]


def test_an_interrupt_of_one_start_ends_the_other(task, monkeypatch):
    begun, reports = Event(), []

    def solver(system, aim, options, *, progress, **_):
        if options.attachment == options.guide_attachment:
            begun.wait()
            raise KeyboardInterrupt
        begun.set()
        while len(reports) < 1000:
            reports.append(progress("iterations", len(reports), 1000))
            sleep(0.005)

    monkeypatch.setattr(proxy_solver, "solve", solver)
    with pytest.raises(KeyboardInterrupt):
        solve(task, guide_attachment=3.0)
    assert len(reports) < 1000
