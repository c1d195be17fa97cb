"""Struts: springs between opposite vertices, which keep the local thickness.

A surface does not know that it is a wall or a solid. It may pinch, or swell, at no cost but stretch. A strut
joins vertex i to the opposite vertex j, and costs

    weight (a_i / t^2) |(p_i - p_j) - R_i (v_i - v_j)|^2

beside the as-rigid-as-possible energy. The area of vertex i is a_i, t its distance from vertex j at rest, and
R_i its rotation, which both energies share. A relative change of the thickness costs as much as the same
strain of the surface, at any scale and resolution.

The opposite vertex lies on the largest ball inside the surface that touches it at vertex i. The ball shrinks
until no vertex is inside. In a round limb it may end at a vertex beside i, whose normal is nearly the same.
Then the ray along the inward normal goes on from the far side of the ball, in steps of the distance to the
nearest vertex, until this vertex has an opposite normal. A ray that leaves the surface gives no strut.

J. Ma, S. W. Bae, S. Choi, "3D medial axis point approximation using nearest neighbors and the normal field",
2012 (shrinking balls).
"""

from __future__ import annotations

from copy import copy
from typing import Self

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.spatial import cKDTree

from sshade.core.threads import available_cpus
from sshade.mesh.mesh import Mesh, unit_rows
from sshade.problem.options import Options
from sshade.solver.bound_handles import BoundHandles
from sshade.solver.ordered_mesh import Order, OrderedMesh
from sshade.solver.terms.term import Term

#: Largest number of balls at a vertex; about 10 are usual.
BALLS = 40
#: Relative difference below which a ball does not shrink any more.
SAME_BALL = 1e-6
#: Largest number of steps of a ray; its step is at least `LEAST_STEP` times the mean edge.
STEPS, LEAST_STEP = 60, 0.5
#: Largest cosine between the normals of opposite vertices.
OPPOSITE = -0.5
#: Least thickness, as a fraction of the mean edge.
LEAST = 0.05


