from dataclasses import replace

import igl
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.accelerated import local_global
from sshade import DeformationTask, Handles, InputError
from sshade.core.threads import ThreadTeam
from sshade.mesh.rotations import fit_rotations
from sshade.solver import local_global as module
from sshade.solver.aim import Aim
from sshade.solver.laplacian import edge_weights, half_cotangents, laplacian_matrix
from sshade.solver.run import largest_move
from tests.shapes import bumpy, icosphere, jittered, rotation, strip, tube
from tests.sshade.naive import TASKS, Naive, svd_rotations
from tests.sshade.solver.solver import Solver

ENERGIES = ("spokes", "spokes_and_rims")
EXACT = 1e-12  # as a fraction of the diagonal
#: Options of the solver: both energies, bending, softening and constraints.
EXTRAS = (
    {"energy": "spokes"},
    {},
    {"bending": 0.05},
    {"bending": 0.05, "stiffness": 0.1, "strain": 0.02},
    {"stiffness": 0.2, "strain": 0.03, "strain_limit": 0.12},
    {"area": np.inf, "stiffness": 0.2},
    {"volume": np.inf},
    {"volume": np.inf, "area": np.inf},
    {"volume": np.inf, "area": 0.2},
    {"volume": 0.7, "area": 0.2},
)
with_extras = pytest.mark.parametrize("extra", EXTRAS, ids=str)


@pytest.fixture(params=list(TASKS))
def task(request) -> DeformationTask:
    return TASKS[request.param]


def solver_of(task: DeformationTask, energy: str = "spokes_and_rims", **options) -> Solver:
    return Solver(task.mesh, task.handles.index, energy=energy, **options)


@pytest.mark.parametrize("energy", ENERGIES)
def test_plain_iterations_equal_the_definition(task, energy):
    solver, naive, U, reported = solver_of(task, energy), Naive(task, energy), task.mesh.V, []
    stop = {"tolerance": 0, "accelerate": False, "progress": lambda *call: reported.append(call[:2])}
    for iterations in range(1, 7):
        U = naive.iterate(U)
        ours = solver.solve(Aim(task.handles.target), max_iterations=iterations, **stop)
        assert np.abs(ours.positions - U).max() < EXACT * task.mesh.diagonal
        assert ours.iterations == len(ours.residual_curve) == iterations and not ours.converged
        assert reported[-2:] == [("iterations", 0), ("iterations", iterations)]
    R = naive.rotations(U)
    assert np.abs(ours.rotations - R).max() < 1e-10
    assert ours.energy == pytest.approx(naive.energy(U, R), rel=1e-10)


@with_extras
def test_acceleration_reaches_the_same_minimum_in_fewer_steps(task, extra):
    # With exact volume and area, the bar has two minima. Begin where the nearest minimum is clear.
    begin = local_global(task, accelerate=False, tolerance=0, max_iterations=30, **extra).vertices
    near = replace(task, guess=begin)
    options = {"tolerance": 1e-8, "max_iterations": 20_000, **extra}
    fast, plain = (local_global(near, accelerate=accelerate, **options) for accelerate in (True, False))
    assert fast.converged and plain.converged
    assert fast.extra["energy"] == pytest.approx(plain.extra["energy"], rel=1e-6)
    assert np.abs(fast.vertices - plain.vertices).max() < 1e-4 * task.mesh.diagonal
    assert fast.iterations < 0.6 * plain.iterations
    assert plain.extra["rejected"] == 0


def test_a_quasi_newton_step_that_raises_the_energy_is_given_up():
    assert local_global(TASKS["bar"], energy="spokes", tolerance=1e-8).extra["rejected"] > 0


@pytest.mark.parametrize("energy", ENERGIES)
def test_converged_means_one_plain_iteration_moves_less_than_the_tolerance(task, energy):
    fast = solver_of(task, energy).solve(Aim(task.handles.target), tolerance=1e-6, max_iterations=20000)
    assert fast.converged and fast.residual < 1e-6
    again = Naive(task, energy).iterate(fast.positions)
    assert largest_move(again, fast.positions) < 1e-6 * task.mesh.diagonal


