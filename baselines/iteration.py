"""Plain iterations in the loop of :mod:`sshade.solver.run`: their start, their steps, their results."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, get_args

import numpy as np

from sshade.core.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import rigid_motion
from sshade.problem.handles import Handles
from sshade.problem.options import Start
from sshade.problem.task import DeformationResult, DeformationTask
from sshade.solver.run import Run, largest_move


def start_motion(task: DeformationTask, start: Start) -> tuple[np.ndarray, np.ndarray]:
    """Return R (3, 3) and t (3,), by which methods start whose unknowns are not the vertices of the mesh.

    "rest" is the identity, and "rigid" the best rigid motion of the handles.

    Raises
    ------
    InputError
        If the start is unknown.
    """
    if start not in get_args(Start):
        raise InputError(f"unknown start {start!r}; use 'rest' or 'rigid'")
    if start == "rest":
        return np.eye(3), np.zeros(3)
    return rigid_motion(task.mesh.V[task.handles.index], task.handles.target)


class Plain:
    """Positions under plain iterations ``u <- g(u)``; a :class:`sshade.solver.run.IterationState`.

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


def iterated(
    vertices: np.ndarray, done: Run, seconds: dict[str, float], extra: Mapping[str, Any] | None = None
) -> DeformationResult:
    """Return the result of an iterative method.

    Parameters
    ----------
    vertices : (n, 3) float64
    done : Run
        The last residual becomes the fact ``residual``.
    seconds : dict
        Time of each stage.
    extra : mapping, optional
        Further facts.
    """
    facts = {**(extra or {}), "residual": done.residual}
    return DeformationResult(vertices, done.iterations, done.converged, seconds, facts)


def handle_error(mesh: Mesh, handles: Handles, V: np.ndarray) -> float:
    """Return the mean distance of handles at positions V (n, 3) to their targets, divided by the diagonal."""
    return float(np.linalg.norm(V[handles.index] - handles.target, axis=1).mean()) / mesh.diagonal
