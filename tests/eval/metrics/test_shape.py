"""Measures of what means hide: closed forms, rigid motions, and other libraries' figures."""

from __future__ import annotations

import numpy as np
import pytest

from eval.metrics import Deformed
from eval.metrics.creases import bend, bend_tail, spike
from eval.metrics.detail import detail
from eval.metrics.distortion import (
    collapsed,
    distortion,
    distortion_95,
    distortion_99,
    distortion_max,
)
from eval.metrics.shape import Shape, Topology, weighted_percentile
from eval.metrics.truth import truth_distance_95, truth_normal
from sshade import DeformationTask, Handles, Mesh
from tests.shapes import bent, bumpy, icosphere, jittered, quads, rotation, strip

ALL = (distortion, distortion_95, distortion_99, distortion_max, collapsed, bend, bend_tail, spike, detail)


def grid(size: int = 12) -> Mesh:
    """A flat square of size x size vertices a unit apart."""
    x, y = np.meshgrid(np.arange(size, dtype=float), np.arange(size, dtype=float), indexing="ij")
    return Mesh(np.stack([x, y, np.zeros_like(x)], axis=2).reshape(-1, 3), quads(size, size))


def task(mesh: Mesh, *, index: list[int] | None = None, truth: np.ndarray | None = None) -> DeformationTask:
    index = [0, mesh.n - 1] if index is None else index
    group = np.arange(len(index))
    return DeformationTask("task", mesh, Handles(np.array(index), mesh.V[index], group=group), truth=truth)


@pytest.mark.parametrize("measure", ALL, ids=lambda f: getattr(f, "__name__", "percentile"))
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_a_rigid_motion_changes_nothing(measure, scale):
    mesh = bumpy()
    mesh = Mesh(scale * mesh.V, mesh.F)
    moved = mesh.V @ rotation(3).T + scale * np.array([3.0, -2.0, 1.0])
    assert measure(Deformed(task(mesh), moved)) == pytest.approx(0.0, abs=1e-5)


def test_a_stretch_has_the_symmetric_dirichlet_energy_of_its_factor():
    mesh = grid()
    stretched = mesh.V * [1.1, 1.0, 1.0]
    expected = 0.5 * (1.1**2 + 1.1**-2) - 1.0
    s1, s2 = Deformed(task(mesh), stretched).singular_values
    np.testing.assert_allclose(s1, 1.1, rtol=1e-12)
    np.testing.assert_allclose(s2, 1.0, rtol=1e-12)
    for measure in (distortion, distortion_95, distortion_99, distortion_max):
        assert measure(Deformed(task(mesh), stretched)) == pytest.approx(expected, rel=1e-9)
    # As much for the shrinkage by the same factor.
    assert distortion(Deformed(task(mesh), mesh.V * [1 / 1.1, 1.0, 1.0])) == pytest.approx(expected, rel=1e-9)
    assert collapsed(Deformed(task(mesh), mesh.V * [1.0, 0.09, 1.0])) == mesh.m


def test_percentiles_count_area_not_faces():
    mesh = grid()
    bad = np.zeros(mesh.n, dtype=bool)
    bad[0] = True  # a corner of one or two faces out of 242
    pulled = mesh.V + np.where(bad, 0.5, 0.0)[:, None] * [-1.0, -1.0, 0.0]
    assert distortion_95(Deformed(task(mesh), pulled)) == pytest.approx(0.0, abs=1e-12)
    assert distortion_max(Deformed(task(mesh), pulled)) > 0.1
    assert weighted_percentile(np.array([5.0, 1.0, 3.0]), np.array([1.0, 1.0, 8.0]), 90.0) == 3.0
    assert np.isnan(weighted_percentile(np.empty(0), np.empty(0), 50.0))


def test_singular_values_are_those_of_the_map_between_the_faces_planes():
    mesh = jittered(bumpy(), 0.05)
    deformed = bent(mesh.V, 0.7) * [1.0, 1.3, 0.4]
    s1, s2 = Deformed(task(mesh), deformed).singular_values

    def plane(V):
        """Coordinates of each face's two edges in an orthonormal frame of its plane."""
        u, v = V[mesh.F[:, 1]] - V[mesh.F[:, 0]], V[mesh.F[:, 2]] - V[mesh.F[:, 0]]
        x = u / np.linalg.norm(u, axis=1, keepdims=True)
        y = np.cross(np.cross(u, v), x)
        y /= np.linalg.norm(y, axis=1, keepdims=True)
        return np.stack([np.stack([(e * x).sum(1), (e * y).sum(1)], axis=1) for e in (u, v)], axis=2)

    expected = np.linalg.svd(plane(deformed) @ np.linalg.inv(plane(mesh.V)), compute_uv=False)
    np.testing.assert_allclose(np.stack([s1, s2], axis=1), expected, rtol=1e-6)


