"""Handle groups stand for rigid parts: what is near one is pulled along by its rotation and translation.

Thirty points at the tip of a nose say where the head is, and how it is turned; but a surface that resists
stretching much more than bending can meet them with a head that tips over, and pays for it around the
points alone. People take a group of handles for the part of the body that it lies on. So each group
pulls the vertices around it towards its own rigid motion (R, t), which its points determine, with

    weight sum_i (a_i / r^2) exp(-(d_i / r)^2) |p_i - (R v_i + t)|^2

beside ``sum_ij w_ij |e'_ij - R_i e_ij|^2``: a_i is the area of vertex i, d_i its distance from the group plus
the group's own radius, r :data:`RADIUS` x the square root of the mesh's area. Neither the unit of length
nor the resolution matters, and a group of the size of a part, such as a painted region, pulls nothing.
The pulls are those of soft handles: see :class:`sshade.solver.arap.ArapSystem`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sshade.handles import Handles
from sshade.mesh.adjacency import VertexGraph, vertex_graph
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import rigid_motion
from sshade.sampling.fronts import Fronts

#: r, over the square root of the mesh's area: on a body the radius of a head with its neck.
RADIUS = 0.22
#: Distance along the mesh, in r, up to which handles of one group are of one part.
LINK = 0.25
#: Distance d_i, in r, beyond which nothing is pulled.
REACH = 2.0
#: Second singular value of a part's points over the first, at least: those in a line leave the rotation open.
SPREAD = 0.1
#: Rms distance of a part's points from their rigid motion over their rms distance from their centre, at most.
RIGID = 0.3


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
    """The handles, and the vertices around them that their groups pull.

    Parameters
    ----------
    mesh : Mesh
    handles : Handles
        Those of a group that are near to each other are a part. It pulls nothing where its points
        leave its rotation open (they are in a line, or too few, and no rotation is prescribed) or are not
        moved rigidly. Soft handles of weight w pull w / (1 + w) times as much as hard ones.
    weight : float
        Without unit; 0 pulls nothing.
    """
    own = Pulled(handles.index, handles.stiffness, handles.target)
    if weight == 0:
        return own
    r = RADIUS * np.sqrt(mesh.area)
    graph = vertex_graph(mesh)
    fronts = Fronts(graph, handles.index)
    part = _parts(graph, fronts, handles.group, LINK * r)
    pull, goal = np.zeros(mesh.n), np.zeros((mesh.n, 3))
    for number, radius, R, t in _motions(mesh, handles, part):
        near = np.flatnonzero((part[fronts.region] == number) & (fronts.distance + radius < REACH * r))
        w = handles.weight[part == number]
        firmness = np.where(np.isinf(w), 1.0, 1 - 1 / (1 + w)).mean()
        pull[near] = firmness * weight / r**2 * np.exp(-(((fronts.distance[near] + radius) / r) ** 2))
        goal[near] = mesh.V[near] @ R.T + t
    pull *= np.bincount(mesh.F.ravel(), np.repeat(mesh.face_areas / 3, 3), minlength=mesh.n)
    pull[handles.index] = 0.0
    near = np.flatnonzero(pull)
    return Pulled(*(np.concatenate(pair) for pair in zip(own, (near, pull[near], goal[near]), strict=True)))


def _parts(graph: VertexGraph, fronts: Fronts, group: np.ndarray, link: float) -> np.ndarray:
    """(k,) int32: the part that each handle belongs to."""
    owner = np.repeat(np.arange(graph.n), np.diff(graph.indptr))
    a, b = fronts.region[owner], fronts.region[graph.indices]
    apart = fronts.distance[owner] + graph.lengths + fronts.distance[graph.indices]
    joins = (a != b) & (apart < link)
    joins[joins] = group[a[joins]] == group[b[joins]]
    k = len(group)
    return connected_components(coo_array((np.ones(joins.sum()), (a[joins], b[joins])), shape=(k, k)))[1]


def _motions(
    mesh: Mesh, handles: Handles, part: np.ndarray
) -> Iterator[tuple[int, float, np.ndarray, np.ndarray]]:
    """Of each part that has one: its number, its radius, its rotation and its translation."""
    prescribed = handles.rotation
    for number in range(part.max() + 1):
        own = np.flatnonzero(part == number)
        P, Q = mesh.V[handles.index[own]], handles.target[own]
        centre, goal = P.mean(axis=0), Q.mean(axis=0)
        radius = float(np.linalg.norm(P - centre, axis=1).max())
        given = np.empty(0) if prescribed is None else prescribed[own]
        given = given[np.isfinite(given).all(axis=(1, 2))] if len(given) else given
        if len(given):
            yield number, radius, given[0], goal - given[0] @ centre
            continue
        if len(own) < 3:
            continue
        spread = np.linalg.svd(P - centre, compute_uv=False)
        R, t = rigid_motion(P, Q)
        if spread[1] > SPREAD * spread[0] and np.linalg.norm(P @ R.T + t - Q) < RIGID * np.linalg.norm(
            spread
        ):
            yield number, radius, R, t
