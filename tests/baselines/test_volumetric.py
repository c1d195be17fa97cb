"""Coarse tetrahedra, handles on them, and the methods that deform them."""

from importlib.util import find_spec
from inspect import signature
from unittest.mock import Mock

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.iteration import handle_error
from baselines.volumetric import coarse_tetrahedra as coarse_tetrahedra_module
from baselines.volumetric.coarse_tetrahedra import coarse_tetrahedra
from baselines.volumetric.neo_hookean import neo_hookean
from baselines.volumetric.node_handles import on_targets, rigid_parts
from baselines.volumetric.skinning import biharmonic_coordinates, bounded_biharmonic_weights
from baselines.volumetric.slim import slim
from baselines.volumetric.tetrahedral_arap import tetrahedral_arap
from sshade import DeformationTask, Handles, InputError, Mesh
from tests.baselines.filling import filled
from tests.shapes import bumpy, end_handles, held_ends, moved_parts, rotation, shifted, tube, two_spheres

COARSE = {"samples": 300, "edge": 0.12}
NEO_HOOKEAN = pytest.param(
    neo_hookean,
    marks=pytest.mark.skipif(find_spec("simkit") is None, reason="the extra neo_hookean is not installed"),
)
VOLUMETRIC = (tetrahedral_arap, bounded_biharmonic_weights, biharmonic_coordinates, slim, NEO_HOOKEAN)

#: Maximum error of a rigid motion, as a fraction of the diagonal. Errors come from the offset between a
#: handle and its nearest node, and from simkit's lower limit of eigenvalues.
CLOSE = 1e-6


@pytest.fixture(autouse=True)
def filling(monkeypatch):
    if find_spec("pytetwild") is None:
        monkeypatch.setattr(coarse_tetrahedra_module, "_filled", filled)


def test_tetrahedra_are_positive_and_carry_every_vertex():
    mesh = bumpy(3)
    made = coarse_tetrahedra(mesh, **COARSE)
    assert made.volumes.min() > 0
    assert made.volumes.sum() == pytest.approx(mesh.volume, rel=0.05)
    np.testing.assert_allclose(made.carry @ made.V, mesh.V, atol=1e-13 * mesh.diagonal)
    assert np.abs(made.carry.sum(axis=1) - 1).max() < 1e-12
    # Any tetrahedra carry affine maps exactly.
    A = rotation(1) * [1.0, 2.0, 0.5]
    np.testing.assert_allclose(made.carry @ (made.V @ A.T + 3), mesh.V @ A.T + 3, atol=1e-12 * mesh.diagonal)
    assert [made.inverted(made.V * [1, 1, z]) for z in (1, 0, -1)] == [0, len(made.T), len(made.T)]
    # Barycentric coordinates exceed -1, so the surface lies in the tetrahedra or just beside them.
    assert made.carry.data.min() > -1


def test_a_mesh_that_is_moved_and_scaled_is_not_filled_again(monkeypatch):
    fill = Mock(side_effect=filled)
    monkeypatch.setattr(coarse_tetrahedra_module, "_filled", fill)
    mesh = bumpy(2)
    one, two = (coarse_tetrahedra(Mesh(V, mesh.F), edge=0.13) for V in (mesh.V, 0.01 * mesh.V - 7))
    np.testing.assert_allclose(two.V, 0.01 * one.V - 7, atol=1e-6)
    coarse_tetrahedra(mesh, edge=0.14, envelope=2e-3)
    assert fill.call_count == 2 and np.array_equal(one.T, two.T)


@pytest.mark.parametrize("method", VOLUMETRIC)
def test_an_open_surface_is_refused(method):
    with pytest.raises(InputError, match="boundary edges; close its holes"):
        method(held_ends(tube()))


@pytest.mark.parametrize("method", VOLUMETRIC)
def test_tetrahedra_without_a_handle_are_refused(method):
    balls = two_spheres()
    handles = Handles(np.arange(3), balls.V[:3] + [0, 0, 1])
    task = DeformationTask("one", balls, handles)
    with pytest.raises(InputError, match="1 of the 2 components of the coarse volume has no handle"):
        method(task, samples=200, edge=0.15)


@pytest.mark.parametrize("method", VOLUMETRIC)
@pytest.mark.parametrize("handles", ["regions", "landmarks"])
def test_a_rigid_motion_is_reproduced(method, handles):
    mesh = shifted(bumpy(2), [5, 0, 0])
    z = mesh.V[:, 2]
    index = np.argsort(z)[[0, 1, 2, 3, 9, -9, -3, -2, -1]]
    if handles == "regions":
        index = np.flatnonzero((z < np.quantile(z, 0.2)) | (z > np.quantile(z, 0.9)))
    expected = mesh.V @ rotation(3).T + [1.0, -2, 0.5]
    group = (z[index] > 0).astype(int)
    task = DeformationTask("rigid", mesh, Handles(index, expected[index], group=group))
    options = {} if method in (bounded_biharmonic_weights, biharmonic_coordinates) else {"start": "rigid"}
    result = method(task, **COARSE, **options)
    assert np.abs(result.vertices - expected).max() < CLOSE * mesh.diagonal
    V, before = on_targets(mesh, task.handles, mesh.V, nodes=40)
    assert before == handle_error(mesh, task.handles, mesh.V) > 0
    np.testing.assert_array_equal(V[index], expected[index])


