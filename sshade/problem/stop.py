"""When an iteration stops."""

from __future__ import annotations

from dataclasses import dataclass

from sshade.core.errors import InputError


@dataclass(frozen=True)
class Stop:
    """When an iteration stops.

    Attributes
    ----------
    tolerance : float
        Residual below which it stops; 0 never stops early. The residual is the largest move of a vertex in
        one plain iteration, as a fraction of the bounding-box diagonal.
    max_iterations : int
    least_iterations : int
        Convergence counts from this iteration on.

    Raises
    ------
    InputError
        When the tolerance or the number of iterations is negative, or no number.
    """

    tolerance: float = 1e-5
    max_iterations: int = 1000
    least_iterations: int = 0

    def __post_init__(self) -> None:
        tolerance, most = self.tolerance, self.max_iterations
        if not (tolerance >= 0 and most >= 0 and most % 1 == 0):
            raise InputError(
                "tolerance must be at least 0 and max_iterations a whole number of at least 0, not "
                f"{tolerance} and {most}"
            )
