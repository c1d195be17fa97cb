"""The loop of an iteration, until the residual is below a tolerance."""

from __future__ import annotations

from math import inf
from typing import NamedTuple, Protocol

import numpy as np

from sshade.core.errors import counted
from sshade.core.kernels import kernel
from sshade.core.progress import Progress, silent
from sshade.problem.options import Stop

#: Iterations between two calls of the progress callback.
REPORT_EVERY = 10


class IterationState(Protocol):
    """The unknowns u of an iteration, and the steps that change them."""

    def step(self) -> float:
        """Compute the plain iterate g(u) from the present iterate u.

        Returns
        -------
        float
            The residual: the largest move ``max_i |g(u)_i - u_i|``, divided by the rest shape's bounding-box
            diagonal; or a larger move of another unknown.
        """

    def end_step(self, short: bool) -> bool:
        """Return whether the last step proves convergence.

        Parameters
        ----------
        short : bool
            The residual of the step is below the tolerance.
        """

    def move(self, *, last: bool) -> None:
        """Replace u by g(u) or by an accelerated iterate.

        Parameters
        ----------
        last : bool
            No step follows in this run. The iterate is then g(u), unless another run continues from it.
        """


class Run(NamedTuple):
    """How an iteration went: the residual of each step, and whether the last one is below the tolerance."""

    residual_curve: np.ndarray
    converged: bool

    @property
    def iterations(self) -> int:
        return len(self.residual_curve)

    @property
    def residual(self) -> float:
        """The last residual; infinite without an iteration."""
        return float(self.residual_curve[-1]) if self.iterations else inf


def run(
    state: IterationState, stop: Stop, *, progress: Progress = silent, report_every: int = REPORT_EVERY
) -> Run:
    """Iterate until a plain step moves no vertex by more than a tolerance.

    Parameters
    ----------
    state : IterationState
        Changed in place.
    stop : Stop
    progress : Progress
    report_every : int
        Iterations between two calls of `progress`.

    Raises
    ------
    FloatingPointError
        When a residual is not finite.
    """
    residuals: list[float] = []
    residual, converged, last = inf, False, stop.max_iterations == 0
    progress("iterations", 0, stop.max_iterations)
    while not last:
        residual = state.step()
        residuals.append(residual)
        iterations = len(residuals)
        if not np.isfinite(residual):
            raise FloatingPointError(
                f"the positions are not finite after {counted(iterations, 'iteration', 'iterations')}"
            )
        converged = state.end_step(residual < stop.tolerance) and iterations >= stop.least_iterations
        last = converged or iterations == stop.max_iterations
        state.move(last=last)
        if iterations % report_every == 0:
            progress("iterations", iterations, stop.max_iterations, f"residual {residual:.1e}")
    progress("iterations", len(residuals), len(residuals), f"residual {residual:.1e}")
    return Run(np.array(residuals), converged)


@kernel
def largest_move(A, B):
    """Return ``max_i |A_i - B_i|`` of two (n, 3) arrays; NaN if one has NaN."""
    largest = 0.0
    for i in range(len(A)):
        x, y, z = A[i, 0] - B[i, 0], A[i, 1] - B[i, 1], A[i, 2] - B[i, 2]
        square = x * x + y * y + z * z
        if not square <= largest:  # also true for NaN, which then stays
            largest = square
            if np.isnan(square):
                break
    return np.sqrt(largest)
