from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csc_array, eye_array
from scipy.sparse.linalg import spsolve_triangular

from sshade.solver.factorisation import Factorisation
from sshade.solver.substitution import Factors, divide, substitute, substitute_together
from sshade.threads import ThreadTeam
from tests.shapes import bumpy, jittered, strip
from tests.sshade.solver.test_factorisation import system


def random_factors(n: int) -> Factors:
    """L and D of a random sparse positive definite matrix, in a bad order: much fill, a tree like a vine."""
    rng = np.random.default_rng(0)
    A = np.zeros((n, n))
    i, j = rng.integers(0, n, (2, 2 * n))
    A[i, j] = rng.normal(size=2 * n)
    L = np.linalg.cholesky(A @ A.T + np.eye(n))
    L[np.abs(L) < 1e-13] = 0
    pivots = np.diag(L)
    lower = csc_array(np.tril(L / pivots, -1))
    return Factors(lower.indptr.astype(np.int64), lower.indices.astype(np.int32), lower.data, 1 / pivots**2)


FACTORS = {
    "closed": Factorisation(system(bumpy(4))).factors,
    "open": Factorisation(system(jittered(strip(60, 20), 0.2))).factors,
    "random": random_factors(80),
    "diagonal": Factors(np.zeros(6, dtype=np.int64), np.empty(0, np.int32), np.empty(0), np.arange(1.0, 6.0)),
}


@pytest.fixture(params=list(FACTORS))
def factors(request) -> Factors:
    return FACTORS[request.param]


def columns(factors: Factors, count: int) -> np.ndarray:
    return np.random.default_rng(count).normal(size=(len(factors.inverse_pivot), count))


@pytest.mark.parametrize("count", [1, 3, 6, 9])
def test_substitution_solves_the_triangular_systems(factors, count):
    B = columns(factors, count)
    X, n = B.copy(), len(B)
    substitute(factors, X)
    L = csc_array((factors.value, factors.row, factors.start), shape=(n, n)) + eye_array(n)
    Y = spsolve_triangular(L.tocsr(), B, lower=True) * factors.inverse_pivot[:, None]
    expected = spsolve_triangular(L.T.tocsr(), Y, lower=False)
    assert np.abs(X - expected).max() < 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize("chunks", [1, 2, 3, 8])
@pytest.mark.parametrize("count", [3, 5, 6])
def test_several_threads_find_the_same_bits(factors, count, chunks):
    order, divided, subtrees = divide(factors, chunks=chunks)
    X = columns(factors, count)
    expected, alone = X.copy(), X[order]
    substitute(factors, expected)
    together = alone.copy()
    substitute(divided, alone)
    assert np.abs(alone - expected[order]).max() < 1e-12 * np.abs(expected).max()
    for threads in (1, 2, 3):
        again = together.copy()
        with ThreadTeam(threads) as team:
            substitute_together(divided, subtrees, again, team=team)
        assert np.array_equal(again, alone)


@pytest.mark.parametrize("chunks", [1, 2, 5])
def test_subtrees_are_independent_and_the_separator_is_last(factors, chunks):
    order, (start, row, _, _), subtrees = divide(factors, chunks=chunks)
    n = len(order)
    assert np.array_equal(np.sort(order), np.arange(n))
    chunk = np.repeat(np.arange(chunks + 1), np.diff(subtrees.bounds))
    column = np.repeat(np.arange(n), np.diff(start))
    assert ((chunk[row] == chunk[column]) | (chunk[row] == chunks)).all()
    assert (np.diff(row)[np.diff(column) == 0] > 0).all() and (row > column).all()
    assert np.array_equal(subtrees.inside, start[:-1] + np.bincount(column, chunk[row] == chunk[column], n))
    assert len(subtrees.column) == ((chunk[column] < chunks) & (chunk[row] == chunks)).sum()


def test_subtrees_share_the_work():
    for chunks, left in ((2, 0.25), (4, 0.5)):
        _, divided, subtrees = divide(FACTORS["closed"], chunks=chunks)
        entries = np.diff(divided.start[subtrees.bounds]) / len(divided.row)
        assert entries[-1] < left
        assert entries[:-1].max() < 1.5 * entries[:-1].min()