@with_extras
def test_rigidly_moved_handles_move_the_mesh_rigidly(task, extra):
    mesh, index = task.mesh, task.handles.index
    R, t = rotation(5), np.array([1.0, 2.0, 3.0])
    handles = Handles(index, mesh.V[index] @ R.T + t)
    result = local_global(DeformationTask("rigid", mesh, handles), start="rigid", **extra)
    assert result.iterations == 1 and result.converged
    assert np.abs(result.vertices - (mesh.V @ R.T + t)).max() < EXACT * mesh.diagonal
    assert np.abs(result.extra["rotations"] - R).max() < 1e-10
    assert abs(result.extra["energy"]) < 1e-12 * mesh.area


@pytest.mark.parametrize("energy", ENERGIES)
def test_rotations_to_begin_with_change_the_work_and_not_the_result(task, energy):
    solver, targets = solver_of(task, energy), task.handles.target
    half = solver.solve(Aim(targets), max_iterations=9, tolerance=0)
    options = {"start": half.positions, "max_iterations": 5, "tolerance": 0}
    cold = solver.solve(Aim(targets), **options)
    warm = solver.solve(Aim(targets), rotations=half.rotations, **options)
    assert np.abs(cold.positions - warm.positions).max() < EXACT * task.mesh.diagonal
    assert np.abs(cold.rotations - warm.rotations).max() < 1e-10
    again = solver.solve(Aim(targets), start=half.positions, rotations=half.rotations, max_iterations=0)
    assert np.abs(again.rotations - half.rotations).max() < 1e-12


# --- rotations


def identities(count: int) -> np.ndarray:
    return np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))


def fitted(S: np.ndarray, Q: np.ndarray | None = None) -> np.ndarray:
    R = np.ascontiguousarray(S.reshape(-1, 9)).copy()
    trace = fit_rotations(R, identities(len(S)) if Q is None else Q)
    R = R.reshape(-1, 3, 3)
    assert trace == pytest.approx(np.einsum("nij,nji->", R, S), rel=1e-13)
    return R


