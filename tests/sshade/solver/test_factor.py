from __future__ import annotations

import importlib.util
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import scipy.sparse as sp

from sshade import InputError
from sshade.solver.cotangents import edge_weights, half_cotangents, laplacian_matrix
from sshade.solver.factor import ENGINES, factor
from tests.shapes import bumpy, jittered, strip

HAS_CHOLESPY = importlib.util.find_spec("cholespy") is not None
INSTALLED = [e for e in ENGINES if e != "cholespy" or HAS_CHOLESPY]


def system(mesh, *, held: int = 7) -> sp.csr_array:
    """Laplacian without the rows and columns of every `held`-th vertex."""
    free = np.flatnonzero(np.arange(mesh.n) % held)
    return laplacian_matrix(mesh.n, *edge_weights(mesh, half_cotangents(mesh)))[free][:, free]


@pytest.fixture(scope="module", params=["closed", "open"])
def Q(request) -> sp.csr_array:
    return system(bumpy(3) if request.param == "closed" else jittered(strip(30, 12), 0.2))


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("columns", [1, 2, 3, 4, 6, 9])
def test_solves_to_rounding(Q, engine, columns):
    B = np.random.default_rng(0).normal(size=(Q.shape[0], columns))
    X = factor(Q, engine=engine).solve(B)
    assert X.shape == B.shape
    assert np.abs(Q @ X - B).max() < 1e-12 * np.abs(B).max()
    assert np.allclose(X, np.linalg.solve(Q.toarray(), B), rtol=0, atol=1e-12 * np.abs(X).max())


def test_engines_agree(Q):
    B = np.random.default_rng(1).normal(size=(Q.shape[0], 3))
    solutions = [factor(Q, engine=engine).solve(B) for engine in INSTALLED]
    for X in solutions:
        assert np.abs(X - solutions[0]).max() < 1e-12 * np.abs(X).max()


def test_columns_do_not_depend_on_their_number(Q):
    B = np.random.default_rng(2).normal(size=(Q.shape[0], 9))
    solver = factor(Q)
    alone = [solver.solve(B[:, [c]])[:, 0] for c in range(9)]
    for columns in (3, 6, 9):
        together = solver.solve(B[:, :columns])
        assert all(np.array_equal(alone[c], together[:, c]) for c in range(columns))


@pytest.mark.parametrize("engine", INSTALLED)
def test_ordered_solve_is_the_permuted_one(Q, engine):
    solver = factor(Q, engine=engine)
    assert np.array_equal(np.sort(solver.order), np.arange(Q.shape[0]))
    B = np.random.default_rng(3).normal(size=(Q.shape[0], 3))
    X = B[solver.order].copy()
    solver.solve_ordered(X)
    assert np.array_equal(X, solver.solve(B)[solver.order])


@pytest.mark.parametrize("engine", INSTALLED)
def test_out_is_filled_and_may_be_the_right_hand_side(Q, engine):
    solver = factor(Q, engine=engine)
    B = np.random.default_rng(4).normal(size=(Q.shape[0], 3))
    expected, out = solver.solve(B), np.empty_like(B)
    before = B.copy()
    assert solver.solve(B, out) is out
    assert np.array_equal(out, expected) and np.array_equal(B, before)
    solver.solve(B, B)
    assert np.array_equal(B, expected)


def test_fill_is_that_of_a_symmetric_ordering():
    """A column ordering stores L and U with more entries each than this L alone."""
    Q = system(bumpy(4))
    lu = sp.linalg.splu(sp.csc_matrix(Q))
    assert len(factor(Q)._factors.value) < 0.5 * (lu.L.nnz + lu.U.nnz)


def test_auto_does_not_depend_on_what_is_installed(Q):
    assert factor(Q).engine == "superlu"


@pytest.mark.parametrize("engine", INSTALLED)
def test_nothing_to_solve(engine):
    assert factor(sp.csr_array((0, 0)), engine=engine).solve(np.empty((0, 3))).shape == (0, 3)


def test_one_factor_serves_many_threads(Q):
    solver = factor(Q)
    right = [np.random.default_rng(seed).normal(size=(Q.shape[0], 3)) for seed in range(16)]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(solver.solve, right))
    assert all(np.array_equal(X, solver.solve(B)) for X, B in zip(together, right, strict=True))


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize(
    "matrix",
    [
        [[1.0, 2.0, 0], [2.0, 1.0, 0], [0, 0, 1.0]],  # indefinite
        [[1.0, 0, 0], [0, -2.0, 0], [0, 0, 1.0]],  # a negative pivot
        [[1.0, -1.0, 0], [-1.0, 1.0, 0], [0, 0, 1.0]],  # singular
    ],
)
def test_not_positive_definite(engine, matrix):
    with pytest.raises(FloatingPointError, match="not positive definite"):
        factor(sp.csr_array(np.array(matrix)), engine=engine)


def test_not_finite():
    with pytest.raises(FloatingPointError, match="not finite"):
        factor(sp.csr_array(np.array([[np.nan, 0], [0, 1.0]])))


def test_unknown_engine(Q):
    with pytest.raises(InputError, match="unknown engine 'umfpack'"):
        factor(Q, engine="umfpack")


def test_missing_engine_names_the_extra(Q, monkeypatch):
    monkeypatch.setitem(sys.modules, "cholespy", None)
    with pytest.raises(InputError, match=r"sshade\[fast\]"):
        factor(Q, engine="cholespy")