@pytest.mark.parametrize("method", VOLUMETRIC)
def test_a_scaled_task_has_the_scaled_result_and_the_same_facts(method):
    limit = {"max_iterations": 2} if "max_iterations" in signature(method).parameters else {}
    told, found = Mock(), []
    for scale in (1, 64):
        mesh = Mesh(scale * bumpy(2).V, bumpy(2).F)
        task = DeformationTask("t", mesh, end_handles(mesh.V, share=0.2, turn=rotation(2)))
        found.append(method(task, **COARSE, **limit, progress=told))
    assert np.abs(found[1].vertices - 64 * found[0].vertices).max() < 64e-6 and told.called == bool(limit)
    assert found[1].extra == pytest.approx(found[0].extra, rel=1e-3) and found[0].extra["nodes"] > 100


def test_handles_of_a_group_are_split_by_their_rigid_motions():
    mesh, R, count = Mesh(64 * bumpy(3).V, bumpy(3).F), rotation(1), [40, 60, 20]
    order = np.argsort(mesh.V[:, 2])
    parts = (order[:40], 0), (order[-60:], lambda V: V @ R.T + 50 + 0.3 * np.sin(V)), (order[300:320], 99)
    own = moved_parts(mesh.V, *parts, group=np.repeat([0, 0, 1], count))
    found = rigid_parts(mesh, own)
    assert found.part.tolist() == np.repeat([1, 0, 2], count).tolist()
    moved = np.einsum("kij,kj->ki", found.R[found.part], mesh.V[own.index]) + found.t[found.part]
    np.testing.assert_allclose(moved, own.target, atol=0.5)


def test_tetrahedral_arap_comes_to_one_minimum_from_both_starts():
    task = held_ends(bumpy(2))
    # libigl fits rotations in float32, so the residual does not fall far below that precision.
    options = {**COARSE, "tolerance": 1e-6, "max_iterations": 4000}
    result, again = (tetrahedral_arap(task, **options, start=start) for start in ("rigid", "rest"))
    assert result.converged and again.converged
    assert np.abs(result.vertices - again.vertices).max() < 1e-3 * task.mesh.diagonal
    assert 0 < result.extra["handle_before"] < 1e-2
    np.testing.assert_array_equal(result.vertices[task.handles.index], task.handles.target)


def test_bounded_biharmonic_weights_blend_two_bones():
    # Every vertex between a fixed bone and a shifted bone moves by a fraction of the shift.
    mesh = bumpy(3)
    z = mesh.V[:, 2]
    handles = moved_parts(mesh.V, (z < np.quantile(z, 0.1), 0), (z > np.quantile(z, 0.9), [0.0, 0.0, 1.0]))
    result = bounded_biharmonic_weights(DeformationTask("shift", mesh, handles), **COARSE)
    moved = result.vertices - mesh.V
    assert np.abs(moved[:, :2]).max() < 1e-9
    assert moved[:, 2].min() > -1e-9 and moved[:, 2].max() < 1 + 1e-9
    middle = moved[np.abs(z - np.median(z)) < 0.2, 2]
    assert middle.min() > 0.05 and middle.max() < 0.95
    assert np.corrcoef(moved[:, 2], z)[0, 1] > 0.9


def test_biharmonic_coordinates_reproduce_affine_maps_of_points():
    # An affine map moves six handles: single vertices in general position, far from each other.
    mesh = bumpy(3)
    index = np.array([int(np.argmax(mesh.V @ d)) for d in np.concatenate([np.eye(3), -np.eye(3)])])
    expected = mesh.V @ np.array([[1.0, 0.2, 0], [0, 1.1, 0], [0.1, 0, 0.9]]).T
    handles = Handles(index, expected[index], group=np.arange(6))
    result = biharmonic_coordinates(DeformationTask("affine", mesh, handles), **COARSE)
    # A node next to a handle only takes the handle's translation, and misses the change of its offset.
    gap = np.linalg.norm(np.delete(result.vertices - expected, index, axis=0), axis=1)
    assert np.median(gap) < 0.02 * mesh.diagonal


@pytest.mark.parametrize("method", [slim, NEO_HOOKEAN])
def test_soft_handles_come_nearer_with_their_weight(method):
    task = held_ends(bumpy(2))
    options = {**COARSE, "start": "rigid", "max_iterations": 20}
    errors = [method(task, **options, handle_weight=w).extra["handle_error"] for w in (10.0, 100.0, 1000.0)]
    assert errors[0] > 2 * errors[1] > 4 * errors[2]
    for weight in (0.0, -1.0, np.inf):
        with pytest.raises(InputError, match="handle_weight"):
            method(task, handle_weight=weight)


def test_slim_inverts_nothing_where_arap_would_not_mind():
    task = held_ends(bumpy(2), turn=Rotation.from_euler("z", 170, degrees=True).as_matrix())
    result = slim(task, **COARSE, start="rigid", max_iterations=60)
    assert result.extra["inverted"] == 0
