"""Inertia pulls the surface towards the majority motion of the handles, and lets go of what must move."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

import sshade
from eval.metrics import Deformed
from sshade import DeformationTask, Deformer, Handles, Mesh
from sshade.method import proxy_solver
from sshade.problem.majority import LEAST, HandleGroups, MajorityMotion
from sshade.problem.options import Options
from sshade.solver import local_global
from sshade.solver.aim import Aim
from sshade.solver.bound_handles import BoundHandles
from sshade.solver.ordered_mesh import OrderedMesh
from sshade.solver.terms.inertia import Inertia
from tests.shapes import beside, block, held_ends, of_all, rotation, shifted, tube
from tests.sshade.naive import Naive
from tests.sshade.solver.solver import Solver


def doll(cells: int) -> Mesh:
    """Two legs, a trunk, two arms and a head, of cubes."""
    solid = np.zeros((7, 1, 8))
    solid[[2, 4], :, :3] = solid[2:5, :, 3:7] = solid[:, :, 5] = solid[3, :, 7] = 1
    mesh = block(solid, cells=cells)
    return shifted(mesh, -mesh.V.min(axis=0))


DOLL = doll(2)
#: Where the feet, the head and the hands are.
PARTS = [
    lambda V: (V[:, 2] < 0.1) & (V[:, 0] < 3.5),
    lambda V: (V[:, 2] < 0.1) & (V[:, 0] > 3.5),
    lambda V: V[:, 2] > 7.9,
    lambda V: V[:, 0] < 0.1,
    lambda V: V[:, 0] > 6.9,
]
FINEST = {"vertices": DOLL.n, "coarser": 1}
FORWARD = [0.0, -0.8, 0.6]


def arms_moved(mesh: Mesh, move: float) -> DeformationTask:
    """Both hands move forward and up, by a fraction of the diagonal."""
    index = [np.flatnonzero(part(mesh.V)) for part in PARTS]
    group = np.repeat(np.arange(len(PARTS)), [len(own) for own in index])
    handle = np.concatenate(index)
    target = mesh.V[handle] + (group >= LEAST)[:, None] * move * mesh.diagonal * np.array(FORWARD)
    return DeformationTask("arms", mesh, Handles(handle, target, group=group))


def majority_of(task: DeformationTask) -> MajorityMotion:
    handles = task.handles
    return HandleGroups(task.mesh, handles.index, handles.group).motion(handles.target)


def some_motion() -> MajorityMotion:
    return replace(majority_of(arms_moved(DOLL, 0.2)), rotation=rotation(2), certainty=0.7)


def one_term(motion: MajorityMotion) -> tuple[Inertia, np.ndarray]:
    options = Options(inertia=2.5)
    ordered = OrderedMesh(DOLL, "spokes_and_rims")
    term = Inertia.bound(ordered, BoundHandles.of(ordered, np.array([0]), None), options).begun(options)
    term.aim(Aim(np.zeros((1, 3)), majority=motion))
    return term, term.matrix("mesh")


def test_the_forces_are_the_gradient_of_the_formula():
    motion = some_motion()
    term, stiffness = one_term(motion)
    U = motion.moved(DOLL.V) + np.random.default_rng(0).normal(size=(DOLL.n, 3)) * motion.reach
    x = ((U - motion.moved(DOLL.V)) ** 2).sum(axis=1)
    P = (U - DOLL.origin)[OrderedMesh(DOLL, "spokes_and_rims").vertex]
    energy, B = term.local(0, P, np.empty(0)), np.zeros_like(P)
    assert energy == pytest.approx(3 * 0.7 * (stiffness * x / (1 + x / motion.reach**2)).sum(), rel=1e-12)
    assert term.forces(0, P, np.empty(0), B) == pytest.approx(energy, rel=1e-12)
    for seed in range(5):
        Z = np.random.default_rng(seed).normal(size=P.shape)
        up, down = (term.local(0, P + sign * 1e-5 * Z, np.empty(0)) for sign in (1, -1))
        assert (up - down) / 2e-5 == pytest.approx(-2 * 3 * (B * Z).sum(), rel=1e-6)


@pytest.mark.parametrize("multigrid", [False, True])
def test_an_independent_minimiser_ends_at_the_same_shape(multigrid):
    task = arms_moved(doll(1), 0.1)
    mesh, weight = task.mesh, 3.0
    motion, naive = majority_of(task), Naive(task, "spokes_and_rims")
    solver = Solver(mesh, task.handles.index, inertia=weight, multigrid=multigrid, exact_steps=20)
    stop = {"tolerance": 1e-9, "max_iterations": 3000}
    ours = solver.solve(Aim(task.handles.target, majority=motion), **stop)
    stiffness = (weight * mesh.vertex_areas / mesh.area)[naive.free]
    goal = motion.moved(mesh.V)[naive.free]

    def energy_and_gradient(free):
        U = mesh.V.copy()
        U[task.handles.index], U[naive.free] = task.handles.target, free.reshape(-1, 3)
        R, off = naive.rotations(U), U[naive.free] - goal
        kept = 1 / (1 + (off**2).sum(axis=1) / motion.reach**2)
        energy = naive.energy(U, R) + 3 * (stiffness * (off**2).sum(axis=1) * kept).sum()
        gradient = 6 * (naive.L @ U - naive.right_hand_side(R))[naive.free]
        return energy, (gradient + 6 * (stiffness * kept**2)[:, None] * off).ravel()

    start = ours.positions[naive.free] + 0.02 * np.random.default_rng(0).normal(size=goal.shape)
    found = minimize(
        energy_and_gradient, start.ravel(), jac=True, method="L-BFGS-B", options={"maxiter": 5000, "ftol": 0}
    )
    off = np.abs(found.x.reshape(-1, 3) - ours.positions[naive.free]).max()
    assert off < 1e-4 * mesh.diagonal
    assert ours.energy == pytest.approx(found.fun, rel=1e-7)


@pytest.mark.parametrize("method", ["fast", "fine"])
def test_what_no_handle_moves_stays(method):
    task = arms_moved(DOLL, 0.1)
    legs = DOLL.V[:, 2] < 3.0
    free, held = (sshade.deform(task, method=method, inertia=w, **FINEST) for w in (0, 2.0))
    moved = [np.linalg.norm(result.vertices - DOLL.V, axis=1)[legs].mean() for result in (free, held)]
    assert moved[1] < 0.5 * moved[0]
    assert free.facts.inertia is None and held.facts.inertia == "on"
    assert np.abs(held.vertices[task.handles.index] - task.handles.target).max() < 1e-9


@pytest.mark.parametrize("weight", [0.2, 0.5])
def test_small_and_large_moves_give_similar_fields_without_kinks(weight):
    """Where the pull lets go, the surface neither jumps to another field nor bends more sharply."""
    fields, bends = {}, {}
    for w in (0, weight):
        tasks = {move: arms_moved(DOLL, move) for move in (0.01, 0.1, 0.3)}
        shapes = {
            move: sshade.deform(task, inertia=w, joints=0, **FINEST).vertices for move, task in tasks.items()
        }
        small, large = ((shapes[move] - DOLL.V) / move for move in (0.01, 0.3))
        fields[w] = np.linalg.norm(large - small, axis=1).mean() / np.linalg.norm(small, axis=1).mean()
        bends[w] = np.array([np.sort(Deformed(tasks[m], V).dihedral_changes)[-3] for m, V in shapes.items()])
    assert fields[weight] < fields[0] + 0.05
    assert (bends[weight] < 1.05 * bends[0]).all()


def test_groups_that_stay_decide_although_two_hands_have_longer_levers():
    motion = majority_of(arms_moved(DOLL, 0.3))
    assert motion.state == "on" and motion.certainty == 1.0
    assert np.abs(motion.moved(DOLL.V) - DOLL.V).max() < 1e-3 * DOLL.diagonal


def test_without_a_majority_the_term_is_off_and_a_fact_says_so(caplog):
    bar = held_ends(tube(12, 24))
    parts = [np.flatnonzero(part(DOLL.V)) for part in PARTS]
    group = np.repeat(np.arange(5), [len(own) for own in parts])
    index = np.concatenate(parts)
    apart = DOLL.V[index] + 2.0 * np.random.default_rng(0).normal(size=(5, 3))[group]
    line = np.array([np.argmin(np.abs(tube(12, 24).V - [1, 0, z]).sum(axis=1)) for z in (0, 2, 4, 6)])
    lifted = tube(12, 24).V[line] + np.outer([0, 0, 0, 1], [1.0, 0, 0])
    for task, reason in (
        (bar, "off: fewer than 3 handle groups"),
        (DeformationTask("t", DOLL, Handles(index, apart, group=group)), "off: too few handle groups move"),
        (DeformationTask("t", tube(12, 24), Handles(line, lifted, group=range(4))), "off: the handle groups"),
    ):
        caplog.clear()
        off = sshade.deform(task, inertia=0.5)
        assert off.facts.inertia.startswith(reason) and reason in caplog.text
        assert np.array_equal(off.vertices, sshade.deform(task).vertices)


@pytest.mark.parametrize(("resting", "state"), [(3, "off"), (4, "on")])
def test_a_majority_is_at_least_half_of_the_groups(resting, state):
    index = np.argsort(DOLL.V[:, 1])[:: DOLL.n // 7][:7]
    apart = 2.0 * np.random.default_rng(0).normal(size=(7, 3))  # in one direction they win
    apart[:resting] = 0.0
    motion = HandleGroups(DOLL, index, np.arange(7)).motion(DOLL.V[index] + apart)
    assert motion.state.startswith(state)


def test_in_a_drag_the_motion_does_not_jump_where_the_majority_changes():
    """One part after another moves along, until all have moved. Only a bound prevents jumps."""
    task = arms_moved(DOLL, 0.0)
    rest, group = task.handles.target, task.handles.group
    groups = HandleGroups(DOLL, task.handles.index, group)
    shift, moved, last = 0.3 * DOLL.diagonal * np.random.default_rng(5).normal(size=3), np.zeros((5, 3)), None
    free = groups.motion(rest)
    jumps, most, certain = 0, 0.0, [1.0]
    for part in (3, 4, 2, 1, 0):
        for fraction in np.arange(1, 61) / 60:
            moved[part] = fraction * shift
            target = rest + moved[group]
            motion, step = groups.following(last, target), np.linalg.norm(shift) / 60
            if last is not None and last[0].certainty and motion.certainty:
                most = max(most, np.abs(motion.moved(DOLL.V) - last[0].moved(DOLL.V)).max() / step)
            certain.append(motion.certainty)
            now = groups.motion(target)
            both = free.certainty and now.certainty
            jumps += bool(both and np.abs(now.moved(DOLL.V) - free.moved(DOLL.V)).max() > 10 * step)
            jumps += abs(now.certainty - free.certainty) > 5 * step / motion.reach
            last, free = (motion, target), now
    assert most < 10 and np.abs(np.diff(certain)).max() <= 4 * step / motion.reach + 1e-12
    assert jumps > 0 and min(certain) == 0.0 and motion.certainty == 1.0
    assert np.abs(motion.moved(DOLL.V) - DOLL.V - shift).max() < 1e-3 * DOLL.diagonal


def test_a_drag_ends_at_the_shape_of_a_single_run():
    task = arms_moved(DOLL, 0.1)
    rest, alone = DOLL.V[task.handles.index], sshade.deform(task, inertia=0.5, **FINEST)
    drag = Deformer(DOLL, task.handles.index, group=task.handles.group, inertia=0.5, **FINEST)
    moves = [s * (task.handles.target - rest) for s in np.linspace(0, 1, 21)]
    shapes = [drag.step(rest + move, tolerance=1e-4) for move in moves]
    assert {shape.facts.inertia for shape in shapes} == {"on"}
    steps = [np.abs(b.vertices - a.vertices).max() for a, b in zip(shapes, shapes[1:], strict=False)]
    assert max(steps) < 3 * 0.1 * DOLL.diagonal / 20
    assert np.abs(drag.settle().vertices - alone.vertices).max() < 5e-3 * DOLL.diagonal


def test_all_pieces_of_a_mesh_have_one_motion():
    """A ball with one handle would follow it; the majority is that of the doll and the ball together."""
    task, ball = arms_moved(DOLL, 0.05), shifted(tube(8, 12, length=3.0), [20.0, 0, 0])
    own, both = task.handles, beside(DOLL, ball)
    held = Handles(np.array([0, 95]), ball.V[[0, 95]] + [[0, 0, 0], [0.0, 0.2, 0]])
    joint = DeformationTask("t", both, of_all((own, 0), (replace(held, group=np.array([7, 8])), DOLL.n)))
    result = sshade.deform(joint, inertia=0.5)
    assert result.facts.inertia == "on"
    seen = []
    solve = local_global.solve

    def watched(system, aim, *given, **more):
        seen.append(aim.majority)
        return solve(system, aim, *given, **more)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(proxy_solver, "solve", watched)
        sshade.deform(joint, inertia=0.5)
    assert len(seen) >= 2 and seen[0] is not None and all(motion is seen[0] for motion in seen)
