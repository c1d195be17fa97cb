from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csc_array, eye_array
from scipy.sparse.linalg import spsolve_triangular

from sshade.linalg import factor
from sshade.parallel import Crew
from sshade.substitution import Factors, divide, substitute, substitute_together
from tests.shapes import bumpy, jittered, strip
from tests.sshade.test_linalg import system


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
    "closed": factor(system(bumpy(4)))._factors,
    "open": factor(system(jittered(strip(60, 20), 0.2)))._factors,
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


@pytest.mark.parametrize("parts", [1, 2, 3, 8])
@pytest.mark.parametrize("count", [1, 3, 6, 9])
def test_several_threads_find_the_same_bits(factors, count, parts):
    X = columns(factors, count)
    together = X.copy()
    substitute(factors, X)
    with Crew(parts) as crew:
        substitute_together(factors, divide(factors, parts), together, crew=crew)
    assert np.array_equal(X, together)


@pytest.mark.parametrize("parts", [1, 2, 5])
def test_branches_are_independent_and_what_remains_is_small(factors, parts):
    branches, n = divide(factors, parts), len(factors.inverse_pivot)
    part = np.full(n, -1)
    for p, nodes in enumerate(branches.node):
        assert np.array_equal(nodes, np.unique(nodes)) and (part[nodes] == -1).all()
        part[nodes] = p
    assert np.array_equal(np.flatnonzero(part == -1), branches.top)
    column = np.repeat(np.arange(n), np.diff(factors.start))
    assert ((part[factors.row] == part[column]) | (part[factors.row] == -1)).all()
    inside = factors.start[:-1] + np.bincount(column, part[factors.row] >= 0, n).astype(int)
    assert np.array_equal(branches.inside[part >= 0], inside[part >= 0])
    assert len(branches.column) == (part[factors.row] == -1).sum()


def test_branches_share_the_work():
    factors = FACTORS["closed"]
    entries = np.diff(factors.start)
    for parts, left in ((2, 0.25), (4, 0.5)):
        branches = divide(factors, parts)
        share = np.array([entries[nodes].sum() for nodes in branches.node]) / entries.sum()
        assert entries[branches.top].sum() < left * entries.sum()
        assert share.max() < 1.5 * share.min()