def opposite_vertices(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (s,) int64, ascending, and the opposite vertex (s,) int64 of each.

    Parameters
    ----------
    mesh : Mesh
        Consistently oriented; faces counter-clockwise seen from outside.
    """
    V, inward = mesh.V, np.zeros((mesh.n, 3))
    a, b, c = (V[mesh.F[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)
    for k in range(3):
        for axis in range(3):
            inward[:, axis] -= np.bincount(mesh.F[:, k], area[:, axis], mesh.n)
    inward = unit_rows(inward)
    tree, radius = cKDTree(V), np.full(mesh.n, mesh.diagonal)
    touched, active = np.full(mesh.n, -1), np.flatnonzero(inward.any(axis=1))
    for _ in range(BALLS):
        if len(active) == 0:
            break
        centre = V[active] + radius[active, None] * inward[active]
        # The vertex itself is always on the ball.
        _, near = tree.query(centre, k=2, workers=available_cpus())
        near = np.where(near[:, 0] == active, near[:, 1], near[:, 0])
        arm = V[near] - V[active]
        along = np.einsum("pd,pd->p", arm, inward[active])
        square = np.einsum("pd,pd->p", arm, arm)
        with np.errstate(divide="ignore", invalid="ignore"):
            smaller = np.where(along > 0, square / (2 * along), np.inf)
        shrinks = smaller < (1 - SAME_BALL) * radius[active]
        active, near = active[shrinks], near[shrinks]
        radius[active], touched[active] = smaller[shrinks], near
    cosine = np.einsum("pd,pd->p", inward, inward[touched])
    missed = np.flatnonzero((touched < 0) | (cosine > OPPOSITE))
    touched[missed] = _along_rays(mesh, tree, inward, missed, 2.0 * radius[missed])
    first = np.flatnonzero(touched >= 0)
    second = touched[first]
    apart = np.linalg.norm(V[first] - V[second], axis=1) > LEAST * mesh.mean_edge
    return first[apart], second[apart]


def _along_rays(
    mesh: Mesh, tree: cKDTree, inward: np.ndarray, vertex: np.ndarray, begin: np.ndarray
) -> np.ndarray:
    """Return the first opposite vertex (p,) on the rays from vertices (p,) at distances `begin` on; or -1.

    `inward` (n, 3) are the normals of all vertices.
    """
    found, t, edge = np.full(len(vertex), -1), begin.copy(), mesh.mean_edge
    active = np.flatnonzero(begin < mesh.diagonal)
    for _ in range(STEPS):
        if len(active) == 0:
            break
        own = vertex[active]
        distance, near = tree.query(mesh.V[own] + t[active, None] * inward[own], workers=available_cpus())
        cosine = np.einsum("pd,pd->p", inward[own], inward[near])
        arrived = (cosine <= OPPOSITE) & (distance <= edge)
        found[active[arrived]] = near[arrived]
        t[active] += np.maximum(distance - LEAST_STEP * edge, LEAST_STEP * edge)
        active = active[~arrived & (t[active] < mesh.diagonal)]
    return found


class Struts(Term):
    """The struts; see :class:`sshade.solver.terms.term.Term`. No two struts have one first vertex.

    Parameters
    ----------
    ordered : OrderedMesh
    weight : float
        Option `thickness`.
    """

    option = "thickness"
    rigid = True
    _W: np.ndarray

    def __init__(self, ordered: OrderedMesh, weight: float) -> None:
        mesh, self._ordered = ordered.mesh, ordered
        i, j = opposite_vertices(mesh)
        order = np.argsort(ordered.place[i])
        #: The two vertices of each strut, by the place of the first.
        self._ends = np.stack([i[order], j[order]])
        self._first, self._second = ordered.place[self._ends]
        self._rest = mesh.V[self._ends[0]] - mesh.V[self._ends[1]]
        square = np.einsum("pd,pd->p", self._rest, self._rest)
        self._stiffness = weight * mesh.vertex_areas[self._ends[0]] / square
        self.rest_energy = ordered.corners * float((self._stiffness[:, None] * self._rest**2).sum())
        by_second = np.argsort(self._second, kind="stable")
        second = self._second[by_second]
        self._first_in = [slice(*np.searchsorted(self._first, own[1:])) for own in ordered.ranges]
        self._second_in = [by_second[slice(*np.searchsorted(second, own[1:]))] for own in ordered.ranges]

    @classmethod
    def bound(cls, ordered: OrderedMesh, handles: BoundHandles, options: Options) -> Self | None:
        return cls(ordered, options.thickness) if options.thickness > 0 else None

    def with_handles(self, ordered: OrderedMesh, handles: BoundHandles, options: Options) -> Self:
        return self

    def matrix(self, order: Order) -> csr_array:
        i, j = self._ordered.numbers(self._ends, order)
        k, n = self._stiffness, self._ordered.mesh.n
        entries = np.concatenate([k, k, -k, -k]), (np.concatenate([i, j, i, j]), np.concatenate([i, j, j, i]))
        return csr_array(coo_array(entries, shape=(n, n)))

    def begun(self, options: Options) -> Self:
        term = copy(self)
        #: Strut vectors after the local step, then the forces of the struts.
        term._W = np.empty_like(self._rest)
        return term

    def local(self, number: int, P: np.ndarray, S: np.ndarray) -> float:
        own = self._first_in[number]
        place, weight = self._first[own], self._ordered.corners * self._stiffness[own]
        self._W[own] = arm = P[place] - P[self._second[own]]
        S[place] += (weight[:, None, None] * self._rest[own][:, :, None] * arm[:, None]).reshape(-1, 9)
        return float((weight[:, None] * arm * arm).sum())

    def turn(self, number: int, R: np.ndarray) -> None:
        own = self._first_in[number]
        turned = np.einsum("pab,pb->pa", R[self._first[own]].reshape(-1, 3, 3), self._rest[own])
        self._W[own] = self._stiffness[own][:, None] * (turned - self._W[own])

    def forces(self, number: int, P: np.ndarray, R: np.ndarray, B: np.ndarray) -> float:
        own, others = self._first_in[number], self._second_in[number]
        B[self._first[own]] += self._W[own]
        np.subtract.at(B, self._second[others], self._W[others])
        energy = (self._W[own] ** 2).sum(axis=1) / self._stiffness[own]
        return self._ordered.corners * float(energy.sum())
