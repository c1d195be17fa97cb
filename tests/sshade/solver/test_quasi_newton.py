import numpy as np
import pytest

from sshade.solver.quasi_newton import QuasiNewton

N = 7


def positive(rng: np.random.Generator, size: int) -> np.ndarray:
    A = rng.normal(size=(size, size))
    return A @ A.T + 0.1 * np.eye(size)


def problem(seed: int, n: int = N):
    """Random numbers, a metric L (n, n) and a Hessian A (3 n, 3 n)."""
    rng = np.random.default_rng(seed)
    return rng, positive(rng, n), positive(rng, 3 * n)


def plain(u: np.ndarray, L: np.ndarray, A: np.ndarray) -> np.ndarray:
    """u less L^-1 of the gradient."""
    return u - np.linalg.solve(L, (A @ u.ravel()).reshape(u.shape))


def updated(H: np.ndarray, s: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The BFGS formula for an inverse Hessian."""
    rho, one = 1 / (s @ y), np.eye(len(s))
    return (one - rho * np.outer(s, y)) @ H @ (one - rho * np.outer(y, s)) + rho * np.outer(s, s)


@pytest.mark.parametrize(("single", "close"), [(False, 1e-8), (True, 1e-4)])
@pytest.mark.parametrize("window", [1, 3, 20])
@pytest.mark.parametrize("unit", [1.0, 1e40, 1e-45])
def test_steps_are_those_of_the_bfgs_formula_from_the_metric_on(unit, window, single, close):
    rng, L, A = problem(window)
    U, mixer = unit * rng.normal(size=(9, N, 3)), QuasiNewton(N, window, unit=3 * unit, single=single)
    gradients = [A @ u.ravel() for u in U]
    for k in range(len(U)):
        H = np.kron(np.linalg.inv(L), np.eye(3))
        for i in range(max(0, k - window), k):
            H = updated(H, (U[i + 1] - U[i]).ravel(), gradients[i + 1] - gradients[i])
        u, g = U[k].copy(), plain(U[k], L, A)
        assert mixer.advance(u, g.copy(), L @ (g - u)) == (k > 0)
        back = np.empty_like(g)
        mixer.fall_back(back)
        assert back == pytest.approx(g, rel=0, abs=1e-14 * np.abs(g).max())
        expected = U[k] - (H @ gradients[k]).reshape(N, 3)
        assert np.abs(u - expected).max() < close * np.abs(expected).max()
    mixer.move(u, 0.5)
    assert u == pytest.approx((U[-1] + expected) / 2, rel=close, abs=close * unit)


def test_after_a_direction_that_does_not_descend_earlier_pairs_are_forgotten():
    rng, L, A = problem(5)
    U, old, new = rng.normal(size=(7, N, 3)), QuasiNewton(N, 3), QuasiNewton(N, 3)
    for k, u in enumerate(U):
        g = plain(u, L, A)
        product = L @ (g - u) * (-1 if k == 4 else 1)
        if k < 4:
            old.advance(u.copy(), g.copy(), product)
            continue
        one, other = u.copy(), u.copy()
        descends = [old.advance(one, g.copy(), product), new.advance(other, g.copy(), product)]
        assert descends == [k == 6] * 2 and np.array_equal(one, other)


def test_a_large_problem_goes_block_by_block():
    n = 1500  # 4500 numbers: four blocks and a part
    rng = np.random.default_rng(0)
    weight, stiff = rng.uniform(1, 2, n), rng.uniform(1, 3, (n, 3))
    u, mixer = rng.normal(size=(n, 3)), QuasiNewton(n, 5)
    for _ in range(40):
        mixer.advance(u, u - stiff * u / weight[:, None], -stiff * u)
    assert np.abs(u).max() < 1e-9


def test_where_the_energy_curves_down_nothing_is_learnt():
    rng, L, A = problem(5)
    mixer = QuasiNewton(N, 3)
    for u in rng.normal(size=(5, N, 3)):
        g, now = plain(u, L, -A), u.copy()
        assert not mixer.advance(now, g.copy(), L @ (g - u)) and now == pytest.approx(g, rel=1e-14, abs=1e-14)
