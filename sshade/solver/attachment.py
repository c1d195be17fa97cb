"""Attachment: handle groups pull the surface around them along with their own rigid motion.

A user who drags the tip of a nose means the head. An elastic surface does not know that: it stretches
around the few handle points, and the head tips over. A rigid motion (R, t) is therefore fitted to each
group of handles, and the surface near the group is pulled softly towards that motion, with the energy

    weight sum_i (a_i / r^2) exp(-(d_i / r)^2) |p_i - (R v_i + t)|^2

beside ``sum_ij w_ij |e'_ij - R_i e_ij|^2``. The area of vertex i is a_i, d_i is its distance from the group
plus the radius of the group, and r is :data:`RADIUS` x the square root of the mesh's area. The energy depends
neither on the unit of length nor on the resolution. Larger groups attach less: a handle region as large as a
hand attaches almost as much as a few points do, and a region as large as a limb attaches nothing.

The attached vertices and their largest stiffness depend on the rest shape alone; the targets of the
handles decide where the vertices are pulled. Targets that no rigid motion reaches leave (R, t) uncertain,
for example halfway along straight lines between two poses. The pull then fades continuously to nothing,
so that the surface never jumps while handles are dragged.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sshade.mesh.adjacency import VertexGraph, vertex_graph
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import SPREAD
from sshade.problem.handles import Handles
from sshade.proxy.fronts import Fronts

#: r, as a fraction of the square root of the mesh's area. On a body this is the radius of head and neck.
RADIUS = 0.22
#: Largest gap between neighbouring handles of one rigid group, along the mesh, as a fraction of r.
LINK = 0.25
#: Largest distance d_i of an attached vertex, as a multiple of r.
REACH = 2.0
#: Deviations from a rigid motion, relative to the group's size, at which the pull begins to fade and ends.
RIGID, LOOSE = 0.2, 0.4


class Attachment:
    """Vertices attached to the rigid motions of handle groups.

    Handles of one landmark group that lie near each other form one rigid group. A group attaches nothing if
    its handles determine no rotation: they lie in a line, or are fewer than three, and no rotation is
    prescribed. Soft handles of weight w attach w / (1 + w) times as strongly as hard ones.

    Parameters
    ----------
    mesh : Mesh
        Rest shape.
    handles : Handles
        Only the vertices, groups and weights matter, and which handles have a prescribed rotation.
    weight : float
        Strength of the pull, without unit. Larger values keep the surface near a group more rigid; 0
        attaches nothing.

    Attributes
    ----------
    vertex : (p,) int64
        The handle vertices in their order, followed by the attached vertices.
    stiffness : (p,) float64
        Stiffness at a pull fraction of 1; inf for hard handles. See :attr:`sshade.Handles.stiffness`.
    """

    def __init__(self, mesh: Mesh, handles: Handles, weight: float) -> None:
        pull, group_of = np.zeros(mesh.n), np.zeros(mesh.n, dtype=np.int64)
        self._groups: _Groups | None = None
        if weight > 0:
            r = RADIUS * np.sqrt(mesh.area)
            graph = vertex_graph(mesh)
            fronts = Fronts(graph, handles.index)
            number = _linked(graph, fronts, handles.group, LINK * r)
            groups = _Groups.at_rest(number, mesh.V[handles.index], handles.has_rotation)
            self._groups = groups
            firmness = np.where(np.isinf(handles.weight), 1.0, 1 - 1 / (1 + handles.weight))
            strength = np.bincount(number, firmness) / np.bincount(number) * weight
            nearest = number[fronts.cell]
            distance = fronts.distance + groups.radius[nearest]
            near = np.flatnonzero(distance < REACH * r)
            decay = np.exp(-((distance[near] / r) ** 2))
            pull[near] = strength[nearest[near]] / r**2 * decay * mesh.vertex_areas[near]
            group_of[near] = nearest[near]
        pull[handles.index] = 0.0
        near = np.flatnonzero(pull)
        near = near[np.argsort(group_of[near], kind="stable")]
        centre = np.zeros((0, 3)) if self._groups is None else self._groups.centre
        self._group_of = group_of[near]
        self._arm = mesh.V[near] - centre[self._group_of]
        # Group g attaches the vertices from self._start[g] to self._start[g + 1].
        self._start = np.searchsorted(self._group_of, np.arange(len(centre) + 1))
        self.vertex = np.concatenate([handles.index, near])
        self.stiffness = np.concatenate([handles.stiffness, pull[near]])

    def pulls(self, target: np.ndarray, rotation: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Compute where the vertices are pulled for given targets and rotations of the handles.

        Fractions vary from solve to solve, and one factorisation serves all targets.

        Parameters
        ----------
        target : (k, 3) float64
        rotation : (k, 3, 3) float64, optional
            See :class:`sshade.Handles`.

        Returns
        -------
        target : (p, 3) float64
        fraction : (p,) float64
            Fraction of the stiffness, in [0, 1].
        """
        fraction, k = np.ones(len(target) + len(self._arm)), len(target)
        if self._groups is not None:
            R, centre, certainty = self._groups.motions(target, rotation)
            goal = np.empty_like(self._arm)
            for g, (first, end) in enumerate(pairwise(self._start)):
                goal[first:end] = np.einsum("ij,kj->ki", R[g], self._arm[first:end]) + centre[g]
            target, fraction[k:] = np.concatenate([target, goal]), certainty[self._group_of]
        return target, fraction


