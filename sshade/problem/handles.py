"""Handles: vertices that are fixed or pulled, hard (exactly) or soft (approximately)."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import KW_ONLY, InitVar, dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from sshade.core.errors import InputError, counted
from sshade.mesh.mesh import Mesh, require_mesh
from sshade.problem.handle_checks import (
    NO_HANDLES,
    SAME_TARGET,
    checked_index,
    checked_rotation,
    checked_target,
    checked_weight,
    first_of_each,
    per_handle,
)
from sshade.problem.snapping import EXPLAINED, corrected_targets, merged_by_vertex, snap_to_vertices

#: Least area of a soft handle's vertex, as a fraction of the mean vertex area of the mesh.
LEAST_AREA = 1e-3


class Snapping(NamedTuple):
    """How handles that were given by position came to vertices.

    Attributes
    ----------
    distance : (k,) float64
        Distance from each stored position to its vertex.
    merged : int
        Number of handles dropped because another handle of their group has the same vertex.
    merge_distance : float
        Largest distance between the target of a merged handle and the target of its vertex.
    """

    distance: np.ndarray
    merged: int = 0
    merge_distance: float = 0.0


@dataclass(frozen=True, eq=False, repr=False)
class Handles:
    """Vertices with prescribed positions and, optionally, prescribed rotations.

    A handle of infinite weight is hard: with blended frames, as the methods ``fast`` and ``fine`` have, the
    deformation meets its target exactly. With other frames the proxy meets it, and the deformation about:
    ``DeformationResult.facts.hard_handle_error`` has the largest distance. A handle of finite weight w
    is soft: its group adds w times the mean of ``|p_i - target_i|^2`` to the elastic energy, where each
    vertex counts by its area. The elastic energy counts each edge once, with its cotangent weight, which has
    no unit. The effect of w therefore depends neither on the unit of length nor on the resolution nor on the
    size of the group. With w = 1 the handles hold a group about as strongly as the surface around it; with
    w = 100 the group yields by about a hundredth.

    Parameters
    ----------
    index : (k,) int
        Vertex ids. A repeated id with equal targets is kept once.
    target : (k, 3) float64
        Prescribed positions, in the mesh's unit of length.
    dynamic : (k,) bool, optional
        True where the handle moves, False where it is fixed; by default True everywhere.
    group : (k,) int, optional
        Landmark or handle region of each handle; by default 0 everywhere.
    weight : (k,) float64 or float, optional
        Above 0. Smaller weights let the surface deviate from the targets; inf, the default, is hard.
    rotation : (k, 3, 3) float64, optional
        Prescribed rotations of the surface at the handles; NaN, the default, leaves a rotation free. The
        local step of the solver uses a prescribed rotation in place of R_i. Positions already determine how a
        hard handle region turns; there, prescribed rotations affect the surface beside the border.
    extent : float, optional
        Length, by default the diagonal of the bounding box of all targets. Targets of one vertex are equal
        if they differ by at most :data:`sshade.problem.handle_checks.SAME_TARGET` times this length. Give the
        diagonal of the mesh, or more where merged copies of a vertex lie further apart.
    area_portion : (k,) float64, optional
        :attr:`portion`, which a task finds from the mesh.
    snap : Snapping, optional
        :attr:`snapping`, as :meth:`from_positions` finds it.

    Raises
    ------
    InputError
        On wrong shapes, no handles, negative ids, targets that are not finite, weights that are not
        positive, matrices that are not rotations, or one vertex with different targets, weights or rotations.
    """

    index: np.ndarray
    target: np.ndarray
    # None only as a parameter; arrays once the object is made.
    dynamic: np.ndarray = None  # type: ignore[assignment]
    group: np.ndarray = None  # type: ignore[assignment]
    weight: np.ndarray = None  # type: ignore[assignment]
    rotation: np.ndarray | None = None
    _: KW_ONLY
    extent: InitVar[float | None] = None
    area_portion: InitVar[np.ndarray | None] = None
    snap: InitVar[Snapping | None] = None

    def __post_init__(
        self, extent: float | None, area_portion: np.ndarray | None, snap: Snapping | None
    ) -> None:
        index = checked_index(self.index)
        target, k = checked_target(self.target, index), len(index)
        fields = {
            "index": index,
            "target": target,
            "dynamic": per_handle(self.dynamic, True, bool, k, "dynamic"),
            "group": per_handle(self.group, 0, np.int64, k, "group"),
            "weight": checked_weight(self.weight, k),
            "rotation": checked_rotation(self.rotation, k),
            "_portion": per_handle(area_portion, None, np.float64, k, "area_portion"),
        }
        first = first_of_each(fields, extent)
        snap = Snapping(np.zeros(k)) if snap is None else snap
        object.__setattr__(self, "_snapping", snap._replace(distance=snap.distance[first]))
        self._set({name: None if values is None else values[first] for name, values in fields.items()})

    def _set(self, fields: Mapping[str, np.ndarray | None]) -> None:
        for name, values in fields.items():
            if values is not None:
                values.setflags(write=False)
            object.__setattr__(self, name, values)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Make the arrays of a copy, or of handles from another process, read-only again."""
        self.__dict__.update(state)
        self._set({name: value for name, value in state.items() if isinstance(value, np.ndarray)})

    def __len__(self) -> int:
        return len(self.index)

    def __repr__(self) -> str:
        vertices = counted(len(self), "vertex", "vertices")
        return f"<Handles: {vertices}, {int(self.dynamic.sum())} of them moved>"

    @property
    def hard(self) -> np.ndarray:
        """(k,) bool: handles at whose targets the deformation ends exactly."""
        return np.isinf(self.weight)

    @property
    def portion(self) -> np.ndarray | None:
        """(k,) float64: portion of each soft handle in the area of its group; None before a task."""
        return vars(self)["_portion"]

    @property
    def snapping(self) -> Snapping:
        """How the handles came to their vertices; distances are 0 if they were given by vertex."""
        return vars(self)["_snapping"]

    @property
    def stiffness(self) -> np.ndarray:
        """(k,) float64: weight times portion, the factor of each squared distance; inf for hard handles."""
        if self.hard.all():
            return self.weight
        if self.portion is None:
            raise InputError("soft handles need their portions of area; make a task of them and the mesh")
        return np.where(self.hard, np.inf, self.weight * self.portion)

    @property
    def has_rotation(self) -> np.ndarray:
        """(k,) bool: handles with a prescribed rotation."""
        if self.rotation is None:
            return np.zeros(len(self), dtype=bool)
        return np.isfinite(self.rotation).all(axis=(1, 2))

    @property
    def prescribed_rotations(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Vertices (j,) with a prescribed rotation, and the rotations (j, 3, 3); None if there are none."""
        rows = self.has_rotation
        if self.rotation is None or not rows.any():
            return None
        return self.index[rows], self.rotation[rows]

    def with_portions(self, mesh: Mesh) -> Handles:
        """Return handles with the portion of each soft handle in the area of its group on `mesh`.

        Existing portions are kept.
        """
        soft = np.flatnonzero(~self.hard)
        if self.portion is not None or len(soft) == 0:
            return self
        area = mesh.vertex_areas[self.index[soft]]
        area = np.maximum(area, LEAST_AREA * mesh.area / mesh.n)
        _, group = np.unique(self.group[soft], return_inverse=True)
        portion = np.ones(len(self))
        portion[soft] = area / np.bincount(group, area)[group]
        return replace(self, area_portion=portion, snap=self.snapping)

    def at(self, target: np.ndarray, rotation: np.ndarray | None = None) -> Handles:
        """Return the same handles with other targets (k, 3) and rotations (k, 3, 3).

        Raises
        ------
        InputError
            On another shape, targets that are not finite, or matrices that are not rotations.
        """
        moved = copy(self)
        target = checked_target(np.array(target, dtype=np.float64), self.index)
        moved._set({"target": target, "rotation": checked_rotation(rotation, len(self))})
        return moved

    def require_same(self, other: Handles) -> None:
        """Raise InputError unless other handles have the same vertices, groups and weights."""
        for what, same in {
            "vertices": np.array_equal(self.index, other.index),
            "groups": np.array_equal(self.group, other.group),
            "weights": np.array_equal(self.weight, other.weight),
        }.items():
            if not same:
                raise InputError(
                    f"its handles have other {what} than the handles of the first pose; all poses of a "
                    f"sequence need the same {what}, in the same order"
                )

    def sampled(self, number: np.ndarray, index: np.ndarray, V: np.ndarray) -> Handles:
        """Return some of the handles as handles of a proxy.

        The portion of every soft handle left out goes to the nearest remaining soft handle of its group.

        Parameters
        ----------
        number : (s,) int
            Positions of the remaining handles, each once; at least one for each group with soft handles.
        index : (s,) int
            Their vertices on the proxy.
        V : (n, 3) float64
            Positions of the mesh at rest.
        """
        portion = self.portion
        if portion is not None:
            portion = portion[number] if len(number) == len(self) else self._gathered(portion, number, V)
        return Handles(
            index,
            self.target[number],
            self.dynamic[number],
            self.group[number],
            self.weight[number],
            None if self.rotation is None else self.rotation[number],
            area_portion=portion,
        )

    def _gathered(self, portion: np.ndarray, number: np.ndarray, V: np.ndarray) -> np.ndarray:
        """Return the portions (s,) of the remaining handles with those of the handles left out."""
        from scipy.spatial import cKDTree

        gathered, soft = portion[number], ~self.hard
        for group in np.unique(self.group[soft]):
            members = np.flatnonzero(soft & (self.group == group))
            kept = np.flatnonzero(soft[number] & (self.group[number] == group))
            _, nearest = cKDTree(V[self.index[number[kept]]]).query(V[self.index[members]])
            # Sums of stiffness, because handles of one group may differ in weight.
            stiffness = np.bincount(nearest, self.weight[members] * portion[members], minlength=len(kept))
            gathered[kept] = stiffness / self.weight[number[kept]]
        return gathered

    @classmethod
    def from_positions(
        cls,
        mesh: Mesh,
        source: np.ndarray,
        target: np.ndarray,
        *,
        dynamic: np.ndarray | bool = True,
        group: np.ndarray | None = None,
        weight: np.ndarray | float | None = None,
        rotation: np.ndarray | None = None,
        raw: bool = False,
        strict: bool = True,
    ) -> Handles:
        """Snap handles given by position to the nearest vertices of a mesh.

        Targets are corrected for the distance between position and vertex. A fixed handle stays at its
        vertex p_i. A dynamic handle goes to ``t_i + R (p_i - s_i)``, where s_i and t_i are its stored
        positions. R is its prescribed rotation; without one, R is the rotation that best maps the sources of
        its group to their targets (Kabsch). Handles of a group with the same vertex are merged: they get the
        mean of their targets, the largest of their weights, and the first rotation.

        Parameters
        ----------
        mesh : Mesh
            Any mesh.
        source, target : (k, 3) float64
            Positions at rest and prescribed positions, in the mesh's coordinates.
        dynamic : (k,) bool or bool
            False for fixed handles.
        group, weight, rotation
            As for :class:`Handles`.
        raw : bool
            Keep the stored targets without correction.
        strict : bool
            Refuse to merge targets that contradict each other: a target farther from their mean than
            :data:`sshade.problem.snapping.EXPLAINED` times the largest distance of the positions from the
            vertex.

        Raises
        ------
        InputError
            If counts differ, a position is not finite, a source is too far from the mesh
            (:data:`sshade.problem.snapping.FARTHEST_SNAP`), one vertex gets different targets from two
            groups, or handles that are merged contradict each other.
        """
        require_mesh(mesh, "Handles.from_positions")
        source, target = np.asarray(source, dtype=np.float64), np.asarray(target, dtype=np.float64)
        k = len(source)
        if k == 0:
            raise InputError(NO_HANDLES)
        if len(target) != k:
            has, targets = counted(k, "handle has", "handles have"), counted(len(target), "target", "targets")
            raise InputError(f"{has} {targets}; each needs one")
        if source.shape != (k, 3) or target.shape != (k, 3):
            raise InputError(
                f"handles need positions and targets of shape (k, 3), not {source.shape} and {target.shape}"
            )
        if not (np.isfinite(source).all() and np.isfinite(target).all()):
            raise InputError("a handle has a NaN or infinite position")
        moving = per_handle(
            np.full(k, dynamic) if np.ndim(dynamic) == 0 else dynamic, True, bool, k, "dynamic"
        )
        group = per_handle(group, 0, np.int64, k, "group")
        weight = checked_weight(weight, k)
        rotation = checked_rotation(rotation, k)

        distance, index = snap_to_vertices(mesh, source, group)
        moved = target
        if not raw:
            moved = corrected_targets(
                mesh, index, source, target, dynamic=moving, group=group, rotation=rotation
            )
        one = merged_by_vertex(index, group, moved)
        largest = one.largest(distance)
        if strict:
            limit = SAME_TARGET * mesh.diagonal + EXPLAINED * largest[one.number]
            one.require_agreement(limit)
        return cls(
            index=index[one.first],
            target=one.target,
            dynamic=one.largest(moving),
            group=group[one.first],
            weight=one.largest(weight),
            rotation=None if rotation is None else rotation[one.first],
            extent=mesh.diagonal,
            snap=Snapping(largest, k - len(one.first), float(one.distance.max())),
        )
