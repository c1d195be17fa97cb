from __future__ import annotations

import numpy as np
import pytest

from baselines.arap_sr.anderson import Anderson


def test_acceleration_solves_a_small_linear_iteration_in_as_many_steps_as_unknowns():
    rng = np.random.default_rng(10)
    A = 0.9 * np.linalg.qr(rng.normal(size=(4, 4)))[0] * [0.5, 1.0, 0.8, 0.9]
    b, u, mixer = rng.normal(size=4), np.zeros(4), Anderson(4, 5)
    for _ in range(6):
        g = A @ u + b
        mixer.advance(u, g)
        assert np.array_equal(mixer.plain, g)
    assert u == pytest.approx(np.linalg.solve(np.eye(4) - A, b), abs=1e-10)


def test_acceleration_step_equals_the_least_squares_formula():
    rng = np.random.default_rng(11)
    U, G = rng.normal(size=(2, 9, 30))
    mixer, u = Anderson(30, 3), np.empty(30)
    for k in range(9):
        u[:] = U[k]
        mixer.advance(u, G[k])
        first = max(0, k - 3)
        dF, dG = np.diff((G - U)[first : k + 1], axis=0).T, np.diff(G[first : k + 1], axis=0).T
        theta = np.linalg.lstsq(dF, G[k] - U[k], rcond=None)[0] if k else np.zeros(0)
        assert u == pytest.approx(G[k] - dG @ theta, abs=1e-11)


def test_acceleration_survives_repeated_differences():
    mixer, u = Anderson(6, 4), np.zeros(6)
    for _ in range(6):
        u[:] = 0.0
        mixer.advance(u, np.ones(6))
    assert np.array_equal(u, np.ones(6))
