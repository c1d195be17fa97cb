# SPDX-License-Identifier: MIT OR GPL-3.0-or-later
"""Handles of vertex groups, their motions, and the shapes that follow; without Blender.

Positions are float32, as Blender stores them. Computations are in float64, and results are rounded once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.edit.dragging import bound_for_drag, step
from sshade.edit.groups import Motion
from sshade.files.open_shape import open_shape
from sshade.method.bound import Bound, Deformer
from sshade.problem.handles import Handles
from sshade.problem.options import resolve

#: Weight of a vertex in its vertex group from which on the vertex is a hard handle.
HARD = 0.999
#: Largest deviation of a motion from a rigid motion, relative to its scale. Blender's matrices are float32.
RIGID = 1e-4

STILL = Motion(np.eye(3), np.zeros(3))


class RigGroup(NamedTuple):
    """A vertex group that is a handle.

    Attributes
    ----------
    name : str
    weight : (n,) float32
        Weight of each vertex in the group, from 0 to 1. Vertices of weight 0 are no handles. A vertex of
        weight 1 is a hard handle. A vertex of a weight g below :data:`HARD` is soft, with the weight
        g / (1 - g) of :class:`sshade.Handles`: at g = 0.5 it is held about as strongly as the surface holds.
    moves : bool
        False if the group is fixed.
    """

    name: str
    weight: np.ndarray
    moves: bool


def rigid(matrix: np.ndarray) -> Motion | None:
    """Return a matrix (4, 4) as a rigid motion, None if it scales, shears or mirrors.

    The rotation is the nearest one to the matrix. A matrix that is the identity up to rounding gives exactly
    no motion.
    """
    matrix = np.asarray(matrix, dtype=np.float64)
    if not np.isfinite(matrix).all():
        return None
    if np.abs(matrix - np.eye(4)).max() <= 1e-6:
        return STILL
    U, scales, Vt = np.linalg.svd(matrix[:3, :3])
    R = U @ Vt
    if np.abs(scales - 1).max() > RIGID or np.linalg.det(R) < 0:
        return None
    # A translation must stay one, without rounding in the rotation.
    return Motion(np.eye(3) if np.abs(R - np.eye(3)).max() <= 1e-6 else R, matrix[:3, 3])


class Rig:
    """A mesh at rest and its handles.

    Parameters
    ----------
    V : (n, 3) float32
        Positions at rest.
    F : (m, 3) int
        Triangles.
    groups : sequence of RigGroup

    Attributes
    ----------
    V : (n, 3) float32
    mesh : Mesh
        The surface in the mesh that can be deformed.
    handles : Handles
        The handles at rest. ``group`` is the number of the vertex group.

    Raises
    ------
    InputError
        When the mesh has no surface, there are no handles or none that moves, a group has no vertex of the
        surface, or groups overlap.
    """

    def __init__(self, V: np.ndarray, F: np.ndarray, groups: Sequence[RigGroup]) -> None:
        if not groups:
            raise InputError("there are no groups; add vertex groups in the panel SShaDe")
        if not any(group.moves for group in groups):
            raise InputError("all groups are fixed; set one to Moved")
        if len(F) == 0:
            raise InputError("the mesh has no faces")
        self.V, self._shape = V, open_shape(V, F)
        self.mesh = self._shape.mesh
        self.groups = tuple(groups)
        members = [self._members(group) for group in groups]
        self._require_disjoint([vertices for vertices, _ in members])
        count = [len(vertices) for vertices, _ in members]
        index = np.concatenate([vertices for vertices, _ in members])
        self.handles = Handles(
            index,
            self.mesh.V[index],
            dynamic=np.repeat([group.moves for group in groups], count),
            group=np.repeat(np.arange(len(count)), count),
            weight=np.concatenate([weight for _, weight in members]),
            extent=self.mesh.diagonal,
        ).with_portions(self.mesh)

    def _members(self, group: RigGroup) -> tuple[np.ndarray, np.ndarray]:
        """Return the vertices (k,) of a group on the surface, and their weights as handles."""
        vertex = self._shape.surface.vertex
        own = np.flatnonzero((group.weight > 0) & (vertex >= 0))
        if len(own) == 0:
            raise InputError(f"vertex group {group.name!r} has no vertex of a face with a weight above 0")
        largest = np.zeros(self.mesh.n)
        np.maximum.at(largest, vertex[own], group.weight[own])  # copies along a seam are one vertex
        vertices = np.flatnonzero(largest)
        g = largest[vertices]
        with np.errstate(divide="ignore"):
            return vertices, np.where(g >= HARD, np.inf, g / (1 - g))

    def _require_disjoint(self, members: Sequence[np.ndarray]) -> None:
        owner = np.full(self.mesh.n, -1)
        for number, vertices in enumerate(members):
            shared = owner[vertices]
            if (shared >= 0).any():
                other = self.groups[shared.max()].name
                raise InputError(
                    f"groups {other!r} and {self.groups[number].name!r} share {(shared >= 0).sum()} of their "
                    "vertices; remove these from one of the groups"
                )
            owner[vertices] = number

    def moved(self, motions: Sequence[Motion]) -> Handles:
        """Return the handles after one motion for each group."""
        target = self.handles.target.copy()
        for number, motion in enumerate(motions):
            own = self.handles.group == number
            target[own] = motion(target[own])
        return self.handles.at(target)

    def centroid(self, number: int) -> np.ndarray:
        """Return the mean rest position (3,) of the vertices of a group."""
        return self.handles.target[self.handles.group == number].mean(axis=0)

    def deform(
        self,
        motions: Sequence[Motion],
        *,
        method: str = "fast",
        joints: float | None = None,
        progress: Progress = silent,
    ) -> tuple[np.ndarray, str]:
        """Return the converged positions (n, 3) float32 after one motion for each group, and their quality.

        Components without handles follow the nearest component rigidly, and vertices without a face stay.

        Raises
        ------
        InputError
            See :func:`sshade.deform`.
        FloatingPointError
            When a position is not finite.
        """
        task = self._shape.task("blender", self.moved(motions))
        bound = Bound.of_task(task, resolve(method, {"joints": joints}))
        V = bound.solve(task.handles, progress=progress).vertices
        return self.placed(V), str(bound.quality(V))

    def bound(self) -> Deformer:
        """Bind the mesh for :meth:`step`; raise InputError when it cannot be bound with these handles."""
        return bound_for_drag(self.mesh, self.handles, "fast")

    def step(self, deformer: Deformer, motions: Sequence[Motion]) -> np.ndarray:
        """Return the positions (n, 3) float32 after a few iterations towards the motions of the groups."""
        return self.placed(step(deformer, self.moved(motions)))

    def placed(self, moved: np.ndarray) -> np.ndarray:
        """Return all positions (n, 3) float32, with the surface at `moved` (k, 3)."""
        return self._shape.placed(moved).astype(np.float32)
