"""Handle groups stand for rigid parts: what is near one is pulled along by its rotation and translation.

Thirty points at the tip of a nose say where the head is, and how it is turned; but a surface that resists
stretching much more than bending can meet them with a head that tips over, and pays for it around the
points alone. People take a group of handles for the part of the body that it lies on. So each group
pulls the vertices around it towards its own rigid motion (R, t), which its points determine, with

    weight sum_i (a_i / r^2) exp(-(d_i / r)^2) |p_i - (R v_i + t)|^2

beside ``sum_ij w_ij |e'_ij - R_i e_ij|^2``: a_i is the area of vertex i, d_i its distance from the group plus
the group's own radius, r :data:`RADIUS` x the square root of the mesh's area. Neither the unit of length
nor the resolution matters, and the larger a group is, the less it pulls: a painted region as large as a
hand almost as much as a few points there, one of the size of a part nothing. The pulls are those of soft
handles: see :class:`sshade.solver.arap.ArapSystem`.

Which vertices are pulled, and at most how strongly, depends on the rest shape alone; targets say whereto.
Targets that no rigid motion reaches, as half-way along straight lines between two poses, leave (R, t)
uncertain. There the pull fades, from all to nothing, so that it never jumps while handles are dragged.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sshade.handles import Handles
from sshade.mesh.adjacency import VertexGraph, vertex_graph
from sshade.mesh.connectivity import members
from sshade.mesh.mesh import Mesh
from sshade.sampling.fronts import Fronts

#: r, over the square root of the mesh's area: on a body the radius of a head with its neck.
RADIUS = 0.22
#: Distance along the mesh, in r, up to which handles of one group are of one part.
LINK = 0.25
#: Distance d_i, in r, beyond which nothing is pulled.
REACH = 2.0
#: Second singular value of a part's points over the first, at least: those in a line leave the rotation open.
SPREAD = 0.1
#: How far from rigid the move of a part's points is where its pull begins to fade, and where nothing is left.
RIGID, LOOSE = 0.2, 0.4


class Pulled(NamedTuple):
    """Vertices that are held or pulled: the handles, in their order, and then those around them.

    Attributes
    ----------
    vertex : (p,) int64
    stiffness : (p,) float64
        inf where held; see :attr:`sshade.handles.Handles.stiffness`.
    target : (p, 3) float64
    """

    vertex: np.ndarray
    stiffness: np.ndarray
    target: np.ndarray


def pulled_by_parts(mesh: Mesh, handles: Handles, weight: float) -> Pulled:
    """The handles, and the vertices around them that their groups pull; see :class:`Parts`.

    Parameters
    ----------
    mesh : Mesh
    handles : Handles
    weight : float
    """
    parts = Parts(mesh, handles, weight)
    target, share = parts.goals(handles.target, handles.rotation)
    there = share > 0
    return Pulled(parts.vertex[there], (parts.stiffness * share)[there], target[there])


class Parts:
    """The parts that handles stand for, as they lie on the rest shape.

    Those of a group that are near to each other are a part. It pulls nothing where its points
    leave its rotation open: they are in a line, or too few, and no rotation is prescribed. Soft handles of
    weight w pull w / (1 + w) times as much as hard ones.

    Parameters
    ----------
    mesh : Mesh
    handles : Handles
        Their targets do not matter, nor what rotations they have, but for which of them have one.
    weight : float
        Without unit; 0 pulls nothing.

    Attributes
    ----------
    vertex : (p,) int64
        The handles, in their order, and then the vertices around them that are pulled.
    stiffness : (p,) float64
        At most; inf where held, see :attr:`sshade.handles.Handles.stiffness`.
    """

    def __init__(self, mesh: Mesh, handles: Handles, weight: float) -> None:
        parts: list[_Part] = []
        pull, part_of = np.zeros(mesh.n), np.zeros(mesh.n, dtype=np.int64)
        if weight > 0:
            r = RADIUS * np.sqrt(mesh.area)
            graph, turned = vertex_graph(mesh), handles.has_rotation
            fronts = Fronts(graph, handles.index)
            number = _parts(graph, fronts, handles.group, LINK * r)
            firm = np.where(np.isinf(handles.weight), 1.0, 1 - 1 / (1 + handles.weight))
            count = number.max() + 1
            place, radius, strength = np.zeros(count, dtype=np.int64), np.full(count, np.inf), np.zeros(count)
            for k, own in enumerate(members(number, count)):
                part = _Part.at_rest(own, mesh.V[handles.index[own]])
                if turned[own].any() or part.curvature:
                    place[k] = len(parts)
                    radius[k] = np.linalg.norm(part.arm, axis=1).max()
                    strength[k] = firm[own].mean() * weight / r**2
                    parts.append(part)
            nearest = number[fronts.cell]
            away = fronts.distance + radius[nearest]
            near = np.flatnonzero(away < REACH * r)
            pull[near] = strength[nearest[near]] * np.exp(-((away[near] / r) ** 2)) * mesh.vertex_areas[near]
            part_of[near] = place[nearest[near]]
        pull[handles.index] = 0.0
        near = np.flatnonzero(pull)
        self._parts = _Parts.of(parts) if parts else None
        self._pulled = members(part_of[near], len(parts))
        self._arms = [mesh.V[near[own]] - p.centre for own, p in zip(self._pulled, parts, strict=True)]
        self.vertex = np.concatenate([handles.index, near])
        self.stiffness = np.concatenate([handles.stiffness, pull[near]])

    def goals(self, target: np.ndarray, rotation: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Where vertices are pulled by handles with these targets and rotations.

        Parameters
        ----------
        target : (k, 3) float64
        rotation : (k, 3, 3) float64, optional
            See :class:`sshade.Handles`.

        Returns
        -------
        target : (p, 3) float64
        share : (p,) float64
            Of the stiffness, in [0, 1].
        """
        count = len(self.vertex) - len(target)
        goal, share = np.zeros((count, 3)), np.zeros(count)
        if self._parts is not None:
            R, centre, certainty = self._parts.motions(target, rotation)
            for k, (pulled, arms) in enumerate(zip(self._pulled, self._arms, strict=True)):
                share[pulled] = certainty[k]
                goal[pulled] = arms @ R[k].T + centre[k]
        return np.concatenate([target, goal]), np.concatenate([np.ones(len(target)), share])


