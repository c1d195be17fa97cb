import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation

from baselines.accelerated import local_global
from sshade import DeformationTask, Handles, Mesh
from sshade.core.threads import ThreadTeam
from sshade.solver.aim import Aim
from sshade.solver.multigrid import ConjugateGradients, Multigrid, VCycle
from sshade.solver.solution import Solution
from tests.shapes import bumpy, held_ends, jittered, tube
from tests.sshade.solver.solver import Solver
from tests.sshade.solver.test_multigrid import CASES, matrix

#: A turn by 30 degrees about x.
TILT = Rotation.from_rotvec([np.pi / 6, 0.0, 0.0]).as_matrix()
BALL = held_ends(bumpy(3))
#: Tasks of several topologies, with regions, single vertices or soft handles, and with faces without area.
TASKS = {"region": BALL, "boundary": held_ends(jittered(tube(30, 30), 0.02), axis=2, share=0.1, turn=TILT)}
SOFT = {"stiffness": 0.1, "strain": 0.02}
EXACT = {"volume": np.inf, "area": np.inf}


@pytest.fixture(autouse=True)
def _several_levels(monkeypatch):
    """Make the coarsest level small, because these meshes have only about a thousand vertices."""
    monkeypatch.setattr("sshade.solver.multigrid.COARSEST", 50)


def flattened(task: DeformationTask, faces: int = 40) -> DeformationTask:
    """Return the task with two corners of some faces moved to one place, away from the handles."""
    F = task.mesh.F[~np.isin(task.mesh.F, task.handles.index).any(axis=1)]
    chosen, V = F[np.random.default_rng(0).choice(len(F), faces, replace=False)], task.mesh.V.copy()
    V[chosen[:, 0]] = V[chosen[:, 1]]
    return DeformationTask("flattened", Mesh(V, task.mesh.F), task.handles)


def pulled(task: DeformationTask) -> DeformationTask:
    """Return the task with soft handles at the moved end, each with a different weight."""
    own = task.handles
    weight = np.where(own.dynamic, np.linspace(1.0, 10.0, len(own)), np.inf)
    return DeformationTask("pulled", task.mesh, Handles(own.index, own.target, weight=weight))


TASKS |= {"faces without area": flattened(BALL), "pulled": pulled(held_ends(BALL.mesh, turn=TILT))}


def solve(task: DeformationTask, *, multigrid: bool, energy="spokes_and_rims", **options) -> Solution:
    own = task.handles
    solver = Solver(task.mesh, own.index, energy=energy, stiffness=own.stiffness, multigrid=multigrid)
    return solver.solve(Aim(task.handles.target), **options)


@pytest.mark.parametrize("name", TASKS)
def test_a_cycle_ends_in_the_minimum_that_a_factorisation_finds(name):
    task, options = TASKS[name], {**SOFT, "volume": np.inf, "area": 1.0}
    limits = {"tolerance": 1e-7, "max_iterations": 3000}
    exact, cycle = (solve(task, multigrid=multigrid, **limits, **options) for multigrid in (False, True))
    assert exact.converged and cycle.converged
    assert cycle.energy == pytest.approx(exact.energy, rel=1e-4)
    assert np.abs(cycle.positions - exact.positions).max() < 2e-3 * task.mesh.diagonal
    assert cycle.constraints.volume_constraint == exact.constraints.volume_constraint
    assert cycle.constraints.area_constraint == exact.constraints.area_constraint
    hard = task.handles.hard
    assert np.array_equal(cycle.positions[task.handles.index[hard]], task.handles.target[hard])


def test_as_many_steps_reach_as_low_where_triangles_soften():
    """The metric knows which triangles are soft."""
    options = {**SOFT, **EXACT, "tolerance": 0, "max_iterations": 20}
    start = solve(BALL, multigrid=False, **options | {"max_iterations": 0}).energy
    exact, cycle = (solve(BALL, multigrid=multigrid, **options) for multigrid in (False, True))
    assert start - cycle.energy > 0.994 * (start - exact.energy)


