"""Handles of vertex groups and their motions, without Blender."""

import numpy as np
import pytest

from sshade import Mesh
from sshade.blender.rig import STILL, Rig, RigGroup, rigid
from sshade.edit.groups import Motion
from tests.shapes import bumpy


def weights(n, vertices, weight=1.0):
    found = np.zeros(n, dtype=np.float32)
    found[vertices] = weight
    return found


def rig_of(mesh: Mesh, *, weight=1.0) -> Rig:
    order = np.argsort(mesh.V[:, 2])
    low, high = weights(mesh.n, order[:60]), weights(mesh.n, order[-60:], weight)
    groups = [RigGroup("low", low, False), RigGroup("high", high, True)]
    return Rig(mesh.V.astype(np.float32), mesh.F, groups)


@pytest.mark.parametrize("angle", [0.7, 3.0])
def test_a_rigid_matrix_in_single_precision_is_its_motion(angle):
    c, s = np.cos(angle), np.sin(angle)
    matrix = np.array([[c, -s, 0, 1], [s, c, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])
    motion = rigid(matrix.astype(np.float32))
    assert np.abs(motion.R - matrix[:3, :3]).max() < 1e-6 and np.abs(motion.t - [1, 2, 3]).max() < 1e-6
    assert np.abs(motion.R @ motion.R.T - np.eye(3)).max() < 1e-14


def test_a_translation_has_no_rotation_and_the_identity_no_motion():
    matrix = np.eye(4)
    assert rigid(matrix + 1e-8) is STILL
    matrix[0, 3] = 2.0
    assert np.array_equal(rigid(matrix + 1e-8).R, np.eye(3))


@pytest.mark.parametrize(("g", "weight"), [(0.9995, np.inf), (0.99, 99.0), (0.2, 0.25)])
def test_the_weight_in_a_group_is_the_weight_of_a_handle(g, weight):
    handles = rig_of(bumpy(2), weight=g).handles
    assert handles.weight[handles.group == 1] == pytest.approx(weight, rel=1e-4)
    assert np.isinf(handles.weight[handles.group == 0]).all()


def test_copies_along_a_seam_move_as_one_and_loose_vertices_stay():
    mesh = bumpy(2)
    # No two faces share a vertex, so all edges are seams.
    V = np.vstack([mesh.V[mesh.F].reshape(-1, 3), [[9.0, 9.0, 9.0]]]).astype(np.float32)
    F = np.arange(3 * mesh.m).reshape(-1, 3)
    low, high = (weights(len(V), np.flatnonzero(mask)) for mask in (V[:, 2] < -1.5, V[:, 2] > 1.5))
    high[-1] = 0
    high[np.flatnonzero(high)[::2]] = 0.5  # of copies of a vertex the largest weight counts
    rig = Rig(V, F, [RigGroup("low", low, False), RigGroup("high", high, True)])
    assert rig.mesh.n == mesh.n
    place = np.unique(V[high > 0.9], axis=0)
    assert np.isinf(rig.handles.weight[rig.handles.group == 1]).sum() == len(place)
    U, _ = rig.deform([STILL, Motion(np.eye(3), np.array([0.5, 0.0, 0.0]))])
    assert np.array_equal(U[-1], V[-1]) and np.abs(U - V).max() > 0.4
    order = np.lexsort(V[:-1].T)
    same = (V[:-1][order][1:] == V[:-1][order][:-1]).all(axis=1)
    assert same.sum() > mesh.m and np.array_equal(U[:-1][order][1:][same], U[:-1][order][:-1][same])
