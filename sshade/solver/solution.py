"""The result of a solve."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from sshade.problem.task import DeformationResult


class Solution(NamedTuple):
    """A deformed shape and how the iteration went.

    Attributes
    ----------
    positions : (n, 3) float64
        Hard handles are on their targets exactly.
    rotations : (n, 3, 3) float64
        Rotations of the local step at `positions`, from rest edges to deformed ones.
    iterations : int
        Global steps.
    residual : float
        Largest move of a vertex in the last plain iteration, as a fraction of the bounding-box diagonal.
    residual_curve : (iterations,) float64
        Residual of each iteration.
    energy, energy_initial : float
        Energies after the local steps at `positions` and at the start, with the penalties of weighted
        constraints and the pulls of soft handles; unit length^2. The start fulfils no constraint, so that its
        energy may be lower.
    converged : bool
    rejected : int
        Accelerated iterates that were given up because the energy rose.
    volume_error, area_error : float
    volume_constraint, area_constraint : str
        See :meth:`sshade.solver.constraints.Surface.report`.
    """

    positions: np.ndarray
    rotations: np.ndarray
    iterations: int
    residual: float
    residual_curve: np.ndarray
    energy: float
    energy_initial: float
    converged: bool
    rejected: int
    volume_error: float
    area_error: float
    volume_constraint: str
    area_constraint: str

    def result(self, seconds: Mapping[str, float] | None = None) -> DeformationResult:
        """Return the result of a task, with the seconds of its stages."""
        return DeformationResult(self.positions, self.iterations, self.converged, seconds or {}, self.facts())

    def facts(self) -> dict[str, Any]:
        """Return the fields for the `extra` of a result."""
        elsewhere = ("positions", "iterations", "converged")
        return {name: value for name, value in self._asdict().items() if name not in elsewhere}
