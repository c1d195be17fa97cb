from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from sshade.solver.conjugate_gradients import conjugate_gradients
from sshade.solver.multigrid import Multigrid
from sshade.threads import ThreadTeam
from tests.sshade.solver.test_multigrid import CASES, matrix


def solved(name: str, tolerance: float, *, workers: int = 1, coarsest: int = 100):
    A, held = matrix(name)
    free = ~held
    B = np.random.default_rng(0).normal(size=(len(held), 3)) * [1.0, 1e3, 0.0]
    B[held] = 0.0
    X = np.full_like(B, np.nan)
    multigrid = Multigrid(A, held, coarsest=coarsest)
    with ThreadTeam(workers) as team:
        conjugate_gradients(multigrid, B, X, held=np.flatnonzero(held), tolerance=tolerance, team=team)
    return A[free][:, free], B[free], X[free], X[held]


@pytest.mark.parametrize("tolerance", [1e-1, 1e-2, 1e-3])
@pytest.mark.parametrize("name", CASES)
def test_each_column_is_as_near_as_asked_for(name, tolerance):
    A, B, X, held = solved(name, tolerance)
    assert not held.any() and not X[:, 2].any()
    exact = spsolve(A.tocsc(), B[:, :2])
    error = X[:, :2] - exact
    left = np.sqrt((error * (A @ error)).sum(axis=0) / (exact * (A @ exact)).sum(axis=0))
    # Cycles estimate energies to within the share of an error that they leave. Of single precision,
    # cotangents of 1e5 beside those of 1 leave three digits.
    single = 0.1 if name == "faces without area" else 1e-5
    assert (left < max(tolerance / np.sqrt(1 - CASES[name][2]), single)).all()


def test_what_is_factorised_itself_is_solved_exactly():
    A, B, X, _ = solved("boundary", 0.1, coarsest=10**6)
    assert np.abs(A @ X - B).max() < 1e-10 * np.abs(B).max()


def test_bits_do_not_depend_on_threads(monkeypatch):
    monkeypatch.setattr("sshade.threads.ROWS", 100)
    one, two = (solved("closed, few handles", 1e-2, workers=workers)[2] for workers in (1, 3))
    assert np.array_equal(one, two)
