"""Metrics of flat, inverted and thin faces, of tails and creases; values that runs of a task share."""

import gc
import weakref

import numpy as np
import pytest
import trimesh

from eval.metrics import Deformed, measure
from eval.metrics.deformation import collapsed, distortion, distortion_max
from eval.metrics.shape import MeasuredShape, ShapeTopology, weighted_percentile
from sshade import DeformationTask, Handles, Mesh
from tests.shapes import bumpy, rotation


def task(mesh: Mesh) -> DeformationTask:
    index = np.array([0, mesh.n - 1])
    return DeformationTask("task", mesh, Handles(index, mesh.V[index], group=np.arange(2)))


def shape(V: np.ndarray, F: np.ndarray) -> MeasuredShape:
    return MeasuredShape(ShapeTopology(F, len(V)), V)


def test_zero_area_rest_faces_are_left_out_and_counted():
    V = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0], [3, 0, 0], [0, 0, 1]])
    F = np.array([[0, 1, 2], [0, 3, 4], [0, 2, 5], [3, 4, 5]])
    moved = V.copy()
    moved[2] = [0, 2, 0]
    mesh = Mesh(V, F)
    found = measure(task(mesh), moved)
    assert found["zero_area_faces"] == 1
    before, after = (shape(X, F).corner_angles[[0, 2, 3]] for X in (V, moved))
    assert found["angle_relative"] == pytest.approx(100 * (np.abs(after - before) / before).mean())


def test_flips_face_by_face():
    mesh = bumpy(2)
    moved = mesh.V + np.random.default_rng(0).normal(0, 0.05 * mesh.diagonal, mesh.V.shape)

    def opposed(V: np.ndarray) -> np.ndarray:
        surface = trimesh.Trimesh(V, mesh.F, process=False)
        around = np.zeros((mesh.m, 3))
        for one, two in surface.face_adjacency:
            around[one] += surface.face_normals[two]
            around[two] += surface.face_normals[one]
        return (surface.face_normals * around).sum(axis=1) < 0

    assert not opposed(mesh.V).any() and measure(task(mesh), moved)["flips"] == opposed(moved).sum() > 0
    # Folds of the rest shape do not count.
    assert measure(task(Mesh(moved, mesh.F)), moved)["flips"] == 0


def test_what_is_measured_of_a_mesh_goes_with_the_mesh():
    mesh = bumpy(1)
    assert measure(task(mesh), mesh.V)["edge"] == 0
    gone = weakref.ref(mesh)
    del mesh
    gc.collect()
    assert gone() is None


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_a_rigid_motion_is_no_deformation(scale):
    mesh = bumpy()
    mesh = Mesh(scale * mesh.V, mesh.F)
    moved = mesh.V @ rotation(3).T + scale * np.array([3.0, -2.0, 1.0])
    found = measure(task(mesh), moved)
    assert found.pop("handle") > 1
    assert found == pytest.approx(dict.fromkeys(found, 0.0), abs=1e-5)


def test_a_face_that_loses_its_area_is_infinitely_distorted_and_one_without_is_left_out():
    V = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0, 0]])
    mesh = Mesh(V, np.array([[0, 3, 2], [3, 1, 2], [0, 1, 3]]))  # the last face has no area
    assert np.isnan(Deformed(task(mesh), V).singular_values[0][2])
    assert distortion_max(Deformed(task(mesh), V)) == pytest.approx(0.0, abs=1e-12)
    assert collapsed(Deformed(task(mesh), V)) == 0
    flat = V * [1.0, 0.0, 1.0]
    lost = Deformed(task(mesh), flat)
    assert np.isinf(lost.dirichlet[:2]).all() and np.isinf(distortion(lost)) and collapsed(lost) == 2
    assert np.isnan(weighted_percentile(np.empty(0), np.empty(0), 50.0))
