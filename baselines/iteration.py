"""Plain local/global iterations in the loop of :mod:`sshade.solver.run`, and their results."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from sshade.progress import Progress
from sshade.solver.run import REPORT_EVERY, Run, Stop, largest_move, run
from sshade.task import DeformationResult


class Plain:
    """Positions under plain iterations ``u <- g(u)``; a :class:`sshade.solver.run.State`.

    Parameters
    ----------
    advance : callable
        ``advance(u, out)`` writes g(u) to `out` (n, 3).
    u : (n, 3) float64
        Initial positions; replaced by each iterate.
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
    stop: Stop,
    *,
    diagonal: float,
    progress: Progress,
    report_every: int = REPORT_EVERY,
) -> Run:
    """Repeat ``u <- g(u)`` in place until no vertex moves by more than a tolerance.

    Parameters
    ----------
    advance, u, diagonal
        As of :class:`Plain`.
    stop : Stop
    progress : Progress
    report_every : int
        Number of iterations between two calls of `progress`.
    """
    return run(Plain(advance, u, diagonal=diagonal), stop, progress=progress, report_every=report_every)


def iterated(vertices: np.ndarray, done: Run, seconds: dict[str, float], **extra: Any) -> DeformationResult:
    """Return the result of an iterative method.

    Parameters
    ----------
    vertices : (n, 3) float64
    done : Run
        The residuals become the facts ``residual`` and ``residual_curve``.
    seconds : dict
        Time of each stage.
    **extra
        Further facts.
    """
    extra |= {"residual": done.residual, "residual_curve": done.residual_curve}
    return DeformationResult(vertices, done.iterations, done.converged, seconds, extra)
