"""What goes into a deformation method and what comes out of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import rigid_motion

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

#: Two targets of one vertex that differ by more than this (x diagonal) contradict each other.
SAME_TARGET = 1e-9

#: Farthest that a position may be from its handle vertex (x diagonal), or a mean edge where that is longer:
#: beyond, it is not one of this mesh.
FARTHEST_SNAP = 0.05

#: Units of length over others that files are written in: millimetres, centimetres, inches, feet.
UNITS = (1000.0, 100.0, 1000.0 / 25.4, 1.0 / 0.3048, 25.4, 12.0, 10.0)

NO_HANDLES = "there are no handles; at least one vertex needs a prescribed position"


class Progress(Protocol):
    """Receives the advance of a long computation: stage, steps done, steps in all, a short note."""

    def __call__(self, stage: str, done: int, total: int, note: str = "") -> None: ...


def silent(stage: str, done: int, total: int, note: str = "") -> None:
    """Show nothing: the default progress callback."""


@dataclass(frozen=True, eq=False)
class Handles:
    """Vertices with prescribed positions.

    Parameters
    ----------
    index : (k,) int
        Vertex ids, each at most once after construction. A repeated id with
        equal targets is kept once; with different ones it is an error.
    target : (k, 3) float64
        Prescribed positions, in the mesh's unit of length.
    dynamic : (k,) bool, optional
        True where the handle moves; by default everywhere.
    group : (k,) int, optional
        Which landmark each handle belongs to; by default all to one.
    snap_distance : (k,) float64, optional
        Distance from each stored position to its vertex, set by :meth:`from_positions`.
    merged : int
        How many handles were dropped because another of their landmark took the same vertex.

    Raises
    ------
    InputError
        On wrong shapes, fewer targets than handles, non-finite targets, or
        contradictory targets on one vertex.
    """

    index: np.ndarray
    target: np.ndarray
    # None only as a parameter: arrays once the object is made.
    dynamic: np.ndarray = None  # type: ignore[assignment]
    group: np.ndarray = None  # type: ignore[assignment]
    snap_distance: np.ndarray = None  # type: ignore[assignment]
    merged: int = 0

    def __post_init__(self) -> None:
        index = np.asarray(self.index)
        if index.ndim != 1 or (index.size and not np.issubdtype(index.dtype, np.integer)):
            raise InputError(
                f"handle ids must be a list of integers, not {index.dtype} of shape {index.shape}"
            )
        index = index.astype(np.int64)
        k = len(index)
        if k == 0:
            raise InputError(NO_HANDLES)
        target = np.asarray(self.target, dtype=np.float64)
        if target.shape != (k, 3):
            raise InputError(f"{k} handles need targets of shape ({k}, 3), not {target.shape}")
        if not np.isfinite(target).all():
            bad = int(np.flatnonzero(~np.isfinite(target).all(axis=1))[0])
            raise InputError(f"the target of handle {bad} (vertex {index[bad]}) is NaN or infinite")
        if index.min() < 0:
            raise InputError(f"handle id {index.min()} is negative")
        fields = {
            "index": index,
            "target": target,
            "dynamic": _per_handle(self.dynamic, True, bool, k, "dynamic"),
            "group": _per_handle(self.group, 0, np.int64, k, "group"),
            "snap_distance": _per_handle(self.snap_distance, 0.0, np.float64, k, "snap_distance"),
        }
        first = _first_of_each(index, target)
        for name, values in fields.items():
            values = np.array(values[first])
            values.setflags(write=False)
            object.__setattr__(self, name, values)

    def __len__(self) -> int:
        return len(self.index)

    @classmethod
    def from_positions(
        cls,
        mesh: Mesh,
        source: np.ndarray,
        target: np.ndarray,
        *,
        dynamic: np.ndarray | bool = True,
        group: np.ndarray | None = None,
        raw: bool = False,
    ) -> Handles:
        """Snap handles given by position to the nearest vertices of a mesh.

        The stored positions need not be vertices of `mesh`, so a target is
        corrected for the offset: a static handle stays where its vertex is; a
        dynamic one goes to ``t_i + R (p_i - s_i)``, with s_i and t_i the stored
        positions, p_i the vertex, and R the rotation that best carries the
        sources of its group to their targets (Kabsch). Handles of a group that
        share a vertex are merged: the mean of their targets.

        Parameters
        ----------
        mesh : Mesh
        source, target : (k, 3) float64
            Positions at rest and prescribed, in the mesh's coordinates.
        dynamic : (k,) bool or bool
        group : (k,) int, optional
        raw : bool
            Keep the stored targets as they are.

        Raises
        ------
        InputError
            When counts differ, a position is not finite or farther than
            :data:`FARTHEST_SNAP` allows from the mesh's vertices, or one vertex gets
            different targets from two groups.
        """
        from scipy.spatial import cKDTree

        source = np.asarray(source, dtype=np.float64).reshape(-1, 3)
        target = np.asarray(target, dtype=np.float64).reshape(-1, 3)
        k = len(source)
        if len(target) != k:
            raise InputError(f"{k} handles have {len(target)} targets; each needs one")
        if k == 0:
            raise InputError(NO_HANDLES)
        if not (np.isfinite(source).all() and np.isfinite(target).all()):
            raise InputError("a handle has a NaN or infinite position")
        dynamic = np.broadcast_to(np.asarray(dynamic, dtype=bool), (k,))
        group = _per_handle(group, 0, np.int64, k, "group")

        tree = cKDTree(mesh.V)
        distance, index = tree.query(source)
        if distance.max() > FARTHEST_SNAP * mesh.diagonal:
            _refuse_far(source, distance, group, mesh, tree)
        moved = target.copy()
        if not raw:
            moved[~dynamic] = mesh.V[index[~dynamic]]
            for g in np.unique(group[dynamic]):
                own = dynamic & (group == g)
                R, _ = rigid_motion(source[own], target[own])
                moved[own] += (mesh.V[index[own]] - source[own]) @ R.T

        # One row per (group, vertex); the constructor sees to equal vertices of different groups.
        pairs, inverse, count = np.unique(
            np.stack([group, index], axis=1), axis=0, return_inverse=True, return_counts=True
        )
        inverse = inverse.ravel()
        mean = np.stack([np.bincount(inverse, moved[:, c]) for c in range(3)], axis=1) / count[:, None]
        farthest = np.zeros(len(pairs))
        np.maximum.at(farthest, inverse, distance)
        any_dynamic = np.zeros(len(pairs), dtype=bool)
        np.logical_or.at(any_dynamic, inverse, dynamic)
        return cls(
            index=pairs[:, 1],
            target=mean,
            dynamic=any_dynamic,
            group=pairs[:, 0],
            snap_distance=farthest,
            merged=k - len(pairs),
        )


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


def _refuse_far(
    source: np.ndarray, distance: np.ndarray, group: np.ndarray, mesh: Mesh, tree: cKDTree
) -> None:
    """Raise InputError where handles are farther than FARTHEST_SNAP allows: which, and why they may be."""
    limit = max(FARTHEST_SNAP * mesh.diagonal, mesh.mean_edge)
    worst = int(np.argmax(distance))
    if distance[worst] <= limit:
        return
    number = int((group[:worst] == group[worst]).sum())
    many, factors = int((distance > limit).sum()), [*UNITS, *(1.0 / unit for unit in UNITS)]
    wide = float(np.linalg.norm(np.ptp(source, axis=0)))
    # A box that shrinks to a point is on the mesh wherever that passes by the origin.
    factors = [factor for factor in factors if wide * factor > limit]
    off = [float(tree.query(source * factor)[0].max()) for factor in factors]
    if factors and min(off) <= limit:
        cause = f"times {factors[int(np.argmin(off))]:.6g} they would be on it, in another unit of length"
    elif 2 * many > len(source):
        boxes = f"their box has a diagonal of {wide:.3g}, that of the mesh {mesh.diagonal:.3g}"
        cause = f"{boxes}; another frame, or an offset"
    else:
        cause = "mend or remove these, the others are near it"
    raise InputError(
        f"handle {number} of group {group[worst]} is {distance[worst]:.3g} from the nearest vertex, "
        f"{distance[worst] / mesh.diagonal:.3g} times the mesh's diagonal; {many} of {len(source)} handles "
        f"given by position are farther than {limit / mesh.diagonal:.2g} times it: {cause}"
    )


def _per_handle(values: Any, default: Any, dtype: Any, k: int, name: str) -> np.ndarray:
    if values is None:
        return np.full(k, default, dtype=dtype)
    values = np.asarray(values, dtype=dtype)
    if values.shape != (k,):
        raise InputError(f"{k} handles need `{name}` of shape ({k},), not {values.shape}")
    return values


def _first_of_each(index: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Positions of the first occurrence of every id, in input order; targets must agree."""
    _, first, inverse = np.unique(index, return_index=True, return_inverse=True)
    if len(first) < len(index):
        scale = np.linalg.norm(np.ptp(target, axis=0))
        gap = np.linalg.norm(target - target[first[inverse.ravel()]], axis=1)
        if (gap > SAME_TARGET * scale).any():
            bad = int(np.argmax(gap))
            raise InputError(
                f"vertex {index[bad]} has contradictory targets, {gap[bad]:.3g} apart; "
                "give each handle vertex one target"
            )
    return np.sort(first)