#: Changes of random covariances, by the kind that they make.
KINDS = {
    "random": lambda S: S,
    "rank two": lambda S: S[:, :, :2] @ S[:, 1:],
    "nearly rank two": lambda S: S * [1, 1, 1e-9],
    "nearly rank one": lambda S: S * [1, 1e-6, 1e-6],
    "reflected": lambda S: S * -np.sign(np.linalg.det(S))[:, None, None],
    "huge": lambda S: S * 1e150,
    "tiny": lambda S: S * 1e-150,
    "half turns": lambda S: np.tile(np.diag([3.0, -2.0, -1.0]), (len(S), 1, 1)),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("warm", [False, True])
def test_rotations_are_those_of_the_svd(kind, warm):
    S = KINDS[kind](np.random.default_rng(7).normal(size=(2000, 3, 3)))
    Q = identities(len(S))
    if warm:
        near = S @ Rotation.from_rotvec(np.random.default_rng(8).normal(0, 0.02, (len(S), 3))).as_matrix()
        fitted(near, Q)
    R = fitted(S, Q)
    s, sign = np.linalg.svd(S, compute_uv=False), np.sign(np.linalg.det(S / np.abs(S).max()))
    gap = (s[:, 1] + sign * s[:, 2]) / s[:, 0]  # how well determined the rotation is
    assert (np.abs(R - svd_rotations(S)).max(axis=(1, 2)) * gap).max() < 1e-14
    assert np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max() < 1e-14
    assert np.linalg.det(R) == pytest.approx(np.ones(len(R)), abs=1e-14)
    assert np.abs(Rotation.from_quat(Q[:, [1, 2, 3, 0]]).as_matrix() - R).max() < 1e-14


def test_an_undetermined_rotation_stays_near_the_previous_one():
    rng = np.random.default_rng(9)
    before = Rotation.random(200, random_state=3)
    Q = np.ascontiguousarray(before.as_quat()[:, [3, 0, 1, 2]])
    a = rng.normal(size=(200, 3))
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    # Zero: nothing to fit. Rank one and satisfied already: nothing to improve.
    kept = before.as_matrix()
    assert np.abs(fitted(np.zeros((200, 3, 3)), Q.copy()) - kept).max() < 1e-15
    satisfied = np.einsum("ni,nj->nij", a, np.einsum("nij,nj->ni", kept, a))
    assert np.abs(fitted(satisfied, Q.copy()) - kept).max() < 1e-7
    # Rank one and not satisfied: the least turn that carries a to b.
    b = np.roll(a, 1, axis=0)
    R = fitted(np.einsum("ni,nj->nij", a, b), Q.copy())
    assert np.abs(np.einsum("nij,nj->ni", R, a) - b).max() < 1e-12
    turn = (Rotation.from_matrix(R) * before.inv()).magnitude()
    least = np.arccos(np.clip(np.einsum("ni,ni->n", before.apply(a), b), -1, 1))
    assert turn == pytest.approx(least, abs=1e-6)


# --- weights


def test_weights_are_libigls():
    for mesh in (bumpy(2), jittered(strip(6, 4), 0.2), tube()):
        h = half_cotangents(mesh)
        V, F = np.array(mesh.V), np.array(mesh.F)
        assert np.allclose(h, igl.cotmatrix_entries(V, F)[:, [2, 0, 1]], rtol=1e-9, atol=1e-12)
        L = laplacian_matrix(mesh.n, *edge_weights(mesh, h))
        assert np.abs((L + igl.cotmatrix(V, F)).toarray()).max() < 1e-12 * np.abs(h).max()


# --- errors


def test_iterates_that_overflow():
    mesh = icosphere(0)
    with pytest.raises(FloatingPointError, match="not finite after"), np.errstate(all="ignore"):
        Solver(mesh, np.array([0, 1, 2])).solve(Aim(np.array([[1e300, 0, 0], [0, -1e300, 0], [0, 0, 1e300]])))


VOLUME, SOFT_AREA = {"volume": np.inf}, {"area": np.inf, "stiffness": 0.2}


@pytest.mark.parametrize("options", [{}, VOLUME, VOLUME | SOFT_AREA])
@pytest.mark.parametrize("energy", ENERGIES)
def test_ranges_and_workers_change_no_bit(monkeypatch, energy, options):
    if energy == "spokes":  # only triangles soften
        options = {name: value for name, value in options.items() if name != "stiffness"}
    task, options = TASKS["bar"], {"max_iterations": 12, "tolerance": 0, **options}
    soft = np.where(np.arange(len(task.handles)) % 3, np.inf, 0.7)
    bound = {"thickness": 1.0, "bending": 0.05, "stiffness": soft}
    whole = solver_of(task, energy, **bound).solve(Aim(task.handles.target), **options)
    monkeypatch.setattr("sshade.solver.laplacian.CHUNK", 30)
    solver, teams = solver_of(task, energy, **bound), []
    monkeypatch.setattr(module, "ThreadTeam", lambda count: teams.append(count) or ThreadTeam(count))
    parts = [solver.solve(Aim(task.handles.target), workers=workers, **options) for workers in (1, 2, 3)]
    assert teams == [1, 2, 3]
    for part in parts:
        assert np.array_equal(part.positions, whole.positions)
        assert np.array_equal(part.rotations, whole.rotations)
        assert part.energy == parts[0].energy == pytest.approx(whole.energy, rel=1e-13)


@pytest.mark.parametrize("bending", [0.0, 0.05])
@pytest.mark.parametrize("energy", ENERGIES)
def test_other_handles_of_a_solver_are_those_of_a_new_one_bit_for_bit(task, energy, bending):
    mesh, index = task.mesh, task.handles.index
    solver = Solver(mesh, index, energy=energy, bending=bending)
    before = solver.solve(Aim(task.handles.target), max_iterations=5).positions
    others = np.concatenate([index[::2], np.setdiff1d(np.arange(mesh.n), index)[::9]])
    stiffness = np.where(np.arange(len(others)) % 3 == 0, 0.7, np.inf)
    target = mesh.V[others] + 0.1 * mesh.diagonal * (np.arange(len(others)) % 2)[:, None]
    shared = solver.with_handles(others, stiffness=stiffness)
    anew = Solver(mesh, others, energy=energy, stiffness=stiffness, bending=bending)
    pair = [s.solve(Aim(target), max_iterations=5) for s in (shared, anew)]
    np.testing.assert_array_equal(*(solution.positions for solution in pair))
    assert pair[0].energy == pair[1].energy
    back = shared.with_handles(index)
    for same in (solver, back):
        again = same.solve(Aim(task.handles.target), max_iterations=5).positions
        np.testing.assert_array_equal(again, before)


#: A softening energy.
SOFT = {"stiffness": 0.2, "strain": 0.03}


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
