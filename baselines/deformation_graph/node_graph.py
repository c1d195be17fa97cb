"""Nodes on a mesh: a graph between them, and the nodes that each vertex follows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.sparse import coo_array, csr_array

from sshade.mesh.adjacency import VertexGraph
from sshade.mesh.mesh import Mesh
from sshade.sampling.fronts import Fronts

#: A node's edges span a plane if the second moment of their directions exceeds this, times the first.
COLLINEAR = 1e-6
#: Neighbours that every node gets, as far as there are other nodes.
FEWEST_NEIGHBOURS = 3


@dataclass(frozen=True, eq=False)
class NodeGraph:
    """Nodes on a mesh and the edges between them.

    Parameters
    ----------
    P : (k, 3) float64
        Rest positions.
    edges : (e, 2) int64
        Smaller id first, in lexicographic order.
    """

    P: np.ndarray
    edges: np.ndarray


@dataclass(frozen=True, eq=False)
class NodeBinding:
    """The nodes that each vertex follows.

    Parameters
    ----------
    node : (n, K) int32
        Nearest first; what is missing is -1 and has no weight.
    weight : (n, K) float64
        phi; each row adds up to 1.
    """

    node: np.ndarray
    weight: np.ndarray


def node_graph(mesh: Mesh, fronts: Fronts) -> NodeGraph:
    """Connect samples whose Voronoi regions share a mesh edge.

    A node with fewer than :data:`FEWEST_NEIGHBOURS`, or with neighbours along one
    line only, leaves its rotation open. It is connected to the nodes next to it
    along the graph until neither holds, or no node of its component is left.
    """
    P, k = mesh.V[fronts.samples], len(fronts)
    ends = fronts.cell[mesh.edges].astype(np.int64)
    apart = ends[:, 0] != ends[:, 1]
    a, b = mesh.edges[apart].T
    length = fronts.distance[a] + np.linalg.norm(mesh.V[a] - mesh.V[b], axis=1) + fronts.distance[b]
    keys, inverse = np.unique(ends[apart].min(axis=1) * k + ends[apart].max(axis=1), return_inverse=True)
    shortest = np.full(len(keys), np.inf)
    np.minimum.at(shortest, inverse.ravel(), length)
    edges = np.stack([keys // k, keys % k], axis=1)
    added = _missing_edges(P, edges, shortest)
    if added:
        edges = np.unique(np.concatenate([edges, np.sort(added, axis=1)]), axis=0)
    return NodeGraph(P, edges)


def _missing_edges(P: np.ndarray, edges: np.ndarray, length: np.ndarray) -> list[tuple[int, int]]:
    """Edges that give each node a rotation, as far as there are other nodes."""
    from scipy.sparse.csgraph import dijkstra

    k = len(P)
    adjacency = coo_array((length, tuple(edges.T)), shape=(k, k)).tocsr()
    star = _star(edges, k)
    neighbours = np.split(star.indices, star.indptr[1:-1])
    poor = [node for node in range(k) if not _holds(P, node, neighbours[node])]
    if not poor:
        return []
    added = []
    distance = dijkstra(adjacency, directed=False, indices=poor)
    for row, node in enumerate(poor):
        known = neighbours[node].tolist()
        for other in np.argsort(distance[row], kind="stable"):
            if _holds(P, node, known) or not np.isfinite(distance[row, other]):
                break
            if other != node and other not in known:
                known.append(int(other))
                added.append((node, int(other)))
    return added


def _star(edges: np.ndarray, k: int) -> csr_array:
    """(k, k) ones where two nodes are connected."""
    i, j = np.concatenate([edges, edges[:, ::-1]]).T
    return coo_array((np.ones(len(i)), (i, j)), shape=(k, k)).tocsr()


def _holds(P: np.ndarray, node: int, neighbours: np.ndarray | list[int]) -> bool:
    """Whether edges to these neighbours determine the node's rotation."""
    if len(neighbours) < FEWEST_NEIGHBOURS:
        return False
    e = P[neighbours] - P[node]
    moments = np.linalg.eigvalsh(e.T @ e)
    return bool(moments[1] > COLLINEAR * moments[2])


