"""Prescribed rotations of handles: effect, resolution, invariance, levels, and files."""

from functools import partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.accelerated import local_global
from baselines.arap import arap
from sshade import DeformationTask, Handles, InputError, Mesh, deform
from sshade.mesh.rigid import rigid_motion
from tests.shapes import bumpy, moved_parts, rotation, strip
from tests.sshade.method.calls import METHODS

BODY = bumpy(3)


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
    index = np.argsort(BODY.V[:, 2])[[0, 1, 2, -3, -2, -1]]
    own = Handles(index, BODY.V[index] @ R.T + shift, rotation=np.broadcast_to(R, (6, 3, 3)))
    options = {"proxy_method": partial(local_global, start="rigid")} if name == "paper" else {}
    V = METHODS[name](DeformationTask("rigid", BODY, own), vertices=150, **options).vertices
    assert np.abs(V - BODY.V @ R.T - shift).max() < 1e-6


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


def test_arrays_take_one_rotation_for_all_or_one_each_and_others_refuse():
    task = sheet(20, degrees=35)
    mesh, own = task.mesh, task.handles
    U = deform(mesh.V, mesh.F, own.index, own.target, rotations=own.rotation, vertices=100)
    assert np.array_equal(U, METHODS["fast"](task, vertices=100).vertices)
    R = turn(20)
    U = deform(BODY, [3, 9], BODY.V[[3, 9]] @ R.T, rotations=R, vertices=100)
    assert np.abs(U.V - BODY.V @ R.T).max() < 1e-5
    with pytest.raises(InputError, match="takes no rotations"):
        deform(task, method=arap)
    for wrong in (2 * np.eye(3), np.diag([1.0, 1, -1]), [[np.nan, 0, 0], [0, 1, 0], [0, 0, 1]]):
        with pytest.raises(InputError, match="no rotation"):
            deform(BODY, [3, 9], BODY.V[[3, 9]], rotations=wrong)
    with pytest.raises(InputError, match=r"need rotations of shape \(2, 3, 3\)"):
        deform(BODY, [3, 9], BODY.V[[3, 9]], rotations=np.eye(3)[None])