def test_a_face_that_loses_its_area_is_infinitely_distorted_and_one_without_is_left_out():
    V = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0, 0]])
    mesh = Mesh(V, np.array([[0, 3, 2], [3, 1, 2], [0, 1, 3]]))  # the last has no area
    assert np.isnan(Deformed(task(mesh), V).singular_values[0][2])
    assert distortion_max(Deformed(task(mesh), V)) == pytest.approx(0.0, abs=1e-12)
    assert collapsed(Deformed(task(mesh), V)) == 0
    flat = V * [1.0, 0.0, 1.0]
    assert np.isinf(Deformed(task(mesh), flat).dirichlet[:2]).all() and np.isinf(
        distortion(Deformed(task(mesh), flat))
    )
    assert collapsed(Deformed(task(mesh), flat)) == 2


def test_a_fold_changes_the_angles_of_its_edges_and_of_no_others():
    size = 13
    mesh = grid(size)
    x = mesh.V[:, 0]
    folded = np.where(
        (x > 6)[:, None], np.stack([np.full(mesh.n, 6.0), mesh.V[:, 1], x - 6.0], axis=1), mesh.V
    )
    deformed = Deformed(task(mesh), folded)
    corners, change = deformed.rest.topology.dihedral, deformed.dihedral_changes
    on_fold = (mesh.V[corners[:2], 0] == 6.0).all(axis=0)
    assert on_fold.sum() == size - 1
    np.testing.assert_allclose(change[on_fold], 90.0, atol=1e-9)
    np.testing.assert_allclose(change[~on_fold], 0.0, atol=1e-6)
    assert bend(Deformed(task(mesh), folded)) == pytest.approx(90.0 * on_fold.mean())
    assert bend_tail(Deformed(task(mesh), folded)) == pytest.approx(90.0)
    assert distortion_max(Deformed(task(mesh), folded)) == pytest.approx(0.0, abs=1e-12)


def test_dihedral_angles_are_those_of_trimesh():
    trimesh = pytest.importorskip("trimesh")
    mesh = jittered(bumpy(), 0.05)
    topology = Topology(mesh.F, mesh.n)
    corners = topology.dihedral
    reference = trimesh.Trimesh(mesh.V, mesh.F, process=False)
    expected = dict(
        zip(map(tuple, reference.face_adjacency_edges), reference.face_adjacency_angles, strict=True)
    )
    angles = Shape(topology, mesh.V).dihedral_angles
    assert len(angles) == len(expected)
    for edge, angle in zip(np.sort(corners[:2].T, axis=1), angles, strict=True):
        assert abs(angle) == pytest.approx(expected[tuple(edge)], abs=1e-6)
    # Of a convex surface all are positive.
    ball = icosphere(2)
    assert (Shape(Topology(ball.F, ball.n), ball.V).dihedral_angles > 0).all()


def test_edges_of_boundaries_of_three_faces_and_of_opposed_winding_have_no_angle():
    mesh = strip(4, 2)
    inner = len(mesh.edges) - len(mesh.boundary_edges)
    assert Topology(mesh.F, mesh.n).dihedral.shape[1] == inner
    assert Topology(np.array([[0, 1, 2], [0, 1, 3]]), 5).dihedral.shape[1] == 0
    assert Topology(np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]]), 5).dihedral.shape[1] == 0
    assert Topology(np.array([[0, 1, 2], [1, 0, 3]]), 5).dihedral.shape[1] == 1


def test_a_spike_shows_near_its_handle_only():
    mesh = grid(21)
    middle = 10 * 21 + 10
    pulled = mesh.V.copy()
    pulled[middle, 2] = 3.0
    near, far = task(mesh, index=[middle]), task(mesh, index=[0])
    assert spike(Deformed(near, pulled)) > 60.0
    assert spike(Deformed(far, pulled)) == pytest.approx(0.0, abs=1e-9)
    assert spike(Deformed(task(mesh, index=[0, middle]), pulled)) == spike(Deformed(near, pulled))
    assert bend(Deformed(near, pulled)) < 3.0


def test_detail_turns_with_the_surface_and_is_lost_where_relief_is_mirrored():
    mesh = grid(15)
    relief = mesh.V + 0.02 * np.random.default_rng(0).standard_normal(mesh.n)[:, None] * [0, 0, 1.0]
    mesh = Mesh(relief, mesh.F)
    assert detail(Deformed(task(mesh), mesh.V * [1.0, 1.0, -1.0])) == pytest.approx(180.0, abs=15.0)
    assert np.isnan(detail(Deformed(task(grid()), grid().V)))


def test_truth_measures():
    mesh = grid()
    true = mesh.V @ rotation(1).T
    assert truth_normal(Deformed(task(mesh, truth=true), true)) == pytest.approx(0.0, abs=1e-6)
    up = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])  # a quarter turn about x
    assert truth_normal(Deformed(task(mesh, truth=mesh.V), mesh.V @ up.T)) == pytest.approx(90.0)
    off = mesh.V.copy()
    off[:2, 2] += 0.03 * mesh.diagonal  # 2 of 144 vertices
    assert truth_distance_95(Deformed(task(mesh, truth=mesh.V), off)) == 0.0
    assert truth_distance_95(
        Deformed(task(mesh, truth=mesh.V), mesh.V + [0, 0, 0.03 * mesh.diagonal])
    ) == pytest.approx(3.0)
