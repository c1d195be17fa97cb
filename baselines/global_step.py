"""What local/global methods share: the prefactored global step, and the loop with the one stopping rule."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from sshade.progress import Progress
from sshade.solver.factorisation import Factorisation
from sshade.solver.quasi_newton import largest_move
from sshade.task import DeformationResult

#: Iterations between two calls of the progress callback, by default.
REPORT_EVERY = 10


class GlobalStep:
    """Solves ``L q = b`` for the free rows of q; the held ones keep their targets.

    Parameters
    ----------
    laplacian : (n, n) sparse float64
        Symmetric, positive semi-definite; see :func:`sshade.solver.cotangents.laplacian_matrix`.
    held : (k,) int
        Rows with prescribed positions, at least one per component.
    targets : (k, 3) float64
        Those positions, in the mesh's unit of length.

    Raises
    ------
    FloatingPointError
        When the free rows are not positive definite.
    """

    def __init__(self, laplacian: csr_array, held: np.ndarray, *, targets: np.ndarray) -> None:
        free = np.setdiff1d(np.arange(laplacian.shape[0]), held)
        self._factor = Factorisation(laplacian[free][:, free])
        self._free = free[self._factor.order]
        self._fixed = -(laplacian[self._free][:, held] @ targets)

    def solve(self, B: np.ndarray, out: np.ndarray) -> None:
        """Write the free rows of the solution for right-hand sides B (n, 3) into `out` (n, 3)."""
        X = B[self._free]
        X += self._fixed
        self._factor.solve_ordered(X)
        out[self._free] = X


def iterate(
    advance: Callable[[np.ndarray, np.ndarray], None],
    u: np.ndarray,
    *,
    scale: float,
    tolerance: float,
    max_iterations: int,
    progress: Progress,
    mix: Callable[[np.ndarray, np.ndarray], None] = np.copyto,
    other_move: Callable[[], float] = float,
    report_every: int = REPORT_EVERY,
) -> np.ndarray:
    """Repeat ``u <- g(u)`` until no vertex moves by more than a tolerance.

    Parameters
    ----------
    advance : callable
        ``advance(u, out)`` writes the free rows of g(u) to `out`.
    u : (n, 3) float64
        Where to begin; replaced by the last iterate.
    scale : float
        The rest shape's bounding-box diagonal.
    tolerance : float
        Residual ``max_i |g(u)_i - u_i| / scale`` under which iteration stops. 0 never stops early.
    max_iterations : int
    progress : Progress
    mix : callable
        ``mix(u, g)`` replaces u by the next iterate, by default g itself; what ends the loop
        is a plain g in any case.
    other_move : callable
        How far unknowns besides the positions moved in the last `advance`, without a unit;
        the residual is the larger of both.
    report_every : int
        Iterations between two calls of `progress`.

    Returns
    -------
    (iterations,) float64
        The residual of each.

    Raises
    ------
    FloatingPointError
        When an iterate is not finite.
    """
    g = u.copy()
    residuals, residual = [], np.inf
    while len(residuals) < max_iterations and residual >= tolerance:
        advance(u, g)
        residual = max(float(largest_move(g, u)) / scale, other_move())
        residuals.append(residual)
        iterations = len(residuals)
        if not np.isfinite(residual):
            raise FloatingPointError(f"the positions are not finite after {iterations} iterations")
        if residual < tolerance or iterations == max_iterations:
            u[:] = g
        else:
            mix(u, g)
        if iterations % report_every == 0:
            progress("iterations", iterations, max_iterations, f"residual {residual:.1e}")
    progress("iterations", len(residuals), max_iterations, f"residual {residual:.1e}")
    return np.array(residuals)


def iterated(
    vertices: np.ndarray,
    residuals: np.ndarray,
    *,
    tolerance: float,
    seconds: dict[str, float],
    extra: dict[str, Any] | None = None,
) -> DeformationResult:
    """The result of a method that :func:`iterate` ran.

    Parameters
    ----------
    vertices : (n, 3) float64
    residuals : (iterations,) float64
        What `iterate` returned.
    tolerance : float
        What it was given: the method converged where the last residual is below.
    seconds : dict
    extra : dict, optional
        The last ``residual``, infinite where there was no iteration, and the ``residual_curve``
        are added.
    """
    last = float(residuals[-1]) if len(residuals) else np.inf
    return DeformationResult(
        vertices=vertices,
        iterations=len(residuals),
        converged=last < tolerance,
        seconds=seconds,
        extra={**(extra or {}), "residual": last, "residual_curve": residuals},
    )
