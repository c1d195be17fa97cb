"""Measures of tails and creases, against closed forms, rigid motions and other libraries."""

import numpy as np
import pytest

from eval.metrics import Deformed, measure
from eval.metrics.detail import detail
from eval.metrics.distortion import collapsed, distortion, distortion_max
from eval.metrics.shape import Topology, weighted_percentile
from sshade import DeformationTask, Handles, Mesh
from tests.shapes import bumpy, rotation, strip


def task(mesh: Mesh) -> DeformationTask:
    index = np.array([0, mesh.n - 1])
    return DeformationTask("task", mesh, Handles(index, mesh.V[index], group=np.arange(2)))


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


def test_edges_of_boundaries_of_three_faces_and_of_opposed_winding_have_no_angle():
    mesh = strip(4, 2)
    inner = len(mesh.edges) - len(mesh.boundary_edges)
    assert Topology(mesh.F, mesh.n).dihedral.shape[1] == inner
    assert Topology(np.array([[0, 1, 2], [0, 1, 3]]), 5).dihedral.shape[1] == 0
    assert Topology(np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]]), 5).dihedral.shape[1] == 0
    assert Topology(np.array([[0, 1, 2], [1, 0, 3]]), 5).dihedral.shape[1] == 1


def test_detail_turns_with_the_surface_and_is_lost_where_relief_is_mirrored():
    mesh = strip(14, 14)
    relief = mesh.V + 0.02 * np.random.default_rng(0).standard_normal(mesh.n)[:, None] * [0, 0, 1.0]
    mesh = Mesh(relief, mesh.F)
    assert detail(Deformed(task(mesh), mesh.V * [1.0, 1.0, -1.0])) == pytest.approx(180.0, abs=15.0)
    flat = strip(11, 11)
    assert np.isnan(detail(Deformed(task(flat), flat.V)))
