"""Nodes on a mesh: the graph that connects them, and the nodes that move each vertex."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from sshade.core.kernels import kernel, subroutine
from sshade.mesh.adjacency import VertexGraph
from sshade.mesh.mesh import Mesh
from sshade.proxy.fronts import Fronts

#: Least ratio of the two largest second moments of a node's edges that are not collinear.
COLLINEAR = 1e-6
#: Least number of neighbours of a node, unless its component has fewer nodes.
FEWEST_NEIGHBOURS = 3


def node_graph(mesh: Mesh, fronts: Fronts) -> np.ndarray:
    """Connect samples whose Voronoi cells share a mesh edge.

    Fewer than :data:`FEWEST_NEIGHBOURS` neighbours, or collinear neighbours, do not determine a node's
    rotation. Such a node is also connected to the next nodes along the graph until its neighbours determine
    the rotation, or no node of its component is left.

    Returns
    -------
    (e, 2) int64
        Smaller id first, in lexicographic order.
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
    star = _star(edges, k, shortest)
    neighbours = np.split(star.indices, star.indptr[1:-1])
    poor = [node for node in range(k) if not _determines_rotation(P, node, neighbours[node])]
    added = []
    for node, distance in zip(poor, dijkstra(star, indices=poor), strict=True):
        connected = neighbours[node].tolist()
        for other in np.argsort(distance, kind="stable"):
            if _determines_rotation(P, node, connected) or not np.isfinite(distance[other]):
                break
            if other != node and other not in connected:
                connected.append(int(other))
                added.append(sorted((node, int(other))))
    return np.unique(np.concatenate([edges, np.array(added, dtype=np.int64).reshape(-1, 2)]), axis=0)


def _star(edges: np.ndarray, k: int, length: np.ndarray) -> csr_array:
    """Return the (k, k) matrix of the lengths of edges between nodes."""
    i, j = np.concatenate([edges, edges[:, ::-1]]).T
    return coo_array((np.tile(length, 2), (i, j)), shape=(k, k)).tocsr()


def _determines_rotation(P: np.ndarray, node: int, neighbours: np.ndarray | list[int]) -> bool:
    """Return whether the edges from a node to some neighbours determine its rotation."""
    if len(neighbours) < FEWEST_NEIGHBOURS:
        return False
    e = P[neighbours] - P[node]
    moments = np.linalg.eigvalsh(e.T @ e)
    return bool(moments[1] > COLLINEAR * moments[2])


def bind_to_nodes(graph: VertexGraph, fronts: Fronts, *, edges: np.ndarray, blended: int) -> csr_array:
    """Find the `blended` nodes nearest to each vertex, and their weights.

    Candidates are the node of the vertex's cell and the neighbours of this node in the graph. Paths stay
    inside the cells of the candidates, so an arm that touches the torso does not follow the torso. If there
    are fewer than K + 1 candidates, the farthest one sets d_max. If all K nodes are as far as the next node,
    they have equal weights.

    Parameters
    ----------
    graph : VertexGraph
    fronts : Fronts
    edges : (e, 2) int64
    blended : int
        K.

    Returns
    -------
    (n, k) sparse float64
        phi, nearest nodes first; each row adds up to 1.
    """
    star = _star(edges, len(fronts), np.ones(len(edges)))
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
    weight /= weight.sum(axis=1, keepdims=True)
    first = np.concatenate([[0], np.cumsum(used.sum(axis=1))])
    return csr_array((weight[used], node[:, :-1][used], first), shape=(len(node), len(fronts)))


@kernel
def _nearest_nodes(indptr, indices, lengths, region, samples, star_start, star, count):
    """Return nodes and distances (n, count), nearest first; -1 and infinity if there are fewer."""
    n, k = len(region), len(samples)
    nearest, nearest_distance = np.full((n, count), -1, np.int32), np.full((n, count), np.inf)
    distance, queued = np.full(n, np.inf), np.zeros(n, np.bool_)
    ring, reached = np.empty(n + 1, np.int32), np.empty(n, np.int32)
    open_to = np.full(k, -1, np.int32)  # the last node whose paths may enter a cell
    for m in range(k):
        open_to[m] = m
        for p in range(star_start[m], star_start[m + 1]):
            open_to[star[p]] = m
        # Label-correcting search with a queue, which is fast because cells are small.
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


@subroutine
def _insert(ids, distances, m, d):
    """Insert into a sorted row and drop the last entry. Equal distances keep their order."""
    place = len(ids)
    while place > 0 and d < distances[place - 1]:
        place -= 1
    for p in range(len(ids) - 1, place, -1):
        ids[p], distances[p] = ids[p - 1], distances[p - 1]
    if place < len(ids):
        ids[place], distances[place] = m, d