class _Part(NamedTuple):
    """Handles `own` (j,) of one part: `arm` (j, 3) from their centre at rest, and what tells a rotation.

    That is how the sum of squares grows with a turn about the softest axis; 0 if they leave it open.
    """

    own: np.ndarray
    centre: np.ndarray
    arm: np.ndarray
    curvature: float

    @classmethod
    def at_rest(cls, own: np.ndarray, P: np.ndarray) -> _Part:
        centre = P.mean(axis=0)
        if len(own) < 3:
            return cls(own, centre, P - centre, 0.0)
        spread = np.linalg.svd(P - centre, compute_uv=False)
        told = spread[1] > SPREAD * spread[0]
        return cls(own, centre, P - centre, float((spread[1:] ** 2).sum()) if told else 0.0)


class _Parts(NamedTuple):
    """Parts beside each other: the handles of part k are ``own[start[k] : start[k + 1]]``.

    `part` (h,) is k for each of them, `arm` (h, 3) as of :class:`_Part`, `square` (p,) the sum of their
    squares, or 1 where the curvature (p,) is 0.
    """

    own: np.ndarray
    start: np.ndarray
    part: np.ndarray
    arm: np.ndarray
    square: np.ndarray
    curvature: np.ndarray

    @classmethod
    def of(cls, parts: list[_Part]) -> _Parts:
        size, arm = [len(part.own) for part in parts], np.concatenate([part.arm for part in parts])
        curvature = np.array([part.curvature for part in parts])
        square = np.array([(part.arm**2).sum() if part.curvature else 1.0 for part in parts])
        own, start = np.concatenate([part.own for part in parts]), np.cumsum([0, *size])
        return cls(own, start, np.repeat(np.arange(len(parts)), size), arm, square, curvature)

    def motions(
        self, target: np.ndarray, rotation: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """R (p, 3, 3), where centres go, and how well the targets of all handles tell R: from 1 down to 0.

        Two things speak against the best rotation (Kabsch's), both 1 - c where targets are c times a turned
        part: how far they are from it, and how much less than at rest the sum of squares grows
        with a turn away from R. A prescribed one is certain.
        """
        first, told = self.start[:-1], self.curvature > 0
        Q = target[self.own]
        centre = np.add.reduceat(Q, first) / np.diff(self.start)[:, None]
        Q -= centre[self.part]
        U, s, Vt = np.linalg.svd(np.add.reduceat(Q[:, :, None] * self.arm[:, None], first))
        sign = np.where(np.linalg.det(U @ Vt) > 0, 1.0, -1.0)
        U[:, :, 2] *= sign[:, None]
        R = np.where(told[:, None, None], U @ Vt, np.eye(3))
        turned = np.einsum("hij,hj->hi", R[self.part], self.arm)
        misfit = np.sqrt(np.add.reduceat(((turned - Q) ** 2).sum(axis=1), first) / self.square)
        off = np.maximum(misfit, 1.0 - (s[:, 1] + sign * s[:, 2]) / np.where(told, self.curvature, 1.0))
        certainty = np.where(told, np.clip((LOOSE - off) / (LOOSE - RIGID), 0.0, 1.0), 0.0)
        if rotation is not None:
            for k, end in enumerate(self.start[1:]):
                given = rotation[self.own[first[k] : end]]
                given = given[np.isfinite(given).all(axis=(1, 2))]
                if len(given):
                    R[k], certainty[k] = given[0], 1.0
        return R, centre, certainty


def _parts(graph: VertexGraph, fronts: Fronts, group: np.ndarray, link: float) -> np.ndarray:
    """(k,) int32: the part that each handle belongs to."""
    edges = graph.indptr, graph.indices, graph.lengths
    a, b = _joined(*edges, fronts.cell, fronts.distance, group, link).T
    k = len(group)
    return connected_components(coo_array((np.ones(len(a)), (a, b)), shape=(k, k)))[1]


@njit(cache=True, nogil=True)
def _joined(indptr, indices, lengths, region, distance, group, link):
    """(j, 2) handles of one group whose regions touch in an edge that a path shorter than `link` goes by."""
    pairs = []
    for i in range(len(region)):
        for p in range(indptr[i], indptr[i + 1]):
            a, b = region[i], region[indices[p]]
            near = distance[i] + lengths[p] + distance[indices[p]] < link
            if a != b and near and group[a] == group[b]:
                pairs.append((a, b))
    found = np.empty((len(pairs), 2), dtype=np.int32)
    for k in range(len(pairs)):
        found[k, 0], found[k, 1] = pairs[k]
    return found
