"""Plain local/global iterations in the loop of our own solver, and the results of methods that use it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from sshade.progress import Progress
from sshade.solver.run import REPORT_EVERY, Stop, largest_move, run
from sshade.task import DeformationResult


class Plain:
    """Positions under plain iterations ``u <- g(u)``; a :class:`sshade.solver.run.State`.

    Parameters
    ----------
    advance : callable
        ``advance(u, out)`` writes g(u) to `out` (n, 3).
    u : (n, 3) float64
        Where to begin; replaced by each iterate.
    diagonal : float
        Bounding-box diagonal of the rest shape.
    """

    def __init__(
        self, advance: Callable[[np.ndarray, np.ndarray], None], u: np.ndarray, *, diagonal: float
    ) -> None:
        self._advance, self._diagonal = advance, diagonal
        self.u, self.g = u, u.copy()

    def step(self) -> float:
        self._advance(self.u, self.g)
        return float(largest_move(self.g, self.u)) / self._diagonal

    def end_step(self, short: bool) -> bool:
        return short

    def move(self, *, last: bool) -> None:
        self.u[:] = self.g


def iterate(
    advance: Callable[[np.ndarray, np.ndarray], None],
    u: np.ndarray,
    *,
    scale: float,
    tolerance: float,
    max_iterations: int,
    progress: Progress,
    report_every: int = REPORT_EVERY,
) -> np.ndarray:
    """Repeat ``u <- g(u)`` until no vertex moves by more than a tolerance.

    Parameters
    ----------
    advance, u
        As of :class:`Plain`.
    scale : float
        Bounding-box diagonal of the rest shape.
    tolerance, max_iterations
        As of :class:`sshade.solver.run.Stop`.
    progress : Progress
    report_every : int
        Iterations between two calls of `progress`.

    Returns
    -------
    (iterations,) float64
        The residual of each iteration.
    """
    state, stop = Plain(advance, u, diagonal=scale), Stop(tolerance, max_iterations)
    return run(state, stop, progress=progress, report_every=report_every).residual_curve


def iterated(
    vertices: np.ndarray,
    residuals: np.ndarray,
    *,
    tolerance: float,
    seconds: dict[str, float],
    extra: dict[str, Any] | None = None,
) -> DeformationResult:
    """Return the result of a method that :func:`iterate` ran.

    Parameters
    ----------
    vertices : (n, 3) float64
    residuals : (iterations,) float64
        Residual of each iteration.
    tolerance : float
        The method converged if the last residual is below.
    seconds : dict
    extra : dict, optional
        The last ``residual``, infinite without an iteration, and the ``residual_curve`` are added.
    """
    last = float(residuals[-1]) if len(residuals) else np.inf
    return DeformationResult(
        vertices=vertices,
        iterations=len(residuals),
        converged=last < tolerance,
        seconds=seconds,
        extra={**(extra or {}), "residual": last, "residual_curve": residuals},
    )
