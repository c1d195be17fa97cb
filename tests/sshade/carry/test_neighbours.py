"""What stands in for undefined matrices."""

from __future__ import annotations

import numpy as np

from sshade.carry.neighbours import adjacent_triangles, fill_from_neighbours
from tests.shapes import bumpy, strip

#: A path 0 - 1 - 2 - 3 - 4, and 5 - 6 apart.
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


def test_each_ring_is_brought_onto_what_may_stand_for_it():
    values = np.random.default_rng(1).normal(size=(7, 3, 3))
    filled = fill_from_neighbours(values, KNOWN, pairs=PAIRS, onto=lambda means: -2 * means)
    np.testing.assert_allclose(filled[1], -2 * values[0], rtol=1e-15)
    np.testing.assert_allclose(filled[2], -(filled[1] + filled[3]), rtol=1e-15)


def test_adjacent_triangles_share_two_vertices():
    for mesh in (bumpy(1), strip(4, 3)):
        pairs = adjacent_triangles(mesh.F)
        shared = [len(set(mesh.F[a]) & set(mesh.F[b])) for a, b in pairs]
        assert set(shared) == {2} and len(pairs) == len(mesh.edges) - len(mesh.boundary_edges)
