"""The prefactored global step, and the loop with the stopping rule."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.global_step import REPORT_EVERY, GlobalStep, iterate
from sshade.progress import silent
from sshade.solver.cotangents import edge_weights, half_cotangents, laplacian_matrix


def run(advance, u, **changes):
    values = {"scale": 2.0, "tolerance": 1e-3, "max_iterations": 50, "progress": silent}
    return iterate(advance, u, **{**values, **changes})


def halve(u, out):
    out[:] = 0.5 * u


def test_global_step_solves_the_free_rows_and_leaves_the_held_ones(small_body):
    edges, weights = edge_weights(small_body, half_cotangents(small_body))
    L = laplacian_matrix(small_body.n, edges, weights)
    rng = np.random.default_rng(0)
    held = rng.permutation(small_body.n)[:12]
    B, q = rng.normal(size=(small_body.n, 3)), np.full((small_body.n, 3), 7.0)
    targets = rng.normal(size=(12, 3))
    GlobalStep(L, held, targets=targets).solve(B, q)
    np.testing.assert_array_equal(q[held], 7.0)
    q[held] = targets
    free = np.setdiff1d(np.arange(small_body.n), held)
    np.testing.assert_allclose((L @ q)[free], B[free], atol=1e-11)


def test_the_loop_stops_at_the_first_move_under_the_tolerance():
    u = np.zeros((2, 3))
    u[1, 2] = 1.0
    # Moves of 2^-1, 2^-2, ... over a scale of 2: the ninth is the first under 1e-3.
    np.testing.assert_array_equal(run(halve, u), 2.0 ** -np.arange(2, 11))
    assert u[1, 2] == 2.0**-9


def test_the_loop_stops_at_the_cutoff_and_reports():
    seen, options = [], {"tolerance": 0, "max_iterations": 2 * REPORT_EVERY + 1}
    residuals = run(halve, np.ones((1, 3)), progress=lambda *report: seen.append(report[:3]), **options)
    iterations = len(residuals)
    assert iterations == 2 * REPORT_EVERY + 1 and residuals.all()
    assert seen == [("iterations", done, iterations) for done in (REPORT_EVERY, 2 * REPORT_EVERY, iterations)]


def test_no_iterations_leave_the_start():
    u = np.ones((1, 3))
    assert len(run(halve, u, max_iterations=0)) == 0
    np.testing.assert_array_equal(u, 1.0)


def test_an_iterate_that_is_not_finite_ends_the_loop():
    def diverge(u, out):
        out[:] = np.nan

    with pytest.raises(FloatingPointError, match="not finite after 1 iterations"):
        run(diverge, np.ones((1, 3)))


def test_the_next_iterate_may_be_mixed_but_the_last_is_plain():
    """Extrapolation to the fixed point of the halving ends it in the second iteration."""
    seen = []

    def mix(u, g):
        seen.append(u.copy())
        u += 2 * (g - u)

    u = np.ones((1, 3))
    residuals = run(halve, u, mix=mix)
    assert len(residuals) == 2 and residuals[0] > 0 == residuals[1]
    assert len(seen) == 1
    u = np.ones((1, 3))
    run(halve, u, mix=mix, max_iterations=1)
    np.testing.assert_array_equal(u, 0.5)
