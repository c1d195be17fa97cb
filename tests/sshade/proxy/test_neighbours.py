"""Undefined matrices are filled with means of their neighbours, or with the identity."""

import numpy as np

from sshade.proxy.vertex_maps import fill_from_neighbours

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
