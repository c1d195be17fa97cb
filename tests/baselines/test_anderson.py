import numpy as np
import pytest

from baselines.arap_sr.anderson import Anderson


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