@pytest.mark.parametrize(
    ("name", "options"),  # the spokes energy is far below 0 if faces have no area
    [(name, {}) for name in TASKS]
    + [("region", {"energy": "spokes"}), ("pulled", {"energy": "spokes"}), ("region", {"bending": 0.03})],
)
def test_without_a_factorisation_the_minimum_and_the_test_that_ends_are_the_same(name, options):
    task, found = TASKS[name], []
    for factorised in (True, False):
        result = local_global(task, **options, factorised=factorised, tolerance=1e-6, max_iterations=3000)
        assert result.converged
        found.append(result)
    exact, cycles = found
    assert cycles.extra["energy"] == pytest.approx(exact.extra["energy"], rel=1e-4)
    assert np.abs(cycles.vertices - exact.vertices).max() < 3e-3 * task.mesh.diagonal
    # An exact step from the result is as short as the last residual, up to the error of conjugate gradients.
    own = task.handles
    solver = Solver(task.mesh, own.index, stiffness=own.stiffness, **options)
    there = {"start": cycles.vertices, "rotations": cycles.extra["rotations"], "accelerate": False}
    step = solver.solve(Aim(own.target), **there, tolerance=0, max_iterations=1)
    assert step.residual < 1.1e-6


def test_large_meshes_are_not_factorised_by_default(monkeypatch):
    def energy(**options) -> float:
        return local_global(BALL, tolerance=0, max_iterations=30, **options).extra["energy"]

    assert energy() == energy(factorised=True) != energy(factorised=False)
    monkeypatch.setattr("sshade.solver.local_global.FACTORISED", BALL.mesh.n - 1)
    assert energy() == energy(factorised=False)


def test_bits_do_not_depend_on_threads(monkeypatch):
    for place in ("core.threads.ROWS", "solver.laplacian.CHUNK", "solver.multigrid.PRODUCTS"):
        monkeypatch.setattr(f"sshade.{place}", 300)
    options = {**SOFT, **EXACT, "tolerance": 0, "max_iterations": 12, "multigrid": True}
    one, two, three = (solve(BALL, workers=workers, **options) for workers in (1, 2, 3))
    assert np.array_equal(one.positions, two.positions) and np.array_equal(one.positions, three.positions)
    assert one.energy == two.energy == three.energy


# --- conjugate gradients


def solved(name: str, tolerance: float):
    A, held = matrix(name)
    free = ~held
    B = np.random.default_rng(0).normal(size=(len(held), 3)) * [1.0, 1e3, 0.0]
    B[held] = 0.0
    X, multigrid = np.full_like(B, np.nan), Multigrid(A, held)
    with ThreadTeam(1) as team:
        VCycle(multigrid, np.flatnonzero(held)).solve(B, X, team)
        ConjugateGradients(multigrid, np.flatnonzero(held), steps=1).refine(B, X, tolerance, team)
    return A[free][:, free], B[free], X[free], X[held]


@pytest.mark.parametrize("tolerance", [1e-1, 1e-2, 1e-3])
@pytest.mark.parametrize("name", CASES)
def test_each_column_is_as_near_as_asked_for(name, tolerance):
    A, B, X, held = solved(name, tolerance)
    assert not held.any() and not X[:, 2].any()
    exact = spsolve(A.tocsc(), B[:, :2])
    error = X[:, :2] - exact
    left = np.sqrt((error * (A @ error)).sum(axis=0) / (exact * (A @ exact)).sum(axis=0))
    # Cycles leave a fraction of an error, and their estimates of energies are off by the same fraction. In
    # single precision, cotangents of 1e5 beside cotangents of 1 leave three digits.
    single = 0.1 if name == "faces without area" else 1e-5
    assert (left < max(tolerance / np.sqrt(1 - CASES[name][2]), single)).all()
