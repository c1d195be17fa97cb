"""Vertices of a mesh as handles: tasks, results, snapping, and handles that do not fit together."""

import numpy as np
import pytest

from sshade import DeformationTask, Handles, Mesh
from sshade.problem import snapping
from sshade.problem.snapping import snap_to_vertices
from tests.shapes import bumpy, rotation, strip, tetrahedron, torus

TETRAHEDRON, TURNS = tetrahedron(), np.stack([np.eye(3), rotation(1)])
TURNED = Mesh(TETRAHEDRON.V, TETRAHEDRON.F[::-1])
ONE, PLACES = Handles([0], TETRAHEDRON.V[:1]), np.eye(3)[:2]


def test_a_soft_handle_pulls_where_its_faces_have_no_area():
    mesh = bumpy(2)
    V = np.array(mesh.V)
    V[np.unique(mesh.F[(mesh.F == 7).any(axis=1)])] = V[7]
    task = DeformationTask("t", Mesh(V, mesh.F), Handles([7, 90], V[[7, 90]], weight=1.0))
    assert task.mesh.vertex_areas[7] == 0 < task.handles.portion.min()


def test_dynamic_handles_carry_the_snap_offset_turned_by_their_groups_rotation(body):
    ids = np.arange(40, 48)
    turns = [rotation(3), rotation(4)]
    source = body.V[ids] + np.random.default_rng(0).normal(scale=1e-3, size=(8, 3))
    target = np.concatenate([source[:4] @ turns[0].T + [1, 0, 0], source[4:] @ turns[1].T - [0, 1, 0]])
    handles = Handles.from_positions(body, source, target, group=np.repeat([7, 2], 4))
    fixed = Handles.from_positions(body, source, target, dynamic=False)
    assert np.array_equal(fixed.target, body.V[fixed.index]) and not fixed.dynamic.any()
    # Each group moves rigidly, so that its vertices move by the same motion as its positions.
    expected = {int(v): body.V[v] @ turns[0].T + [1, 0, 0] for v in ids[:4]}
    expected |= {int(v): body.V[v] @ turns[1].T - [0, 1, 0] for v in ids[4:]}
    assert set(handles.index.tolist()) == set(expected)
    for vertex, target, group in zip(handles.index, handles.target, handles.group, strict=True):
        assert np.allclose(target, expected[int(vertex)], rtol=0, atol=1e-12 * body.diagonal)
        assert group == (7 if vertex < 44 else 2)


SHAPES = {"bumpy": bumpy(4), "flat": strip(60, 40), "torus": torus(90, 30)}


@pytest.fixture(params=[1, 5, 10**9])
def large(request, monkeypatch):
    """From all vertices through a few to a mesh that is not large."""
    monkeypatch.setattr(snapping, "LARGE", 0 if request.param < 10**9 else 10**9)
    monkeypatch.setattr(snapping, "STRIDE", request.param)


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("off", [0.0, 1e-3, 0.04])
def test_nearest_vertices_are_those_of_all_distances(name, off, large):
    mesh, rng = SHAPES[name], np.random.default_rng(7)
    source = mesh.V[rng.permutation(mesh.n)[:40]] + off * mesh.diagonal * rng.uniform(-0.5, 0.5, (40, 3))
    distance, index = snap_to_vertices(mesh, source, np.zeros(40, dtype=int))
    every = np.linalg.norm(mesh.V[None] - source[:, None], axis=2)
    assert np.array_equal(index, every.argmin(axis=1))
    np.testing.assert_allclose(distance, every.min(axis=1), rtol=1e-12, atol=1e-300)


def test_one_position_outside_of_the_box(large):
    mesh = SHAPES["bumpy"]
    source = mesh.V[[np.argmin(mesh.V[:, 0])]] - [0.03 * mesh.diagonal, 0, 0]
    _, index = snap_to_vertices(mesh, source, np.zeros(1, dtype=int))
    assert index[0] == np.argmin(np.linalg.norm(mesh.V - source, axis=1))
