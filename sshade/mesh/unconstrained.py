"""Components without handles: they follow other components rigidly, and may come apart from others."""

from __future__ import annotations

import logging
from typing import NamedTuple

import numpy as np

from sshade.core.errors import counted
from sshade.mesh.incidence import members
from sshade.mesh.mesh import Mesh
from sshade.mesh.places import TOUCHING, same_places
from sshade.mesh.rigid import rigid_motion

log = logging.getLogger(__name__)

#: Number of vertices of the nearest component whose motion a vertex of an unconstrained component follows.
NEAREST = 8
#: Number of vertices of a component between which gaps to others are looked for, and of neighbours of each.
SAMPLES, BESIDE = 1000, 32
#: What can be done about components without handles.
HOW_TO_CONSTRAIN = (
    "give each one, or leave --refuse-unconstrained out (in Python refuse_unconstrained=False): they then "
    "move with the nearest component"
)


class Contacts(NamedTuple):
    """Places where components without handles touch other components.

    Attributes
    ----------
    components : int
        Number of components without handles that touch another component.
    vertex : (k,) int64
        Vertices at such places, place by place.
    first : (k,) int64
        First vertex at the same place.
    """

    components: int
    vertex: np.ndarray
    first: np.ndarray

    def warn(self) -> None:
        """Say in the log that components may come apart."""
        if self.components:
            touch = ("component without handles touches", "components without handles touch")
            log.warning(
                "%s other components, and may come apart from them where the others do not move rigidly",
                counted(self.components, *touch),
            )

    def opening(self, V: np.ndarray) -> float:
        """Return the largest distance, at positions V (n, 3), of a vertex from the first at its place."""
        return float(np.linalg.norm(V[self.vertex] - V[self.first], axis=1).max(initial=0.0))


def contacts(mesh: Mesh, unconstrained: np.ndarray) -> Contacts:
    """Find the places where components touch, of which one at least is unconstrained.

    Parameters
    ----------
    mesh : Mesh
    unconstrained : (u,) int
        Components without handles.
    """
    if len(unconstrained) == 0:
        none = np.zeros(0, dtype=np.int64)
        return Contacts(0, none, none)
    place = same_places(mesh.V, np.full(3, TOUCHING * mesh.diagonal))
    vertex = np.argsort(place, kind="stable")
    start = np.flatnonzero(np.diff(place[vertex], prepend=-1))
    free = np.isin(mesh.component, unconstrained)
    low, high = (at(mesh.component[vertex], start) for at in (np.minimum.reduceat, np.maximum.reduceat))
    touching = (low < high) & np.logical_or.reduceat(free[vertex], start)
    size = np.diff(start, append=mesh.n)
    vertex, first = vertex[np.repeat(touching, size)], np.repeat(vertex[start[touching]], size[touching])
    return Contacts(len(np.unique(mesh.component[vertex[free[vertex]]])), vertex, first)


def leaders(mesh: Mesh, unconstrained: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the vertices of each unconstrained component, and the vertices that it follows.

    It follows the closest vertices of another component: the first of the components that lead to one with
    handles. They are those with the least sum of gaps, where each further component counts as a gap of a mean
    edge. An eye follows its head, and a head without handles follows the body. A component comes after the
    one that it follows.
    """
    from scipy.spatial import cKDTree

    if len(unconstrained) == 0:
        return []
    vertices = members(mesh.component, mesh.topology.components)
    others = np.flatnonzero(np.isin(mesh.component, unconstrained, invert=True))
    tree, trees, found = cKDTree(mesh.V[others]), {}, []
    gap, nearest = np.empty(len(unconstrained)), np.empty(len(unconstrained), dtype=np.int64)
    for i, component in enumerate(unconstrained):
        distance, near = tree.query(mesh.V[vertices[component]])
        gap[i], nearest[i] = distance.min(), mesh.component[others[near[np.argmin(distance)]]]
    order, before = _chains(mesh, [vertices[component] for component in unconstrained], gap)
    for i in order:
        leader = nearest[i] if before[i] < 0 else unconstrained[before[i]]
        moved = vertices[unconstrained[i]]
        if leader not in trees:
            trees[leader] = cKDTree(mesh.V[vertices[leader]])
        _, near = trees[leader].query(mesh.V[moved], k=min(NEAREST, len(vertices[leader])))
        found.append((moved, vertices[leader][np.unique(near)]))
    return found


def _chains(mesh: Mesh, parts: list[np.ndarray], gap: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the order in which parts are reached from the handles, and the part before each, or -1.

    Parameters
    ----------
    mesh : Mesh
    parts : list of int arrays
        Vertices of each component without handles.
    gap : (u,) float64
        Distance of each from the components with handles.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra
    from scipy.spatial import cKDTree

    some = [vertices[:: 1 + len(vertices) // SAMPLES] for vertices in parts]
    part, V = np.repeat(np.arange(len(parts)), [len(own) for own in some]), mesh.V[np.concatenate(some)]
    distance, near = cKDTree(V).query(V, k=min(BESIDE, len(V)))
    first, second = np.repeat(part, near.shape[1]), part[near.ravel()]
    across = first != second
    first, second, far = first[across], second[across], distance.ravel()[across] + mesh.mean_edge
    shortest = np.lexsort((far, second, first))
    pair = np.unique(first[shortest] * len(parts) + second[shortest], return_index=True)[1]
    ways = shortest[pair]
    start, number = len(parts), np.arange(len(parts))
    ends = np.append(first[ways], np.full(len(parts), start)), np.append(second[ways], number)
    lengths = np.append(far[ways], gap + 1e-9 * mesh.mean_edge)  # zero would be no way
    graph = coo_array((lengths, ends), shape=(len(parts) + 1,) * 2).tocsr()
    length, before = dijkstra(graph, indices=start, return_predecessors=True)
    before = before[:-1]
    return np.argsort(length[:-1], kind="stable"), np.where(before == start, -1, before)


def move_rigidly(mesh: Mesh, positions: np.ndarray, led: list[tuple[np.ndarray, np.ndarray]]) -> None:
    """Move each unconstrained component rigidly with the vertices that it follows: see :func:`leaders`."""
    for moved, near in led:
        R, t = rigid_motion(mesh.V[near], positions[near])
        positions[moved] = mesh.V[moved] @ R.T + t
