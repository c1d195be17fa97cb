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

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.spatial import cKDTree

from sshade.core.threads import available_cpus
from sshade.mesh.mesh import Mesh, unit_rows
from sshade.solver.laplacian import Ranges
from sshade.solver.terms import Term

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


class Struts(NamedTuple):
    """The struts of a bound problem, by the places of their first vertices.

    Attributes
    ----------
    first, second : (s,) int64
        Places of both vertices. No two struts have one first vertex.
    ends : (2, s) int64
        The vertices of the mesh.
    stiffness : (s,) float64
    rest : (s, 3) float64
        First minus second vertex.
    corners : int
        Number of times that the as-rigid-as-possible energy counts each edge.
    """

    first: np.ndarray
    second: np.ndarray
    ends: np.ndarray
    stiffness: np.ndarray
    rest: np.ndarray
    corners: int

    @classmethod
    def of(cls, mesh: Mesh, place: np.ndarray, weight: float, corners: int) -> Struts:
        """Join the opposite vertices of a mesh; `place` (n,) is each vertex in the solver's order."""
        i, j = opposite_vertices(mesh)
        order = np.argsort(place[i])
        i, j = i[order], j[order]
        rest = mesh.V[i] - mesh.V[j]
        stiffness = weight * mesh.vertex_areas[i] / np.einsum("pd,pd->p", rest, rest)
        return cls(place[i], place[j], np.stack([i, j]), stiffness, rest, corners)

    def matrix(self, n: int, *, ends: np.ndarray | None = None) -> csr_array:
        """Return the matrix (n, n) of the struts, in the mesh's order, or for other ids `ends` (2, s)."""
        i, j = self.ends if ends is None else ends
        k = self.stiffness
        entries = np.concatenate([k, k, -k, -k]), (np.concatenate([i, j, i, j]), np.concatenate([i, j, j, i]))
        return csr_array(coo_array(entries, shape=(n, n)))

    @property
    def rest_energy(self) -> float:
        """Energy of all vertices in one point; unit length^2."""
        return self.corners * float((self.stiffness[:, None] * self.rest**2).sum())


class Strutting(Term):
    """The struts of one solve; a :class:`sshade.solver.terms.Term`.

    Parameters
    ----------
    struts : Struts
    ranges : Ranges
        See :func:`sshade.solver.laplacian.vertex_ranges`.
    """

    def __init__(self, struts: Struts, ranges: Ranges) -> None:
        self._struts = struts
        self._by_second = np.argsort(struts.second, kind="stable")
        second = struts.second[self._by_second]
        self._first_in = [slice(*np.searchsorted(struts.first, own[1:])) for own in ranges]
        self._second_in = [self._by_second[slice(*np.searchsorted(second, own[1:]))] for own in ranges]
        #: Strut vectors after the local step, then the forces of the struts.
        self._W = np.empty_like(struts.rest)

    def local(self, number: int, P: np.ndarray, S: np.ndarray) -> float:
        own, struts = self._first_in[number], self._struts
        place, weight = struts.first[own], struts.corners * struts.stiffness[own]
        self._W[own] = arm = P[place] - P[struts.second[own]]
        S[place] += (weight[:, None, None] * struts.rest[own][:, :, None] * arm[:, None]).reshape(-1, 9)
        return float((weight[:, None] * arm * arm).sum())

    def turn(self, number: int, R: np.ndarray) -> None:
        own, struts = self._first_in[number], self._struts
        turned = np.einsum("pab,pb->pa", R[struts.first[own]].reshape(-1, 3, 3), struts.rest[own])
        self._W[own] = struts.stiffness[own][:, None] * (turned - self._W[own])

    def forces(self, number: int, P: np.ndarray, R: np.ndarray, B: np.ndarray) -> float:
        own, others, struts = self._first_in[number], self._second_in[number], self._struts
        B[struts.first[own]] += self._W[own]
        np.subtract.at(B, struts.second[others], self._W[others])
        energy = (self._W[own] ** 2).sum(axis=1) / struts.stiffness[own]
        return struts.corners * float(energy.sum())
