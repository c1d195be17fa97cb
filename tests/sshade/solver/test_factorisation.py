import numpy as np
import pytest
import scipy.sparse as sp

from sshade.core.threads import ThreadTeam
from sshade.solver import factorisation
from sshade.solver.factorisation import Factorisation
from sshade.solver.laplacian import edge_weights, half_cotangents, laplacian_matrix
from tests.shapes import bumpy, jittered, strip


def system(mesh, *, held: int = 7) -> sp.csr_array:
    """Laplacian without the rows and columns of every `held`-th vertex."""
    free = np.flatnonzero(np.arange(mesh.n) % held)
    return laplacian_matrix(mesh.n, *edge_weights(mesh, half_cotangents(mesh)))[free][:, free]


@pytest.fixture(scope="module", params=["closed", "open"])
def Q(request) -> sp.csr_array:
    return system(bumpy(3) if request.param == "closed" else jittered(strip(30, 12), 0.2))


@pytest.mark.parametrize("columns", [1, 2, 3])
def test_solves_to_rounding_and_each_column_alone(Q, columns):
    B = np.random.default_rng(0).normal(size=(Q.shape[0], columns))
    factorisation = Factorisation(Q)
    X = factorisation.solve(B)
    assert np.allclose(X, np.linalg.solve(Q.toarray(), B), rtol=0, atol=1e-12 * np.abs(X).max())
    for c in range(columns):
        assert np.array_equal(X[:, [c]], factorisation.solve(B[:, [c]]))


def test_two_threads_divide_the_work_and_return_the_bits_of_one(monkeypatch):
    Q = system(bumpy(4))
    whole = Factorisation(Q)
    monkeypatch.setattr(factorisation, "SHARED", 0)
    divided = Factorisation(Q)
    first, top = divided.halves
    start, row, *_ = divided.factors
    assert whole.halves == (0, 0) and 0 < first < top < Q.shape[0]
    assert (row[start[0] : start[first]] < first).any()
    assert not np.isin(row[: start[first]], range(first, top)).any()
    work = np.diff(start[[0, first, top, -1]].astype(int))
    assert max(work[:2]) < 0.6 * work[:2].sum() and work[2] < 0.4 * work.sum()
    B = np.random.default_rng(0).normal(size=(Q.shape[0], 3))
    assert np.allclose(divided.solve(B), whole.solve(B), rtol=0, atol=1e-12 * np.abs(whole.solve(B)).max())
    one, two = B.copy(), B.copy()
    divided.solve_ordered(one)
    with ThreadTeam(2) as team:
        divided.solve_ordered(two, team)
    assert np.array_equal(one, two)


@pytest.mark.parametrize("Q", [sp.eye_array(40), sp.csr_array(np.eye(40) + 1.0)], ids=["diagonal", "full"])
def test_matrices_without_halves_and_of_single_columns(monkeypatch, Q):
    monkeypatch.setattr(factorisation, "SHARED", 0)
    B = np.random.default_rng(0).normal(size=(40, 3))
    factorisation_of_Q = Factorisation(sp.csr_array(Q))
    assert np.allclose(factorisation_of_Q.solve(B), np.linalg.solve(Q.toarray(), B), rtol=0, atol=1e-12)
    assert factorisation_of_Q.halves in ((0, 0), (20, 40))
    assert Factorisation(sp.csr_array((0, 0))).solve(np.empty((0, 3))).shape == (0, 3)


@pytest.mark.parametrize(
    "matrix",
    [
        [[1.0, 2.0, 0], [2.0, 1.0, 0], [0, 0, 1.0]],  # indefinite
        [[1.0, 0, 0], [0, -2.0, 0], [0, 0, 1.0]],  # a negative pivot
        [[1.0, -1.0, 0], [-1.0, 1.0, 0], [0, 0, 1.0]],  # singular
        [[np.nan, 0], [0, 1.0]],
    ],
)
def test_not_positive_definite(matrix):
    with pytest.raises(FloatingPointError, match="not finite" if np.isnan(matrix).any() else "not positive"):
        Factorisation(sp.csr_array(np.array(matrix)))
