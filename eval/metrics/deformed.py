"""Metrics, and their input: a task, its deformed vertices, and quantities that several metrics share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal
from weakref import WeakKeyDictionary

import numpy as np

from eval.metrics.shape import MeasuredShape, ShapeTopology
from sshade.mesh.mesh import Mesh
from sshade.problem.task import DeformationTask, Handles, TransferTask

Task = DeformationTask | TransferTask

#: Rest shape of each mesh in use, shared by all runs of a task.
_RESTS: WeakKeyDictionary[Mesh, MeasuredShape] = WeakKeyDictionary()


class Deformed:
    """A task and the deformed vertices from a method.

    M is the rest mesh, and M' the deformed mesh with the same connectivity. In a pose transfer: S and S'.

    Parameters
    ----------
    task : DeformationTask or TransferTask
    vertices : (n, 3) float
        M', in the numbering of the task's mesh.

    Attributes
    ----------
    task : DeformationTask or TransferTask
    mesh : Mesh
        M.
    rest, shape : MeasuredShape
        The geometry of M and of M'.

    Raises
    ------
    InputError
        On vertices that :meth:`sshade.mesh.mesh.Mesh.checked` refuses.
    """

    def __init__(self, task: Task, vertices: np.ndarray) -> None:
        self.task, self.mesh = task, task.mesh
        if self.mesh not in _RESTS:
            _RESTS[self.mesh] = MeasuredShape(ShapeTopology(self.mesh.F, self.mesh.n), self.mesh.V)
        self.rest = _RESTS[self.mesh]
        self.shape = MeasuredShape(self.rest.topology, self.mesh.checked(vertices, "deformed shape"))

    @cached_property
    def truth(self) -> MeasuredShape:
        """The geometry of the ground truth."""
        assert self.task.truth is not None, "only metrics that need a truth ask for it"
        return MeasuredShape(self.rest.topology, self.task.truth)

    @property
    def handles(self) -> Handles:
        """The handles of the task."""
        assert isinstance(self.task, DeformationTask), "only metrics that need handles ask for them"
        return self.task.handles

    @cached_property
    def flipped(self) -> np.ndarray:
        """(m,) bool: faces that oppose their neighbours in M' but not in M."""
        return _new(self.shape.opposed, self.rest, "opposed")

    @cached_property
    def intersecting(self) -> np.ndarray:
        """(m,) bool: faces that intersect other faces in M' but not in M."""
        return _new(self.shape.intersecting, self.rest, "intersecting")

    @cached_property
    def dihedral_changes(self) -> np.ndarray:
        """(d,) absolute change of the dihedral angle at each dihedral edge, in degrees."""
        change = self.shape.dihedral_angles - self.rest.dihedral_angles
        return np.degrees(np.abs((change + np.pi) % (2 * np.pi) - np.pi))

    @cached_property
    def singular_values(self) -> tuple[np.ndarray, np.ndarray]:
        """(m,) singular values s1 >= s2 of the map of each face of M; NaN for rest faces without area.

        In the first fundamental form of M' in the basis of M's edges, the trace is ``s1^2 + s2^2`` and the
        determinant ``(s1 s2)^2``. s2 is a quotient, because a difference would lose its digits.
        """
        a, b, c, area = self.rest.first_form
        A, B, C, deformed_area = self.shape.first_form
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            trace = (c * A - 2 * b * B + a * C) / area**2
            product = deformed_area / area
            # (s1 + s2)^2 and (s1 - s2)^2; rounding could make them negative.
            total = np.sqrt(np.maximum(trace + 2 * product, 0))
            difference = np.sqrt(np.maximum(trace - 2 * product, 0))
            s1 = 0.5 * (total + difference)
            s2 = np.where(s1 > 0, product / s1, 0.0)
        flat = area == 0
        s1[flat] = s2[flat] = np.nan
        return s1, s2

    @cached_property
    def dirichlet(self) -> np.ndarray:
        """(m,) D of each face of M; NaN without an area at rest, infinite for faces that lose their area."""
        s1, s2 = self.singular_values
        with np.errstate(divide="ignore"):
            # (s - 1/s)^2 = s^2 + 1/s^2 - 2 keeps its digits near a rigid motion.
            return 0.5 * ((s1 - 1 / s1) ** 2 + (s2 - 1 / s2) ** 2)

    @cached_property
    def surface_distances(self) -> tuple[np.ndarray, np.ndarray]:
        """(n,) squared distances from M' to the ground truth, and from the ground truth to M'.

        Distances go from vertices to surfaces. :mod:`eval.metrics.deformation` describes the scaling.
        """
        import igl

        F = np.array(self.mesh.F)  # igl needs a writable array
        centre = self.truth.V.mean(axis=0)
        true, found = self.truth.V - centre, self.shape.V - centre
        scale = np.linalg.norm(true, axis=1).max()
        true, found = true / scale, found / scale
        there = igl.point_mesh_squared_distance(found, true, F)[0]
        return there, igl.point_mesh_squared_distance(true, found, F)[0]


def _new(now: np.ndarray, rest: MeasuredShape, name: str) -> np.ndarray:
    """Return the faces that are marked now but not at rest; the rest shape is checked only if necessary."""
    return now & ~getattr(rest, name) if now.any() else now


Function = Callable[[Deformed], float]
Needs = Literal["handles", "truth", "posed"]


@dataclass(frozen=True)
class Metric:
    """A number that describes a deformation.

    Parameters
    ----------
    name : str
        The column in a row is ``metric.<name>``.
    unit : str
        ``%``, ``deg``, ``count``, or ``-`` for none.
    equation : str
        Definition in one line, for the legend of a table.
    function : callable
        ``Deformed -> float``, NaN if not available.
    needs : tuple of {"handles", "truth", "posed"}
        Attributes that a task must have. Rows of other tasks lack the column.
    """

    name: str
    unit: str
    equation: str
    function: Function
    needs: tuple[Needs, ...] = ()


#: All metrics by name, in the order of rows and legends.
METRICS: dict[str, Metric] = {}


def metric(unit: str, equation: str, *needs: Needs) -> Callable[[Function], Function]:
    """Register a function as a metric under its name; :class:`Metric` describes the arguments."""

    def register(function: Function) -> Function:
        METRICS[function.__name__] = Metric(function.__name__, unit, equation, function, needs)
        return function

    return register


def measure(task: Task, vertices: np.ndarray) -> dict[str, float | None]:
    """Compute all metrics that apply to a task; None if a value is not available, or infinite.

    Parameters
    ----------
    task : DeformationTask or TransferTask
    vertices : (n, 3) float
        M', in the numbering of the task's mesh.
    """
    deformed = Deformed(task, vertices)
    values = {
        name: float(metric.function(deformed))
        for name, metric in METRICS.items()
        if all(getattr(task, fact, None) is not None for fact in metric.needs)
    }
    return {name: value if np.isfinite(value) else None for name, value in values.items()}
