"""Soft handles and prescribed rotations from end to end: methods, regions, components, resolution."""

from functools import partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.accelerated import local_global
from sshade import DeformationTask, Handles, Mesh
from sshade.mesh.rigid import rigid_motion
from tests.shapes import beside, bumpy, moved_parts, rotation, shifted, strip
from tests.sshade.method.calls import METHODS

BODY = bumpy(4)
ORDER = np.argsort(BODY.V[:, 2], kind="stable")
LOW, HIGH = ORDER[:20], ORDER[-20:]
#: Half of the vertices, in two handle regions. A proxy has only some of them as samples.
REGIONS = np.r_[ORDER[: BODY.n // 4], ORDER[-BODY.n // 4 :]]


def task_of(weight, *, index=None, lift=(0.3, 0.0, 0.2), mesh=BODY) -> DeformationTask:
    """Return a task that fixes the lower handles and pulls the upper handles with `weight`."""
    index = np.r_[LOW, HIGH] if index is None else index
    upper = mesh.V[index, 2] > 0
    target = mesh.V[index] + np.where(upper[:, None], lift, 0)
    weights = np.where(upper, weight, np.inf)
    return DeformationTask("soft", mesh, Handles(index, target, group=upper, weight=weights))


def followed(task: DeformationTask, V: np.ndarray) -> float:
    """Return the mean fraction of the way to their targets that the soft handles moved."""
    own, soft = task.handles, ~task.handles.hard
    way = own.target[soft] - task.mesh.V[own.index[soft]]
    gone = V[own.index[soft]] - task.mesh.V[own.index[soft]]
    return float((gone * way).sum() / (way * way).sum())


@pytest.mark.parametrize("index", [None, REGIONS], ids=["landmarks", "regions"])
@pytest.mark.parametrize("name", METHODS)
def test_methods_pull_soft_handles_as_far_as_the_minimum_at_full_resolution_does(name, index):
    """Without constraints, softening, attachment and joints, all methods have the same minimum."""
    plain = {"volume": 0.0, "area": 0.0, "stiffness": 1.0, "attachment": 0.0, "joints": 0, "bending": 0.0}
    same = {} if name == "paper" else plain
    if name == "fine":
        same["polish_iterations"] = 300
    gone = {}
    for weight in (0.05, 0.5, 1e6):
        task = task_of(weight, index=index)
        result = METHODS[name](task, vertices=600, **same)
        own, V = task.handles, result.vertices
        reference = local_global(task, start="rigid", tolerance=1e-6).vertices
        gone[weight] = followed(task, V)
        assert gone[weight] == pytest.approx(followed(task, reference), abs=0.01 if name == "fine" else 0.08)
        gap = np.linalg.norm(V[own.index[own.hard]] - own.target[own.hard], axis=1).max()
        assert gap < 1e-2 * BODY.diagonal if name == "paper" and index is None else gap < 1e-9
    assert 0.05 < gone[0.05] < gone[0.5] - 0.05 < gone[1e6] == pytest.approx(1, abs=2e-2)


@pytest.mark.parametrize("weight", [0.5, 5.0, 1e4])
def test_a_soft_handle_inside_a_hard_region_moves_as_far_as_its_weight_says(weight):
    tip = REGIONS[np.argmax(BODY.V[REGIONS, 2])]
    index = np.r_[np.setdiff1d(REGIONS, tip), tip]
    target = np.concatenate([BODY.V[index[:-1]], BODY.V[[tip]] + [0, 0, 0.2]])
    group = np.r_[(BODY.V[index[:-1], 2] > 0).astype(int), 2]
    weights = np.r_[np.full(len(index) - 1, np.inf), weight]
    task = DeformationTask("tip", BODY, Handles(index, target, group=group, weight=weights))
    way = followed(task, local_global(task, start="rigid", tolerance=1e-7).vertices)
    same = {"volume": 0.0, "area": 0.0, "stiffness": 1.0, "attachment": 0.0, "joints": 0, "bending": 0.0}
    for name, error in (("fast", 0.2), ("fine", 0.01)):
        V = METHODS[name](task, vertices=600, **same).vertices
        assert followed(task, V) == pytest.approx(way, rel=error)
        assert np.array_equal(V[index[:-1]], BODY.V[index[:-1]])
    assert 0.1 < way < 1.0


def test_components_share_a_group_and_keep_its_stiffness():
    """Two distant bodies each have half of each group. Each moves like a single body with half the weight."""
    own = task_of(1.0).handles
    both = beside(BODY, shifted(BODY, 50))
    pair = Handles(
        np.r_[own.index, own.index + BODY.n],
        np.concatenate([own.target, own.target + 50]),
        group=np.r_[own.group, own.group],
        weight=np.r_[own.weight, own.weight],
    )
    joint = METHODS["fast"](DeformationTask("pair", both, pair), vertices=1200).vertices
    alone = METHODS["fast"](task_of(0.5), vertices=joint.shape[0] // 8).vertices
    assert followed(task_of(0.5), joint[: BODY.n]) == pytest.approx(followed(task_of(0.5), alone), abs=0.02)


COARSE = bumpy(3)


def turn(degrees: float, axis: str = "z") -> np.ndarray:
    return Rotation.from_euler(axis, degrees, degrees=True).as_matrix()


def sheet(cells: int, *, degrees: float, axis: str = "z") -> DeformationTask:
    """Return a unit square with a fixed border and a middle that is turned in place."""
    given = strip(cells, cells)
    mesh = Mesh(given.V / cells, given.F)
    away = np.abs(mesh.V[:, :2] - 0.5).max(axis=1)
    parts = (away > 0.5 - 1e-9, 0), (away < 1e-9, 0)
    return DeformationTask("sheet", mesh, moved_parts(mesh.V, *parts, rotations=[None, turn(degrees, axis)]))


def turned_about(mesh: Mesh, V: np.ndarray, centre: np.ndarray, radius: float) -> np.ndarray:
    """Return the rotation that best fits the motion of the vertices within a radius of `centre`."""
    near = np.linalg.norm(mesh.V - centre, axis=1) < radius
    return rigid_motion(mesh.V[near], V[near])[0]


def degrees_of(R: np.ndarray) -> float:
    return float(np.degrees(Rotation.from_matrix(R).magnitude()))


@pytest.mark.parametrize("name", METHODS)
def test_rotations_of_a_rigid_motion_change_nothing(name):
    R, shift = rotation(2), np.array([1.0, -2, 0.5])
    index = np.argsort(COARSE.V[:, 2])[[0, 1, 2, -3, -2, -1]]
    own = Handles(index, COARSE.V[index] @ R.T + shift, rotation=np.broadcast_to(R, (6, 3, 3)))
    options = {"proxy_method": partial(local_global, start="rigid")} if name == "paper" else {}
    V = METHODS[name](DeformationTask("rigid", COARSE, own), vertices=150, **options).vertices
    assert np.abs(V - COARSE.V @ R.T - shift).max() < 1e-6


@pytest.mark.parametrize("axis", ["z", "x"])
@pytest.mark.parametrize("name", ["fast", "fine"])
def test_the_middle_of_a_sheet_follows_a_turn_of_60_degrees(name, axis):
    """The axis is normal to the sheet or lies in the sheet.

    A mesh with four times the vertices turns by the same angle if the proxy has the same size.
    """
    angles = []
    for cells in (40, 80):
        task = sheet(cells, degrees=60, axis=axis)
        result = METHODS[name](task, vertices=300, area=0.0)
        V = result.vertices
        assert np.abs(V[task.handles.index] - task.handles.target).max() < 1e-9
        R = turned_about(task.mesh, V, np.array([0.5, 0.5, 0]), 0.03)
        vector = Rotation.from_matrix(R).as_rotvec(degrees=True)
        assert np.linalg.norm(vector - degrees_of(R) * np.eye(3)["xyz".index(axis)]) < 6
        angles.append(degrees_of(R))
        free = METHODS[name](sheet(cells, degrees=0), vertices=300, area=0.0).vertices
        assert np.abs(free - task.mesh.V).max() < 1e-5
    assert 56 < min(angles) <= max(angles) < 61
    assert abs(angles[0] - angles[1]) < (1.5 if name == "fast" else 0.8)