def bind_to_nodes(graph: VertexGraph, fronts: Fronts, *, edges: np.ndarray, blended: int) -> NodeBinding:
    """The `blended` nodes nearest to each vertex, and their weights.

    Nodes are sought among that of the vertex's region and its neighbours in the
    graph, with distances along paths within such regions: an arm that touches the
    torso does not follow it. Where they are fewer than K + 1 the farthest one sets
    d_max; where all K are as far as the next one they count the same.

    Parameters
    ----------
    graph : VertexGraph
    fronts : Fronts
    edges : (e, 2) int64
    blended : int
        K.
    """
    star = _star(edges, len(fronts))
    node, distance = _nearest_nodes(
        graph.indptr,
        graph.indices,
        graph.lengths,
        fronts.cell,
        fronts.samples,
        star.indptr,
        star.indices,
        blended + 1,
    )
    found = np.isfinite(distance).sum(axis=1)
    used = np.arange(blended) < np.maximum(found - 1, 1)[:, None]
    farthest = distance[np.arange(len(distance)), found - 1]
    ratio = np.ones_like(distance[:, :-1])
    np.divide(distance[:, :-1], farthest[:, None], out=ratio, where=used & (farthest > 0)[:, None])
    weight = np.where(used, (1.0 - ratio) ** 2, 0.0)
    level = weight.sum(axis=1) == 0.0
    weight[level] = used[level]
    return NodeBinding(
        np.ascontiguousarray(np.where(used, node[:, :-1], -1)), weight / weight.sum(axis=1, keepdims=True)
    )


@njit(cache=True, nogil=True)
def _nearest_nodes(indptr, indices, lengths, region, samples, star_start, star, count):
    """Nodes and distances, (n, count) each, nearest first; -1 and infinity where there are fewer."""
    n, k = len(region), len(samples)
    nearest, nearest_distance = np.full((n, count), -1, np.int32), np.full((n, count), np.inf)
    distance, queued = np.full(n, np.inf), np.zeros(n, np.bool_)
    ring, reached = np.empty(n + 1, np.int32), np.empty(n, np.int32)
    open_to = np.full(k, -1, np.int32)  # the last node whose paths may enter a region
    for m in range(k):
        open_to[m] = m
        for p in range(star_start[m], star_start[m + 1]):
            open_to[star[p]] = m
        # Labels are corrected in the order of a queue: the regions are small.
        head, tail, found = 0, 1, 1
        ring[0] = reached[0] = samples[m]
        distance[samples[m]] = 0.0
        while head != tail:
            u = ring[head]
            head = head + 1 if head < n else 0
            queued[u] = False
            for p in range(indptr[u], indptr[u + 1]):
                w, d = indices[p], distance[u] + lengths[p]
                if open_to[region[w]] == m and d < distance[w]:
                    if distance[w] == np.inf:
                        reached[found] = w
                        found += 1
                    distance[w] = d
                    if not queued[w]:
                        queued[w] = True
                        ring[tail] = w
                        tail = tail + 1 if tail < n else 0
        for r in range(found):
            _insert(nearest[reached[r]], nearest_distance[reached[r]], m, distance[reached[r]])
            distance[reached[r]] = np.inf
    return nearest, nearest_distance


@njit(cache=True, nogil=True)
def _insert(ids, distances, m, d):
    """Insert into a sorted row; of equal distances the earlier one comes first, and the last falls out."""
    place = len(ids)
    while place > 0 and d < distances[place - 1]:
        place -= 1
    for p in range(len(ids) - 1, place, -1):
        ids[p], distances[p] = ids[p - 1], distances[p - 1]
    if place < len(ids):
        ids[place], distances[place] = m, d
