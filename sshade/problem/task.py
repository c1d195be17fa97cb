"""Input and output of deformation methods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from sshade.core.errors import InputError, counted
from sshade.core.notebook_view import Shown
from sshade.core.progress import Progress, silent
from sshade.mesh.mesh import Mesh, require_mesh
from sshade.mesh.unconstrained import HOW_TO_CONSTRAIN
from sshade.problem.facts import Facts, Joint
from sshade.problem.handles import Handles

#: Largest move of a handle that is rounding, as a fraction of the bounding-box diagonal.
UNMOVED = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class DeformationTask(Shown):
    """One deformation problem: a rest mesh and handles.

    Parameters
    ----------
    name : str
    mesh : Mesh
        Rest shape M.
    handles : Handles
    truth : (n, 3) float64, optional
        Ground truth: the true deformed positions, if known.
    guess : (n, 3) float64, optional
        Shape in which iterative methods start, in place of their option `start`. Methods on tetrahedra or
        lattices ignore it.
    meta : mapping
        Plain values for the row of a table (subject, pose, ...).
    refuse_unconstrained : bool
        Refuse components without handles. By default the methods of this package move them rigidly with the
        nearest component, as eyes with a head; other methods may fail.

    Raises
    ------
    InputError
        When a handle is no vertex of the mesh, a component without handles is refused, or
        `truth` or `guess` differ in shape from the vertices.
    """

    name: str
    mesh: Mesh
    handles: Handles
    truth: np.ndarray | None = None
    guess: np.ndarray | None = None
    meta: Mapping[str, Any] = field(default_factory=dict)
    refuse_unconstrained: bool = False

    def __repr__(self) -> str:
        handles = counted(len(self.handles), "handle", "handles")
        return f"<DeformationTask {self.name!r}: {self.mesh.n} vertices, {handles}>"

    def __post_init__(self) -> None:
        require_mesh(self.mesh, "DeformationTask")
        if not isinstance(self.handles, Handles):
            raise TypeError(f"DeformationTask takes Handles, not a {type(self.handles).__name__}")
        index = self.handles.index
        self.mesh.require_handles(index, everywhere=False)
        if self.refuse_unconstrained and len(self.mesh.components_without(index)):
            self.mesh.require_handles(index, advice=HOW_TO_CONSTRAIN)
        object.__setattr__(self, "handles", self.handles.with_portions(self.mesh))
        for name in ("truth", "guess"):
            if (positions := getattr(self, name)) is not None:
                object.__setattr__(self, name, self.mesh.checked(positions, name))

    @property
    def is_at_rest(self) -> bool:
        """Whether no handle moves or turns."""
        handles = self.handles
        moved = np.linalg.norm(handles.target - self.mesh.V[handles.index], axis=1).max()
        return bool(moved <= UNMOVED * self.mesh.diagonal) and not handles.has_rotation.any()

    def at(self, handles: Handles, *, guess: np.ndarray | None = None) -> DeformationTask:
        """Return the task with handles and a guess that were checked for its mesh; it has no truth."""
        task = copy(self)
        for name, value in {"handles": handles, "guess": guess, "truth": None}.items():
            object.__setattr__(task, name, value)
        return task


@dataclass(frozen=True, eq=False, repr=False)
class TransferTask(Shown):
    """One pose transfer: put an edited shape into the pose of the shape that it was made from.

    With the unedited shape as `mesh`, the task is isometric reconstruction. A method must then read
    `posed` at its samples only; nothing enforces this rule.

    Parameters
    ----------
    name : str
    mesh : Mesh
        S, the edited shape at rest, to be deformed.
    rest : Mesh
        M, with the faces of S.
    posed : (n, 3) float64
        M', the pose of M.
    truth : (n, 3) float64, optional
        S', the true result, where it is known.
    meta : mapping
        Flat facts for the row of a table (subject, pose, edit, ...).

    Raises
    ------
    InputError
        When S, M, M' and the truth do not correspond, or a position is not finite.
    """

    name: str
    mesh: Mesh
    rest: Mesh
    posed: np.ndarray
    truth: np.ndarray | None = None
    meta: Mapping[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"<TransferTask {self.name!r}: {self.mesh.n} vertices>"

    def __post_init__(self) -> None:
        for mesh in (self.mesh, self.rest):
            require_mesh(mesh, "TransferTask")
        if not np.array_equal(self.mesh.F, self.rest.F):
            raise InputError("the edited shape has other faces than the rest shape; they must correspond")
        for name in ("posed", "truth"):
            if (positions := getattr(self, name)) is not None or name == "posed":
                object.__setattr__(self, name, self.mesh.checked(positions, f"{name} shape"))


@dataclass(frozen=True, eq=False, repr=False)
class DeformationResult(Shown):
    """Deformed vertices, and a record of the computation.

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
        Flat facts of other methods for the row (last residual, counts, ...), and arrays: a proxy method may
        give ``rotations`` (n, 3, 3).
    facts : Facts
        Of :func:`sshade.deform`; empty for other methods.
    task : DeformationTask or TransferTask, optional
        The task, with whose mesh and handles a notebook shows the result. None if a function such as
        :func:`sshade.deform` has not set it.

    Raises
    ------
    TypeError
        When the positions are not real numbers.
    FloatingPointError
        When a position is not finite: the method failed on this input.
    """

    vertices: np.ndarray
    iterations: float
    converged: bool | None
    seconds: Mapping[str, float] = field(default_factory=dict)
    extra: Mapping[str, Any] = field(default_factory=dict)
    facts: Facts = field(default_factory=Facts)
    task: DeformationTask | TransferTask | None = None

    def __repr__(self) -> str:
        ended = {None: "", True: ", converged", False: ", not converged"}[self.converged]
        return f"<DeformationResult: {len(self.vertices)} vertices, {self.iterations:.4g} iterations{ended}>"

    def __post_init__(self) -> None:
        V = np.asarray(self.vertices)
        if V.dtype.kind not in "fiu":
            raise TypeError(f"deformed vertices are of type {V.dtype}, not real numbers")
        object.__setattr__(self, "vertices", V)
        if not np.isfinite(V).all():
            count = int((~np.isfinite(V.reshape(len(V), -1)).all(axis=1)).sum())
            raise FloatingPointError(
                f"{count} deformed vertices are not finite; perhaps the method divides by zero, for "
                "example by the area of a triangle"
            )

    def of(self, task: DeformationTask | TransferTask) -> DeformationResult:
        """Return this result with its task; the arrays are the same."""
        result = copy(self)
        object.__setattr__(result, "task", task)
        return result


def joined(vertices: np.ndarray, results: Sequence[DeformationResult], of: Joint) -> DeformationResult:
    """Join the results of samplings or of pieces into one.

    The result has the mean number of iterations and summed seconds, converged if all have, and has facts by
    the rules of :class:`sshade.problem.facts.Facts`.

    Parameters
    ----------
    vertices : (n, 3) float64
    results : sequence of DeformationResult
    of : {"samplings", "pieces"}
    """
    converged = [result.converged for result in results]
    stages = dict.fromkeys(stage for result in results for stage in result.seconds)
    return DeformationResult(
        vertices,
        float(np.mean([result.iterations for result in results])),
        None if None in converged else all(converged),
        {stage: sum(result.seconds.get(stage, 0.0) for result in results) for stage in stages},
        facts=Facts.joined([result.facts for result in results], of),
    )


def result_of(task: DeformationTask | TransferTask, result: object) -> DeformationResult:
    """Check the result that a method returned for a task, and return it with the task.

    Raises
    ------
    TypeError
        When it is no :class:`DeformationResult`.
    ValueError
        When it has not one position for each vertex.
    """
    if not isinstance(result, DeformationResult):
        raise TypeError(f"the method returned {type(result).__name__}, not a DeformationResult")
    if np.shape(result.vertices) != task.mesh.V.shape:
        raise ValueError(
            f"the method returned vertices of shape {np.shape(result.vertices)} for {task.mesh.V.shape}"
        )
    return result.of(task)


class Method(Protocol):
    """A deformation method: a function of a task; its parameters are keyword-only with defaults."""

    def __call__(
        self, task: DeformationTask, *, seed: int, progress: Progress = silent
    ) -> DeformationResult: ...
