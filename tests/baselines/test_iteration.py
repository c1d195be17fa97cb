"""The loop with the stopping rule."""

import numpy as np
import pytest

from baselines.iteration import Plain
from sshade.solver.run import Stop, run


def iterated(advance, u, **changes):
    stop = Stop(changes.pop("tolerance", 1e-3), changes.pop("max_iterations", 50))
    return run(Plain(advance, u, diagonal=2.0), stop, **changes).residual_curve


def halve(u, out):
    out[:] = 0.5 * u


def test_the_loop_stops_at_the_first_move_under_the_tolerance():
    u = np.zeros((2, 3))
    u[1, 2] = 1.0
    # Moves of 2^-1, 2^-2, ... over a scale of 2: the ninth is the first under 1e-3.
    np.testing.assert_array_equal(iterated(halve, u), 2.0 ** -np.arange(2, 11))
    assert u[1, 2] == 2.0**-9


def test_an_iterate_that_is_not_finite_ends_the_loop():
    def diverge(u, out):
        out[:] = np.nan

    with pytest.raises(FloatingPointError, match="not finite after 1 iteration"):
        iterated(diverge, np.ones((1, 3)))
