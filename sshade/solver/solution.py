"""The result of a solve."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sshade.problem.task import DeformationResult
from sshade.solver.constraints import ConstraintReport


@dataclass(frozen=True, eq=False)
class Solution:
    """A deformed shape and how the iteration went.

    Attributes
    ----------
    positions : (n, 3) float64
        Hard handles are on their targets exactly.
    rotations : (n, 3, 3) float64 or None
        Rotations of the local step at `positions`, from rest edges to deformed ones. None if another method
        gave none.
    iterations : float
        Global steps.
    converged : bool or None
    residual : float or None
        Largest move of a vertex in the last plain iteration, as a fraction of the bounding-box diagonal.
    residual_curve : (iterations,) float64 or None
        Residual of each iteration.
    energy : float or None
        Energy after the local step at `positions`, with the penalties of weighted constraints and the pulls
        of soft handles; unit length^2.
    rejected : int
        Accelerated iterates that were given up because the energy rose.
    coarser_iterations : float or None
        Iterations on a coarser proxy in which the solve began; 0 without one.
    constraints : ConstraintReport
    """

    positions: np.ndarray
    rotations: np.ndarray | None
    iterations: float
    converged: bool | None
    residual: float | None = None
    residual_curve: np.ndarray | None = None
    energy: float | None = None
    rejected: int = 0
    coarser_iterations: float | None = None
    constraints: ConstraintReport = ConstraintReport()

    @classmethod
    def of_method(cls, result: DeformationResult) -> Solution:
        """Return the solution that a method of the user found, with the facts of ours that it knows."""
        facts = result.extra
        return cls(
            result.vertices,
            facts.get("rotations"),
            result.iterations,
            result.converged,
            residual=facts.get("residual"),
            energy=facts.get("energy"),
            coarser_iterations=facts.get("coarser_iterations"),
            constraints=ConstraintReport(
                facts.get("volume_error"),
                facts.get("area_error"),
                facts.get("volume_constraint"),
                facts.get("area_constraint"),
                facts.get("volume_pressure"),
                facts.get("area_pressure"),
            ),
        )

    def result(self, seconds: Mapping[str, float]) -> DeformationResult:
        """Return the result of a method of its own, with the seconds of its stages."""
        extra = {
            "rotations": self.rotations,
            "residual": self.residual,
            "residual_curve": self.residual_curve,
            "energy": self.energy,
            "rejected": self.rejected,
            **self.constraints._asdict(),
        }
        return DeformationResult(self.positions, self.iterations, self.converged, seconds, extra)
