"""Handles: vertices that are to reach given positions, exactly or as far as their weight pulls."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import rigid_motion
from sshade.snapping import snap_to_vertices

#: Two targets of one vertex that differ by more than this (x diagonal) contradict each other.
SAME_TARGET = 1e-9

#: Least area of a soft handle's vertex, over the mean of the mesh's.
LEAST_PORTION = 1e-3

#: Largest entry of R R^T - 1 of a rotation R.
ROTATION = 1e-6

NO_HANDLES = "there are no handles; at least one vertex needs a prescribed position"


@dataclass(frozen=True, eq=False)
class Handles:
    """Vertices with prescribed positions, and rotations where those are known too.

    A soft handle, one with a finite weight, is no constraint but a pull. Beside the energy of a
    deformation, in which each edge ij counts once with ``w_ij |e'_ij - R_i e_ij|^2``, w_ij its cotangent
    weight, the soft handles of a group with weight w cost w times the mean of ``|p_i - target_i|^2``, in
    which each vertex counts by its area: :attr:`stiffness` times each square, in all. As the
    cotangents have no unit, and as it is a mean, w has the same meaning in
    any unit of length, at any resolution and for a landmark or a region: with 1 a group is held about as
    strongly as the surface around it holds it, with 100 it gives way by about a hundredth.

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
    weight : (k,) float64 or float, optional
        Above 0; inf, the default, is a hard handle.
    portion : (k,) float64, optional
        Of its group's mean, that of each soft handle; by default by area, in a task.
    rotation : (k, 3, 3) float64, optional
        How the surface turns at each handle; NaN, the default, where that is open. The local step of
        the solver takes it as R_i instead of fitting one; elsewhere rotations are fitted, so that a
        disc of such handles in a large sheet turns about half as far, and all that is held does not turn.
        In a region that is hard, positions say how it turns, and prescribed rotations how the surface
        beside its edge does.
    merged : int
        How many handles were dropped because another of their landmark took the same vertex.

    Raises
    ------
    InputError
        On wrong shapes, fewer targets than handles, non-finite targets, weights that are not positive,
        matrices that are no rotations, or contradictory targets or weights on one vertex.
    """

    index: np.ndarray
    target: np.ndarray
    # None only as a parameter: arrays once the object is made.
    dynamic: np.ndarray = None  # type: ignore[assignment]
    group: np.ndarray = None  # type: ignore[assignment]
    snap_distance: np.ndarray = None  # type: ignore[assignment]
    weight: np.ndarray = None  # type: ignore[assignment]
    portion: np.ndarray | None = None
    rotation: np.ndarray | None = None
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
        _require_finite(target, index)
        if index.min() < 0:
            raise InputError(f"handle id {index.min()} is negative")
        fields = {
            "index": index,
            "target": target,
            "dynamic": _per_handle(self.dynamic, True, bool, k, "dynamic"),
            "group": _per_handle(self.group, 0, np.int64, k, "group"),
            "snap_distance": _per_handle(self.snap_distance, 0.0, np.float64, k, "snap_distance"),
            "weight": _checked_weight(self.weight, k),
        }
        if self.portion is not None:
            fields["portion"] = _per_handle(self.portion, 0.0, np.float64, k, "portion")
        if self.rotation is not None:
            fields["rotation"] = _checked_rotation(self.rotation, k)
        first = _first_of_each(index, target, fields["weight"])
        for name, values in fields.items():
            values = np.array(values[first])
            values.setflags(write=False)
            object.__setattr__(self, name, values)

    def __len__(self) -> int:
        return len(self.index)

    @property
    def hard(self) -> np.ndarray:
        """(k,) bool: the handles that are constraints."""
        return np.isinf(self.weight)

    @property
    def stiffness(self) -> np.ndarray:
        """(k,) float64: weight times portion, inf of hard handles. No unit."""
        if self.hard.all():
            return self.weight
        if self.portion is None:
            raise InputError("soft handles have no shares yet; make a task of them and its mesh")
        return np.where(self.hard, np.inf, self.weight * self.portion)

    @property
    def has_rotation(self) -> np.ndarray:
        """(k,) bool: the handles whose rotations are prescribed."""
        if self.rotation is None:
            return np.zeros(len(self), dtype=bool)
        return np.isfinite(self.rotation).all(axis=(1, 2))

    @property
    def prescribed_rotations(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Handle vertices (j,) whose rotations are prescribed, and these (j, 3, 3); None without any."""
        if self.rotation is None:
            return None
        given = self.has_rotation
        return (self.index[given], self.rotation[given]) if given.any() else None

    def with_portions(self, mesh: Mesh) -> Handles:
        """With the portion that the soft handles of each group have by their areas, if there is none yet."""
        soft = np.flatnonzero(~self.hard)
        if self.portion is not None or len(soft) == 0:
            return self
        area = mesh.vertex_areas[self.index]
        area = np.maximum(area, LEAST_PORTION * mesh.area / mesh.n)
        _, group = np.unique(self.group[soft], return_inverse=True)
        group = group.ravel()
        portion = np.ones(len(self))
        portion[soft] = area[soft] / np.bincount(group, area[soft])[group]
        return replace(self, portion=portion)

    def at(self, target: np.ndarray, rotation: np.ndarray | None = None) -> Handles:
        """The same handles with other targets (k, 3) and rotations (k, 3, 3); nothing else is checked again.

        Raises
        ------
        InputError
            On another shape, targets that are not finite, or matrices that are no rotations.
        """
        k, target = len(self), np.array(target, dtype=np.float64)
        if target.shape != (k, 3):
            raise InputError(f"{k} handles need targets of shape ({k}, 3), not {target.shape}")
        _require_finite(target, self.index)
        rotation = None if rotation is None else _checked_rotation(rotation, k)
        other = copy(self)
        for name, values in (("target", target), ("rotation", rotation)):
            if values is not None:
                values.setflags(write=False)
            object.__setattr__(other, name, values)
        return other

    def sampled(self, number: np.ndarray, index: np.ndarray, V: np.ndarray) -> Handles:
        """Some handles as those of a proxy; what the others pull, the nearest of these of their group do.

        Parameters
        ----------
        number : (s,) int
            Those, each once, and of each group with soft handles one of these at least.
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
            dynamic=self.dynamic[number],
            group=self.group[number],
            weight=self.weight[number],
            portion=portion,
            rotation=None if self.rotation is None else self.rotation[number],
        )

    def require_hard(self, method: str) -> None:
        """Raise InputError where a handle is soft or has a rotation, which `method` does not know."""
        if not self.hard.all():
            raise InputError(f"{method} takes no soft handles: leave their weights out, or take sshade_fast")
        if self.prescribed_rotations:
            raise InputError(f"{method} takes no rotations of handles: leave them out, or take sshade_fast")

    def _gathered(self, portion: np.ndarray, number: np.ndarray, V: np.ndarray) -> np.ndarray:
        """(s,) shares of some handles with those of the soft ones of their group that are nearest to each."""
        from scipy.spatial import cKDTree

        gathered, soft = portion[number], ~self.hard
        for group in np.unique(self.group[soft]):
            own = np.flatnonzero(soft & (self.group == group))
            ours = np.flatnonzero(~self.hard[number] & (self.group[number] == group))
            _, nearest = cKDTree(V[self.index[number[ours]]]).query(V[self.index[own]])
            # In units of stiffness: handles of one group may differ in weight.
            pull = np.bincount(nearest, self.weight[own] * portion[own], minlength=len(ours))
            gathered[ours] = pull / self.weight[number[ours]]
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
    ) -> Handles:
        """Snap handles given by position to the nearest vertices of a mesh.

        The stored positions need not be vertices of `mesh`, so a target is
        corrected for the offset: a static handle stays where its vertex is; a
        dynamic one goes to ``t_i + R (p_i - s_i)``, with s_i and t_i the stored
        positions, p_i the vertex, and R the rotation that is prescribed for it, or else
        the one that best carries the sources of its group to their targets (Kabsch). Handles of a
        group that portion a vertex are merged: the mean of their targets, the largest of their weights,
        the rotation of the first.

        Parameters
        ----------
        mesh : Mesh
        source, target : (k, 3) float64
            Positions at rest and prescribed, in the mesh's coordinates.
        dynamic : (k,) bool or bool
        group : (k,) int, optional
        weight : (k,) float64 or float, optional
        rotation : (k, 3, 3) float64, optional
        raw : bool
            Keep the stored targets as they are.

        Raises
        ------
        InputError
            When counts differ, a position is not finite or farther than
            :data:`sshade.snapping.FARTHEST_SNAP` allows from the mesh's vertices, or one vertex gets
            different targets from two groups.
        """
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
        weight = _checked_weight(weight, k)

        distance, index = snap_to_vertices(mesh, source, group)
        moved = target.copy()
        if not raw:
            moved[~dynamic] = mesh.V[index[~dynamic]]
            turned = np.zeros(k, dtype=bool)
            if rotation is not None:
                rotation = _checked_rotation(rotation, k)
                turned = dynamic & np.isfinite(rotation).all(axis=(1, 2))
                offset = mesh.V[index[turned]] - source[turned]
                moved[turned] += np.einsum("iab,ib->ia", rotation[turned], offset)
            for g in np.unique(group[dynamic & ~turned]):
                own = dynamic & ~turned & (group == g)
                R, _ = rigid_motion(source[own], target[own])
                moved[own] += (mesh.V[index[own]] - source[own]) @ R.T

        # One row per (group, vertex); the constructor sees to equal vertices of different groups.
        rows = np.stack([group, index], axis=1)
        pairs, first, inverse, count = np.unique(
            rows, axis=0, return_index=True, return_inverse=True, return_counts=True
        )
        inverse = inverse.ravel()
        mean = np.stack([np.bincount(inverse, moved[:, c]) for c in range(3)], axis=1) / count[:, None]
        farthest = np.zeros(len(pairs))
        np.maximum.at(farthest, inverse, distance)
        heaviest = np.zeros(len(pairs))
        np.maximum.at(heaviest, inverse, weight)
        any_dynamic = np.zeros(len(pairs), dtype=bool)
        np.logical_or.at(any_dynamic, inverse, dynamic)
        return cls(
            index=pairs[:, 1],
            target=mean,
            dynamic=any_dynamic,
            group=pairs[:, 0],
            snap_distance=farthest,
            weight=heaviest,
            rotation=None if rotation is None else _checked_rotation(rotation, k)[first],
            merged=k - len(pairs),
        )


def _require_finite(target: np.ndarray, index: np.ndarray) -> None:
    if not np.isfinite(target).all():
        bad = int(np.flatnonzero(~np.isfinite(target).all(axis=1))[0])
        raise InputError(f"the target of handle {bad} (vertex {index[bad]}) is NaN or infinite")


def _per_handle(values: Any, default: Any, dtype: Any, k: int, name: str) -> np.ndarray:
    if values is None:
        return np.full(k, default, dtype=dtype)
    values = np.asarray(values, dtype=dtype)
    if values.shape != (k,):
        raise InputError(f"{k} handles need `{name}` of shape ({k},), not {values.shape}")
    return values


def _checked_weight(weight: Any, k: int) -> np.ndarray:
    weight = weight if weight is None or np.ndim(weight) else np.full(k, weight, dtype=np.float64)
    weight = _per_handle(weight, np.inf, np.float64, k, "weight")
    if not (weight > 0).all():
        bad = weight[~(weight > 0)][0]
        raise InputError(f"the weight of a handle goes from above 0 to inf (hard); {bad} does not")
    return weight


def _checked_rotation(rotation: Any, k: int) -> np.ndarray:
    R = np.array(rotation, dtype=np.float64)
    if R.shape != (k, 3, 3):
        raise InputError(f"{k} handles need rotations of shape ({k}, 3, 3), not {R.shape}")
    given = ~np.isnan(R).all(axis=(1, 2))
    require_rotations(R[given])
    return R


def require_rotations(R: np.ndarray) -> None:
    """Raise InputError unless matrices (j, 3, 3) are orthonormal, to :data:`ROTATION`, and right-handed."""
    off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2), initial=0)
    wrong = ~((off <= ROTATION) & (np.linalg.det(np.nan_to_num(R)) > 0))
    if wrong.any():
        raise InputError(
            f"matrix {int(np.argmax(wrong))} is no rotation: its rows must be orthonormal and right-handed"
        )


def _first_of_each(index: np.ndarray, target: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Positions of the first occurrence of every id, in input order; targets and weights must agree."""
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
        if (weight != weight[first[inverse.ravel()]]).any():
            bad = int(np.argmax(weight != weight[first[inverse.ravel()]]))
            raise InputError(f"vertex {index[bad]} has two weights; give each handle vertex one")
    return np.sort(first)
