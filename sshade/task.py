"""What goes into a deformation method and what comes out of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from sshade.handles import Handles
from sshade.mesh.mesh import Mesh
from sshade.progress import Progress, silent


@dataclass(frozen=True, eq=False)
class DeformationTask:
    """One deformation problem: a rest mesh and handles.

    Parameters
    ----------
    name : str
    mesh : Mesh
        Rest shape M.
    handles : Handles
    truth : (n, 3) float64, optional
        The true deformed positions, where they are known.
    guess : (n, 3) float64, optional
        A shape for iterative methods to begin from, whatever their `start`.
    meta : mapping
        Flat facts for the row of a table (subject, pose, ...).
    carry_unconstrained : bool
        Components without handles are to move rigidly with the nearest one, as eyes with a head.
        The methods of this package do that, others may fail on them.

    Raises
    ------
    InputError
        When a handle is no vertex of the mesh, a component has no handle and is not to be carried, or
        `truth` or `guess` have another shape than the vertices.
    """

    name: str
    mesh: Mesh
    handles: Handles
    truth: np.ndarray | None = None
    guess: np.ndarray | None = None
    meta: Mapping[str, Any] = field(default_factory=dict)
    carry_unconstrained: bool = False

    def __post_init__(self) -> None:
        self.mesh.require_handles(self.handles.index, everywhere=not self.carry_unconstrained)
        object.__setattr__(self, "handles", self.handles.with_portions(self.mesh))
        for name in ("truth", "guess"):
            if getattr(self, name) is not None:
                self.mesh.checked(getattr(self, name), name)


@dataclass(frozen=True, eq=False)
class DeformationResult:
    """Deformed vertices and how they came about.

    Parameters
    ----------
    vertices : (n, 3) float64
        M', in the numbering of the task's mesh.
    iterations : int
        Steps of the iterative part; the mean over samplings where there are several.
    converged : bool or None
        Whether the stopping rule was met; None for methods without one.
    seconds : mapping
        Wall-clock time of each stage.
    extra : mapping
        Further flat facts for the row (last residual, counts, ...), and
        arrays: those named ``*_curve``, a line a step, are kept with the run.

    Raises
    ------
    FloatingPointError
        When a position is not finite: the method failed on this input.
    """

    vertices: np.ndarray
    iterations: float
    converged: bool | None
    seconds: Mapping[str, float] = field(default_factory=dict)
    extra: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not np.isfinite(self.vertices).all():
            count = int((~np.isfinite(self.vertices).all(axis=1)).sum())
            raise FloatingPointError(
                f"{count} deformed vertices are not finite; zero-area triangles in the rest mesh do this"
            )


class Method(Protocol):
    """A deformation method: a function of a task; its parameters are keyword-only with defaults."""

    def __call__(
        self, task: DeformationTask, *, seed: int, progress: Progress = silent
    ) -> DeformationResult: ...
