"""The intersection kernel against cases with known answers, linear programming, and pymeshlab."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

import sshade.contact.intersections as module
import sshade.mesh.boxes as boxes
from sshade.contact.intersections import intersecting_faces, new_crossings
from sshade.errors import InputError
from sshade.mesh.boxes import curve_order
from sshade.mesh.mesh import Mesh
from tests.shapes import block, bumpy, icosphere


def pymeshlab_faces(V, F):
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(V, F.astype(np.int32)))
    meshes.compute_selection_by_self_intersections_per_face()
    return meshes.current_mesh().face_selection_array()


def dented(level):
    """A sphere whose one side is pushed out through the other."""
    mesh = icosphere(level)
    V = mesh.V.copy()
    V[:, 0] *= 1 - 1.6 * np.exp(-8 * (V[:, 1] ** 2 + V[:, 2] ** 2))
    return V, mesh.F


def noisy(level):
    mesh = bumpy(level)
    return mesh.V + np.random.default_rng(0).normal(0, 0.5 * 2.0**-level, mesh.V.shape), mesh.F


def two_spheres(level):
    mesh = icosphere(level)
    return np.concatenate([mesh.V, mesh.V * 0.9 + [0.7, 0.1, 0.2]]), np.concatenate([mesh.F, mesh.F + mesh.n])


@pytest.mark.parametrize("make", [dented, noisy, two_spheres])
@pytest.mark.parametrize("level", [2, 4])
def test_agrees_with_pymeshlab(make, level):
    V, F = make(level)
    found = intersecting_faces(V, F)
    assert found.any() and not found.all()
    np.testing.assert_array_equal(found, pymeshlab_faces(V, F))


def hulls_meet(A, B):
    # Two convex combinations that are one point.
    ones = np.repeat(np.eye(2), [len(A), len(B)], axis=1)
    equal = np.vstack([np.hstack([A.T, -B.T]), ones])
    return linprog(np.zeros(len(A) + len(B)), A_eq=equal, b_eq=[0, 0, 0, 1, 1]).status == 0


def test_agrees_with_linear_programming_on_loose_triangles():
    rng = np.random.default_rng(1)
    corners = rng.uniform(size=(40, 1, 3)) + rng.normal(0, 0.2, (40, 3, 3))
    found = intersecting_faces(corners.reshape(-1, 3), np.arange(120).reshape(-1, 3))
    expected = np.zeros(40, dtype=bool)
    for i in range(40):
        for j in range(i + 1, 40):
            expected[[i, j]] |= hulls_meet(corners[i], corners[j])
    assert expected.any() and not expected.all()
    np.testing.assert_array_equal(found, expected)


#: Faces of cases with so many vertices: apart, with a common corner, with a common edge, twice the same.
FACES = {
    6: [[0, 1, 2], [3, 4, 5]],
    5: [[0, 1, 2], [0, 3, 4]],
    4: [[0, 1, 2], [1, 0, 3]],
    3: [[0, 1, 2], [0, 2, 1]],
}
#: Vertices, and whether the faces intersect.
CASES = {
    "pierced": ([[0, 0, 0], [2, 0, 0], [0, 2, 0], [0.5, 0.5, -1], [0.5, 0.6, 1], [0.6, 0.5, 1]], True),
    "apart": ([[0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 1], [2, 0, 1], [0, 2, 1]], False),
    "touching at a point": ([[0, 0, 0], [2, 0, 0], [0, 2, 0], [0.5, 0.5, 0], [1, 0, 1], [0, 1, 1]], True),
    "coplanar, overlapping": ([[0, 0, 0], [2, 0, 0], [0, 2, 0], [0.5, 0.5, 0], [3, 0, 0], [3, 3, 0]], True),
    "coplanar, one in the other": ([[0, 0, 0], [9, 0, 0], [0, 9, 0], [1, 1, 0], [2, 1, 0], [1, 2, 0]], True),
    "coplanar, apart": ([[0, 0, 0], [2, 0, 0], [0, 2, 0], [2, 2, 0], [3, 2, 0], [2, 3, 0]], False),
    "common corner, apart": ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 1], [0, -1, 1]], False),
    "common corner, opposite edge pierces": (
        [[0, 0, 0], [2, 0, 0], [0, 2, 0], [1, 0.5, -1], [1, 0.5, 1]],
        True,
    ),
    "common corner, coplanar neighbours of a fan": (
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [-1, -1, 0]],
        False,
    ),
    "common corner, coplanar, overlapping": (
        [[0, 0, 0], [2, 0, 0], [0, 2, 0], [1, 0.1, 0], [0.1, 1, 0]],
        True,
    ),
    "common corner, coplanar, same sector": ([[0, 0, 0], [2, 0, 0], [0, 2, 0], [3, 0, 0], [0, 3, 0]], True),
    "common edge, unfolded": ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, -1, 0]], False),
    "common edge, folded up": ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.5, 0.1]], False),
    "common edge, folded flat": ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.5, 0]], True),
    "twice the same": ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], True),
    "a needle has no plane": (
        [[0, 0, 0], [2, 0, 0], [0, 2, 0], [0.5, 0.5, -1], [0.5, 0.5, 0.5], [0.5, 0.5, 1]],
        False,
    ),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("turn", range(3))
def test_pairs_of_known_answer(name, turn):
    V, expected = CASES[name]
    V, F = np.array(V, dtype=float), np.roll(np.array(FACES[len(V)]), turn, axis=1)
    for order in ([0, 1], [1, 0]):
        for flipped in (F, F[:, ::-1], np.stack([F[0], F[1, ::-1]])):
            assert intersecting_faces(V, flipped[order]).tolist() == [expected] * 2


def test_flat_faces_of_a_box_do_not_intersect():
    mesh = block(np.ones((5, 4, 3)))
    mesh = Mesh(mesh.V * [0.2, 0.17, 0.1], mesh.F)
    # Coplanar neighbours after a rotation: coplanar only up to rounding.
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    assert not intersecting_faces(mesh.V @ turn.T + 5, mesh.F).any()


def test_only_new_intersections_count():
    V, F = dented(3)
    worse = V.copy()
    worse[:, 2] *= 1 - 1.6 * np.exp(-8 * (V[:, 0] ** 2 + V[:, 1] ** 2))
    rest = Mesh(V, F)
    expected = intersecting_faces(worse, F) & ~intersecting_faces(V, F)
    assert expected.any() and np.array_equal(new_crossings(rest, worse), expected)
    assert not new_crossings(rest, V).any()


def test_only_pairs_with_one_of_the_faces_asked_for_and_any_number_of_threads(monkeypatch):
    V, F = dented(3)
    every = intersecting_faces(V, F)
    assert 0 < every.sum() < len(F)
    for faces in (np.flatnonzero(every)[:1], np.flatnonzero(every)[::7], np.flatnonzero(~every)[:5]):
        among = np.isin(np.arange(len(F)), faces)
        found = intersecting_faces(V, F, among=among)
        assert np.array_equal(found[among], every[among]) and not (found & ~every).any()
        for face in np.flatnonzero(found & ~among):  # each has its partner among them
            assert (intersecting_faces(V, F, among=np.arange(len(F)) == face) & among).any()
    for owner, name, value in ((module, "PIECE", 5), (boxes, "CHUNK", 5), (module, "PARTS", 8)):
        monkeypatch.setattr(owner, name, value)
        assert np.array_equal(intersecting_faces(V, F, workers=3), every)


def test_the_order_of_the_tree_and_the_size_of_its_leaves_have_no_influence(monkeypatch):
    V, F = noisy(3)
    order = curve_order(V, F)
    assert np.array_equal(np.sort(order), np.arange(len(F)))
    # Along the curve the next face is near.
    middles = V[F].mean(axis=1)
    steps = [np.linalg.norm(np.diff(middles[ids], axis=0), axis=1).mean() for ids in (order, order[::-1])]
    scattered = np.random.default_rng(0).permutation(len(F))
    assert max(steps) < 0.3 * np.linalg.norm(np.diff(middles[scattered], axis=0), axis=1).mean()
    expected = intersecting_faces(V, F)
    assert expected.any() and not expected.all()
    for leaf_size in (1, 3, 4, len(F)):
        monkeypatch.setattr(module, "LEAF_SIZE", leaf_size)
        for ids in (order, scattered):
            assert np.array_equal(intersecting_faces(V, F, order=ids), expected)


def test_faces_at_a_corner_agree_with_linear_programming():
    rng = np.random.default_rng(3)
    F, found = np.array([[0, 1, 2], [4, 0, 3]]), []
    for _ in range(100):
        V = rng.normal(size=(5, 3)) * [1, 1, rng.choice([1e-3, 0.1, 1])]
        expected = hulls_meet(V[[1, 2]], V[[0, 3, 4]]) or hulls_meet(V[[3, 4]], V[[0, 1, 2]])
        assert intersecting_faces(V, F).tolist() == [expected] * 2
        found.append(expected)
    assert 0.1 < np.mean(found) < 0.9


def test_positions_and_faces_that_do_not_belong_together_are_refused():
    V, F = dented(2)
    rest = icosphere(2)
    worse = V.copy()
    worse[3, 1] = np.nan
    for bad in (worse, V[:-1]):
        with pytest.raises(InputError):
            intersecting_faces(bad, F)
        with pytest.raises(InputError):
            new_crossings(rest, bad)
