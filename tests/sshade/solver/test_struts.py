"""Struts between opposite vertices keep the local thickness."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sshade
from sshade import DeformationTask, Deformer, Mesh
from sshade.mesh.boxes import opposite_vertices
from tests.shapes import moved_parts, tube


def hose(wall: float, *, around: int = 32, along: int = 40, length: float = 8.0) -> Mesh:
    """A tube with a wall: an outer and an inner cylinder, joined at both ends."""
    outer = tube(around, along, length=length)
    inner = outer.V * [1 - wall, 1 - wall, 1]
    F = np.concatenate([outer.F, outer.F[:, ::-1] + outer.n])
    for ring, flip in ((0, 1), (outer.n - around, -1)):
        a = ring + np.arange(around)
        b = ring + (np.arange(around) + 1) % around
        for ends in ((a, b, b + outer.n), (a, b + outer.n, a + outer.n)):
            F = np.concatenate([F, np.stack(ends, axis=1)[:, ::-flip]])
    return Mesh(np.concatenate([outer.V, inner]), F)


HOSE = hose(0.25)


def bend_task(mesh: Mesh) -> DeformationTask:
    """One end of the mesh turned by 60 degrees."""
    z, turn = mesh.V[:, 2], Rotation.from_rotvec([0, np.pi / 3, 0])
    turned = z > 7.3, lambda V: turn.apply(V - [0, 0, 8.0]) + [3.6, 0, 6.3]
    return DeformationTask("t", mesh, moved_parts(mesh.V, (z < 0.7, 0), turned))


@pytest.mark.parametrize("method", ["fast", "fine"])
def test_a_bent_wall_keeps_its_thickness(method):
    task = bend_task(HOSE)
    i, j = opposite_vertices(HOSE)
    rest = np.linalg.norm(HOSE.V[i] - HOSE.V[j], axis=1)
    change = {}
    for weight in (0.0, 3.0):
        V = sshade.deform(task, method=method, thickness=weight, joints=0).vertices
        if method == "fast":
            drag = Deformer(HOSE, task.handles.index, group=task.handles.group, thickness=weight, joints=0)
            assert np.abs(drag.step(task.handles.target).vertices - V).max() < 5e-3
        change[weight] = np.abs(np.linalg.norm(V[i] - V[j], axis=1) / rest - 1)
    assert np.median(change[3.0]) < 0.02 and change[3.0].mean() < 0.5 * change[0.0].mean()
