"""Least-squares affine maps of 1-rings."""

from __future__ import annotations

import numpy as np

from sshade import Mesh
from sshade.carry.vertex_maps import VertexMaps
from tests.shapes import bent, bumpy, rotation, strip

BODY = bumpy(2)


def ring_of(mesh: Mesh, i: int) -> np.ndarray:
    """Neighbours of a vertex, ascending."""
    faces = mesh.F[np.isin(mesh.F, i).any(axis=1)]
    return np.setdiff1d(faces, [i])


def unit_normals(mesh: Mesh) -> np.ndarray:
    """(n, 3) sums of the area-weighted normals of the faces at each vertex, normalised."""
    a, b, c = (mesh.V[mesh.F[:, i]] for i in range(3))
    total = np.zeros_like(mesh.V)
    for corner in range(3):
        np.add.at(total, mesh.F[:, corner], np.cross(b - a, c - a))
    return total / np.linalg.norm(total, axis=1, keepdims=True)


def by_lstsq(rest: Mesh, V: np.ndarray, i: int) -> np.ndarray:
    """The definition, solved as weighted linear equations for one vertex."""
    ring = ring_of(rest, i)
    e, deformed = rest.V[ring] - rest.V[i], V[ring] - V[i]
    length = np.linalg.norm(e, axis=1)
    weight = length**-1.5
    normal = np.sqrt(0.5 * (weight**2 * length**2).sum())
    rows = np.concatenate([weight[:, None] * e, normal * unit_normals(rest)[i : i + 1]])
    sides = np.concatenate([weight[:, None] * deformed, normal * unit_normals(Mesh(V, rest.F))[i : i + 1]])
    return np.linalg.lstsq(rows, sides, rcond=None)[0].T


def test_the_maps_are_the_weighted_least_squares_solution():
    V = bent(BODY.V) @ rotation(1).T
    A, known = VertexMaps.at_rest(BODY)(V)
    assert known.all()
    for i in range(0, BODY.n, 7):
        np.testing.assert_allclose(A[i], by_lstsq(BODY, V, i), rtol=0, atol=1e-12)


def test_on_a_plane_every_affine_map_is_exact_and_the_normal_goes_to_the_normal():
    sheet = strip(8, 5)
    B = np.array([[1.5, 0.4, 0], [-0.2, 0.7, 0], [0, 0, 1]])
    R = rotation(3)
    A, _ = VertexMaps.at_rest(sheet)(sheet.V @ (R @ B).T)
    np.testing.assert_allclose(A, np.broadcast_to(R @ B, A.shape), rtol=0, atol=1e-13)


def test_a_ring_that_falls_onto_a_line_has_the_mean_map_of_its_neighbours():
    maps, V = VertexMaps.at_rest(BODY), bent(BODY.V)
    i = 30
    ring = ring_of(BODY, i)
    flat = V.copy()
    flat[ring] = V[i] + np.linspace(-1, 1, len(ring))[:, None] * [0.1, 0.2, 0.1]
    A, known = maps(flat)
    assert not known[i]
    usable = ring[known[ring]]
    assert len(usable)
    np.testing.assert_allclose(A[i], A[usable].mean(axis=0), rtol=0, atol=1e-12)


def test_a_ring_on_a_line_at_rest_has_the_mean_map_of_its_neighbours_whatever_it_becomes():
    sheet = strip(8, 5)
    i = 0  # a corner
    ring = ring_of(sheet, i)
    V = sheet.V.copy()
    V[ring] = V[i] + np.arange(1, len(ring) + 1)[:, None] * np.array([0.3, 0.3, 0])
    rest = Mesh(V, sheet.F)
    A, known = VertexMaps.at_rest(rest)(bent(sheet.V))
    assert not known[i]
    usable = ring[known[ring]]
    np.testing.assert_allclose(A[i], A[usable].mean(axis=0), rtol=0, atol=1e-12)


def test_coincident_vertices_leave_everything_finite():
    V = BODY.V.copy()
    i, j = BODY.edges[40]
    V[i] = V[j]
    rest, R = Mesh(V, BODY.F), rotation(4)
    A, known = VertexMaps.at_rest(rest)(V @ R.T)
    assert np.isfinite(A).all()
    np.testing.assert_allclose(A, np.broadcast_to(R, A.shape), rtol=0, atol=1e-10)
