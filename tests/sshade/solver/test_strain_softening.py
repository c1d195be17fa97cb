import numpy as np
import pytest

from baselines.accelerated import local_global
from sshade import DeformationTask, InputError, Mesh
from sshade.solver.aim import Aim
from sshade.solver.laplacian import half_cotangents
from tests.sshade.naive import TASKS
from tests.sshade.solver.solver import Solver

SOFT = {"stiffness": 0.2, "strain": 0.03}
LIMITED = {**SOFT, "strain_limit": 0.12}


@pytest.fixture(params=[SOFT, LIMITED], ids=["soft", "limited"])
def soft(request) -> dict[str, float]:
    return request.param


@pytest.fixture(params=list(TASKS))
def task(request) -> DeformationTask:
    return TASKS[request.param]


def triangle_energies(mesh: Mesh, U: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Return the spokes-and-rims energy of each triangle.

    The energy compares the edges with the rest edges, turned by the rotation of each corner.
    """
    h, total = half_cotangents(mesh), np.zeros(mesh.m)
    for edge, (a, b) in enumerate(((0, 1), (1, 2), (2, 0))):
        rest = mesh.V[mesh.F[:, a]] - mesh.V[mesh.F[:, b]]
        now = U[mesh.F[:, a]] - U[mesh.F[:, b]]
        for corner in range(3):
            turned = np.einsum("tij,tj->ti", R[mesh.F[:, corner]], rest)
            total += h[:, edge] * ((now - turned) ** 2).sum(axis=1)
    return total


def penalty(x: np.ndarray, *, stiffness: float, strain: float, strain_limit: float = np.inf) -> np.ndarray:
    huber = 2 * strain**2 * (np.sqrt(1 + x / strain**2) - 1)
    return stiffness * x + (1 - stiffness) * (huber + x * (1 - 1 / np.sqrt(1 + x**2 / strain_limit**4)))


def softened_energy(mesh: Mesh, U: np.ndarray, R: np.ndarray, **soft: float) -> float:
    rest = 6 * mesh.face_areas
    return float((rest * penalty(triangle_energies(mesh, U, R) / rest, **soft)).sum())


def solver_of(task: DeformationTask) -> Solver:
    return Solver(task.mesh, task.handles.index)


def test_the_energy_is_that_of_the_definition(task, soft):
    solution = solver_of(task).solve(Aim(task.handles.target), max_iterations=7, tolerance=0, **soft)
    expected = softened_energy(task.mesh, solution.positions, solution.rotations, **soft)
    assert solution.energy == pytest.approx(expected, rel=1e-9)


def test_it_ends_where_the_energy_is_stationary(task, soft):
    """With the final rotations, no random direction of the free vertices lowers the energy."""
    solver = solver_of(task)
    ended = solver.solve(Aim(task.handles.target), tolerance=1e-10, max_iterations=20_000, **soft)
    assert ended.converged
    rng, free = np.random.default_rng(0), np.ones(task.mesh.n, dtype=bool)
    free[task.handles.index] = False
    step = 1e-5 * task.mesh.diagonal
    for _ in range(3):
        d = rng.normal(size=task.mesh.V.shape) * free[:, None]
        around = (ended.positions + s * step * d for s in (1, -1))
        sides = [softened_energy(task.mesh, U, ended.rotations, **soft) for U in around]
        slope = abs(sides[0] - sides[1])
        curvature = sides[0] + sides[1] - 2 * ended.energy
        assert curvature > 0 and slope < 1e-3 * curvature


def test_a_softened_laplacian_reaches_the_same_minimum_in_fewer_iterations(task):
    solver, target = solver_of(task), task.handles.target
    rough = solver.solve(Aim(target), tolerance=1e-3, max_iterations=5000, **SOFT)
    ends = {
        softened: solver.solve(
            Aim(target), start=rough.positions, softened=softened, tolerance=1e-8, max_iterations=5000, **SOFT
        )
        for softened in (False, True)
    }
    assert ends[True].converged and ends[False].converged
    assert ends[True].energy == pytest.approx(ends[False].energy, rel=1e-6)
    assert ends[True].iterations < ends[False].iterations
    plain, same = (solver.solve(Aim(target), max_iterations=9, softened=on) for on in (False, True))
    assert np.array_equal(plain.positions, same.positions)  # without softening
    with pytest.raises(InputError, match="only triangles soften"):
        local_global(task, stiffness=0.5, energy="spokes")
