"""Joints become round, volumes yield, and what hardly strains is left alone."""

import igl
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sshade import DeformationTask, deform
from sshade.mesh.boxes import distances, opposite_vertices
from sshade.solver.aim import PRESSURE
from sshade.solver.joints import BAND, MARGIN, hold
from tests.shapes import bumpy, icosphere, jittered, moved_parts, strip, tube

LIMB = tube(32, 90, length=9.0)


def bent_limb(angle: float) -> DeformationTask:
    """A limb whose upper end is turned about an axis across its middle."""
    z = LIMB.V[:, 2]
    low, high = np.flatnonzero(z < 1.0), np.flatnonzero(z > 8.0)
    turn = Rotation.from_rotvec([np.radians(angle), 0, 0])
    centre = np.array([0, 0, 4.5])
    handles = moved_parts(LIMB.V, (low, 0), (high, lambda V: centre + turn.apply(V - centre)))
    return DeformationTask("limb", LIMB, handles)


def test_where_nothing_strains_the_bits_are_those_without_joints():
    small = bent_limb(1.0)
    without, found = (deform(small, joints=joints, vertices=700, tolerance=1e-5) for joints in (0, 1))
    rough = deform(small, joints=0, vertices=700, tolerance=2e-5)
    assert np.array_equal(found.vertices, rough.vertices)
    assert np.abs(found.vertices - without.vertices).max() < 1e-3 * LIMB.diagonal


def test_what_hardly_strains_is_held_and_the_hold_fades_towards_joints():
    mesh = LIMB
    P = mesh.V * [1, 1, 1.0]
    joint = np.abs(mesh.V[:, 2] - 4.5) < 0.4
    P[joint] *= [1.3, 1.3, 1]
    held = hold(mesh, P)
    distance = np.maximum(np.abs(mesh.V[:, 2] - 4.5) - 0.5, 0) / mesh.diagonal
    assert held[joint].max() == 0.0 and held[distance > 1.5 * (MARGIN + BAND)].min() == 1.0
    assert ((held > 0) & (held < 1)).any()
    assert hold(mesh, mesh.V @ Rotation.from_rotvec([1, 2, 3]).as_matrix().T) is None


@pytest.mark.parametrize("mesh", [jittered(icosphere(3), 0.02), bumpy(3), tube(20, 40), strip(9, 30)])
def test_searches_in_boxes_find_what_loops_find(mesh):
    V, rng = mesh.V, np.random.default_rng(0)
    some = rng.choice(mesh.n, 40, replace=False)
    offsets = rng.random(40) * mesh.mean_edge
    far = np.linalg.norm(V[:, None] - V[some], axis=2) + offsets
    np.testing.assert_allclose(distances(V, V[some], offsets), far.min(axis=1), rtol=1e-12)
    first, second = opposite_vertices(mesh)
    inward = -igl.per_vertex_normals(V, np.array(mesh.F), igl.PER_VERTEX_NORMALS_WEIGHTING_TYPE_AREA)
    assert (np.einsum("pd,pd->p", inward[first], inward[second]) <= -0.5 + 1e-9).all()
    # No vertex lies inside of the largest ball that touches a vertex, if that ball ends at the opposite one.
    arm = V[None] - V[first][:, None]
    along = np.einsum("pnd,pd->pn", arm, inward[first])
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = np.where(along > 1e-12, (arm**2).sum(axis=2) / (2 * along), np.inf)
    least = radius.argmin(axis=1)
    opposite = np.einsum("pd,pd->p", inward[first], inward[least]) <= -0.5
    nearest = np.take_along_axis(radius, least[:, None], 1)[:, 0]
    found = radius[np.arange(len(first)), second]
    assert (len(first) > 0.9 * mesh.n) == V[:, 2].any()  # a flat sheet has no opposite sides
    assert opposite.any() or len(first) == 0 or np.allclose(np.linalg.norm(V, axis=1), 1, atol=0.1)  # a ball
    np.testing.assert_allclose(found[opposite], nearest[opposite], rtol=1e-6)


def pushed(share: float, push: float) -> DeformationTask:
    """A ball on which everything is fixed but a disc, whose middle is pushed."""
    ball = icosphere(4)
    order = np.argsort(-ball.V[:, 2])
    free = order[: int(share * ball.n)]
    core, held = free[: max(len(free) // 6, 7)], order[len(free) :]
    return DeformationTask("disc", ball, moved_parts(ball.V, (held, 0), (core, [0, 0, push])))


@pytest.mark.parametrize(("share", "push"), [(0.03, 0.1), (0.12, 0.2), (0.12, -0.2), (0.3, 0.2)])
def test_a_volume_yields_before_a_moat_is_dug(share, push):
    task = pushed(share, push)
    ring = np.setdiff1d(np.arange(task.mesh.n), task.handles.index)

    def sink(V: np.ndarray) -> float:
        return float(-((V - task.mesh.V)[ring, 2] / push).min())

    found, exact = deform(task), deform(task, volume_goal=1.0)
    assert found.facts.volume_constraint == "yielding" and found.converged
    assert exact.facts.volume_constraint == "exact"  # a goal is never limited
    assert sink(found.vertices) < 0.02 < sink(exact.vertices)


def test_handles_that_imply_another_volume_meet_the_largest_pressure():
    ball = icosphere(4)
    some = np.arange(0, ball.n, 8)
    found = deform(DeformationTask("larger", ball, moved_parts(ball.V, (some, lambda V: 1.1 * V))))
    assert found.facts.volume_constraint == "yielding"
    assert found.facts.volume_pressure == pytest.approx(-PRESSURE[0])


def test_the_shape_does_not_jump_where_fixed_handles_begin_to_move():
    task = pushed(0.3, 0.2)
    core = task.handles.target[:, 2] > 1.1
    shapes = [
        deform(task.at(task.handles.at(task.handles.target + np.outer(~core, [move, 0, 0])))).vertices
        for move in np.linspace(0, 0.03, 16)
    ]
    steps = [np.abs(b - a).max() for a, b in zip(shapes, shapes[1:], strict=False)]
    assert max(steps) < 0.1 * 0.2
