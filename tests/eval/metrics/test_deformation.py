"""Metrics of faces without area, inverted faces and needles; values that runs of a task share."""

import numpy as np
import pytest
from eval_cases import ends_task

from eval.metrics import Deformed, measure
from eval.metrics.shape import Shape, Topology
from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.task import DeformationTask, Handles
from tests.shapes import bumpy


def held(mesh: Mesh) -> DeformationTask:
    return DeformationTask("t", mesh, Handles(np.array([0]), mesh.V[:1]))


def shape(V: np.ndarray, F: np.ndarray) -> Shape:
    return Shape(Topology(F, len(V)), V)


def test_zero_area_rest_faces_are_left_out_and_counted():
    V = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0], [3, 0, 0], [0, 0, 1]])
    F = np.array([[0, 1, 2], [0, 3, 4], [0, 2, 5], [3, 4, 5]])
    moved = V.copy()
    moved[2] = [0, 2, 0]
    mesh = Mesh(V, F)
    found = measure(held(mesh), moved)
    assert found["zero_area_faces"] == 1
    before, after = (shape(X, F).corner_angles[[0, 2, 3]] for X in (V, moved))
    assert found["angle_relative"] == pytest.approx(100 * (np.abs(after - before) / before).mean())


def test_an_ear_folded_over_is_one_flip():
    V = np.array([[0.0, 0, 0], [4, 0, 0], [2, 3, 0], [2, -1, 0], [4, 3, 0], [0, 3, 0]])
    F = np.array([[0, 1, 2], [1, 0, 3], [2, 1, 4], [0, 2, 5]])
    mesh = Mesh(V, F)
    folded = V.copy()
    folded[3] = [2, 1, 0]
    assert measure(held(mesh), folded)["flips"] == 1
    # Folds of the rest shape do not count.
    assert measure(held(Mesh(folded, F)), folded)["flips"] == 0
    assert shape(folded, F).opposed.tolist() == [False, True, False, False]


def test_flips_face_by_face():
    mesh = bumpy(2)
    moved = mesh.V + np.random.default_rng(0).normal(0, 0.05 * mesh.diagonal, mesh.V.shape)

    def opposed(V: np.ndarray) -> list[bool]:
        a, b, c = (V[mesh.F[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        found = []
        for face, normal in zip(mesh.F, normals, strict=True):
            shared = [len(set(face) & set(other)) for other in mesh.F]
            found.append(normal @ sum(n for n, k in zip(normals, shared, strict=True) if k == 2) < 0)
        return found

    assert not any(opposed(mesh.V)) and measure(held(mesh), moved)["flips"] == sum(opposed(moved)) > 0


def test_angles_keep_their_digits_at_a_needle():
    needle = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1e-9, 0]])
    assert shape(needle, np.array([[0, 1, 2]])).corner_angles[0, 0] == pytest.approx(1e-9, rel=1e-6)


def test_what_is_computed_of_the_rest_shape_is_shared_by_all_runs_of_a_task():
    task = ends_task(bumpy(2))
    one, two = (Deformed(task, factor * task.mesh.V) for factor in (1.1, 1.2))
    assert one.rest is two.rest and one.rest.corner_angles is two.rest.corner_angles
    assert Deformed(ends_task(bumpy(2)), task.mesh.V).rest is not one.rest


def test_vertices_that_are_no_shape_are_refused():
    task = ends_task(bumpy(1))
    for bad, why in ((np.full_like(task.mesh.V, np.nan), "NaN"), (task.mesh.V[1:], "must correspond")):
        with pytest.raises(InputError, match=f"deformed shape.*{why}|{why}.*deformed shape"):
            measure(task, bad)
