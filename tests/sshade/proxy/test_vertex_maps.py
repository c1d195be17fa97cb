"""Least-squares affine maps of 1-rings."""

import numpy as np
import pytest

from sshade import Mesh
from sshade.proxy.vertex_maps import VertexMaps, fill_from_neighbours
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


@pytest.mark.parametrize("at_rest", [False, True])
@pytest.mark.parametrize(("mesh", "i"), [(BODY, 30), (strip(8, 5), 0)], ids=["inside", "a corner"])
def test_a_ring_on_a_line_has_the_mean_map_of_its_neighbours(mesh, i, at_rest):
    """Whether it falls onto the line, or lies there at rest, whatever it becomes."""
    ring, rest, V = ring_of(mesh, i), mesh.V.copy(), bent(mesh.V)
    flat = rest if at_rest else V
    flat[ring] = flat[i] + np.linspace(0.1, 1, len(ring))[:, None] * [0.1, 0.2, 0.1]
    A, known = VertexMaps.at_rest(Mesh(rest, mesh.F))(V)
    assert not known[i]
    usable = ring[known[ring]]
    assert len(usable)
    np.testing.assert_allclose(A[i], A[usable].mean(axis=0), rtol=0, atol=1e-12)


def test_coincident_vertices_leave_everything_finite():
    V = BODY.V.copy()
    i, j = BODY.edges[40]
    V[i] = V[j]
    rest, R = Mesh(V, BODY.F), rotation(4)
    A, known = VertexMaps.at_rest(rest)(V @ R.T)
    assert np.isfinite(A).all()
    np.testing.assert_allclose(A, np.broadcast_to(R, A.shape), rtol=0, atol=1e-10)


#: A path 0 - 1 - 2 - 3 - 4, and a separate pair 5 - 6.
PAIRS = np.array([[0, 1], [2, 1], [2, 3], [3, 4], [5, 6]])
KNOWN = np.array([True, False, False, False, True, False, False])


def test_means_spread_ring_by_ring_and_what_nothing_reaches_is_the_identity():
    values = np.random.default_rng(0).normal(size=(7, 3, 3))
    values[2] = np.nan
    before = values.copy()
    filled = fill_from_neighbours(values, KNOWN, pairs=PAIRS)
    assert np.array_equal(filled[[0, 1]], values[[0, 0]]) and np.array_equal(filled[[3, 4]], values[[4, 4]])
    np.testing.assert_allclose(filled[2], 0.5 * (values[0] + values[4]), rtol=1e-15)
    assert np.array_equal(filled[5:], np.stack([np.eye(3)] * 2))
    np.testing.assert_array_equal(values, before)
    assert fill_from_neighbours(values, np.ones(7, dtype=bool), pairs=PAIRS) is values
