"""Where the solve on a proxy begins: on a coarser proxy, and at the minimum of the guide energy."""

from dataclasses import replace
from functools import partial
from threading import Event
from time import sleep

import numpy as np
import pytest

from baselines.accelerated import local_global as solved_alone
from sshade import DeformationTask, Handles, InputError
from sshade.method import proxy_solver
from sshade.method.proxy_solver import ProxySolver
from sshade.problem.options import Options
from sshade.proxy import sample
from sshade.solver.solution import Solution
from tests.shapes import bent, beside, bumpy, moved_parts, shifted
from tests.sshade.mesh.test_cutting import t_fin
from tests.sshade.method.calls import METHODS, fast

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


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("mesh", [bumpy(4), beside(bumpy(3), shifted(bumpy(3), 9)), t_fin(8)])
def test_the_seed_reaches_every_sampling(always, monkeypatch, name, mesh):
    """Of coarser proxies, of each component, and of joined ones."""
    seeds, choose = [], sample._random_other_vertex
    monkeypatch.setattr(
        sample, "_random_other_vertex", lambda n, taken, seed: seeds.append(seed) or choose(n, taken, seed)
    )
    V, component = mesh.V, mesh.component
    ends = [np.argsort(V[:, 1] + 100 * (component == c))[:3] for c in range(component.max() + 1)]
    ends += [np.argsort(-V[:, 1] + 100 * (component == c))[:3] for c in range(component.max() + 1)]
    own = moved_parts(V, *((ids, np.array([0, 0.3, 0.2]) * k) for k, ids in enumerate(ends)))
    METHODS[name](DeformationTask("t", mesh, own), vertices=400, coarser=2, seed=7)
    assert len(seeds) > 1 and {np.ravel(seed)[0] for seed in seeds} == {7}


@pytest.mark.parametrize(
    ("smallest", "step", "guess"),
    [(10_000, 1000, False), (100, 3, False), (100, 1000, True), (100, 1000, False)],
    ids=["small", "many handles", "from a guess", "refused"],
)
def test_without_a_coarser_proxy_it_is_the_solver_alone(task, monkeypatch, caplog, smallest, step, guess):
    def refuses(*_):
        raise InputError("too thin")

    caplog.set_level("INFO")
    monkeypatch.setattr("sshade.method.proxy_solver.SMALLEST", smallest)
    monkeypatch.setattr("sshade.method.proxy_solver.proxy_mesh", refuses)
    index, V = np.arange(0, task.mesh.n, step), bent(task.mesh.V)
    task = replace(task, handles=Handles(index, V[index]), guess=V if guess else None)
    found, alone = solve(task), SOLVER(task)
    assert np.array_equal(found.positions, alone.vertices)
    assert found.coarser_iterations == (None if guess else 0.0)
    assert ("solved without a coarser proxy" in caplog.text) == (smallest < step and not guess)


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