class _Groups(NamedTuple):
    """Groups of handles that move rigidly together.

    Attributes
    ----------
    member : (k,) int
        Handles, group by group.
    start : (g,) int
        Where each group begins.
    number : (k,) int
        Group of each of these handles.
    arm : (k, 3) float64
        Their rest positions, relative to the centre of the group.
    centre : (g, 3) float64
        Mean rest positions.
    curvature : (g,) float64
        Growth of the sum of squared distances with a turn about the softest axis; 0 if the points leave the
        rotation undetermined.
    radius : (g,) float64
        Largest distance from the centre; infinite for groups that attach nothing.
    """

    member: np.ndarray
    start: np.ndarray
    number: np.ndarray
    arm: np.ndarray
    centre: np.ndarray
    curvature: np.ndarray
    radius: np.ndarray

    @classmethod
    def at_rest(cls, number: np.ndarray, P: np.ndarray, has_rotation: np.ndarray) -> _Groups:
        """Group handles at rest positions P (k, 3) by their `number` (k,)."""
        member = np.argsort(number, kind="stable")
        number, P = number[member], P[member]
        start, size = np.searchsorted(number, np.arange(number[-1] + 1)), np.bincount(number)
        centre = np.add.reduceat(P, start) / size[:, None]
        arm = P - centre[number]
        moments = np.linalg.eigvalsh(np.add.reduceat(arm[:, :, None] * arm[:, None], start))
        determined = (size >= 3) & (moments[:, 1] > SPREAD**2 * moments[:, 2])
        curvature = np.where(determined, moments[:, 0] + moments[:, 1], 0.0)
        attaches = determined | np.logical_or.reduceat(has_rotation[member], start)
        radius = np.maximum.reduceat(np.linalg.norm(arm, axis=1), start)
        return cls(member, start, number, arm, centre, curvature, np.where(attaches, radius, np.inf))

    def motions(
        self, target: np.ndarray, rotation: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Fit a rigid motion to the targets of each group.

        The rotation is Kabsch's. Two measures limit its certainty: the distance of the targets from the
        rotated group, and how much less than at rest the sum of squares grows with a turn away from R. Both
        are 1 - c for targets that are the rotated group scaled by c. A prescribed rotation is certain.

        Returns
        -------
        R : (g, 3, 3) float64
        centre : (g, 3) float64
            Where the centres of the groups move.
        certainty : (g,) float64
            From 0 to 1.
        """
        first, determined = self.start, self.curvature > 0
        Q = target[self.member]
        centre = np.add.reduceat(Q, first) / np.bincount(self.number)[:, None]
        Q -= centre[self.number]
        U, s, Vt = np.linalg.svd(np.add.reduceat(Q[:, :, None] * self.arm[:, None], first))
        sign = np.where(np.linalg.det(U @ Vt) > 0, 1.0, -1.0)
        U[:, :, 2] *= sign[:, None]
        R = np.where(determined[:, None, None], U @ Vt, np.eye(3))
        turned = np.einsum("hij,hj->hi", R[self.number], self.arm)
        square = np.where(determined, np.add.reduceat((self.arm**2).sum(axis=1), first), 1.0)
        misfit = np.sqrt(np.add.reduceat(((turned - Q) ** 2).sum(axis=1), first) / square)
        off = np.maximum(misfit, 1.0 - (s[:, 1] + sign * s[:, 2]) / np.where(determined, self.curvature, 1.0))
        certainty = np.where(determined, np.clip((LOOSE - off) / (LOOSE - RIGID), 0.0, 1.0), 0.0)
        if rotation is not None:
            prescribed = np.flatnonzero(np.isfinite(rotation[self.member]).all(axis=(1, 2)))[::-1]
            group = self.number[prescribed]  # of several handles, the first one decides
            R[group], certainty[group] = rotation[self.member[prescribed]], 1.0
        return R, centre, certainty


def _linked(graph: VertexGraph, fronts: Fronts, group: np.ndarray, link: float) -> np.ndarray:
    """(k,) int32: the rigid group of each handle.

    A group has the handles that are joined by paths shorter than `link`. Such a path crosses one edge between
    the Voronoi cells of two handles.
    """
    k, distance, end = len(group), fronts.distance, graph.indices
    begin = np.repeat(np.arange(graph.n), np.diff(graph.indptr))
    near = distance[begin] + graph.lengths + distance[end] < link
    cells = np.stack([fronts.cell[begin[near]], fronts.cell[end[near]]])
    a, b = cells[:, group[cells[0]] == group[cells[1]]]
    return connected_components(coo_array((np.ones(len(a)), (a, b)), shape=(k, k)))[1]
