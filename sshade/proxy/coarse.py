"""Farthest point sampling of large meshes, from coarse to fine and in threads.

On a large mesh the first fronts of farthest point sampling are slow, because each sweeps the whole mesh.
Here they sweep a coarse graph instead:

1. Choose a net: vertices such that no two are within a radius of each other, and all other vertices are
   within the radius of one. Vertices of the net are joined where their Voronoi cells meet, by the length of
   the shortest way over an edge between the cells.
2. Choose the first half of the samples as farthest points of this graph.
3. Advance fronts from these samples on the mesh. Distances on the coarse graph bound how far each front goes.
4. Choose the other half on the mesh, each the vertex farthest from all samples.

Cells and distances are exact. The distances that choose the second half are exact as well, and the second
half determines the spacing. Only the choice of the first half is approximate.

Threads divide the mesh into slabs along its longest axis. Fronts advance within slabs; then each slab takes
over vertices that are nearer through an edge from another slab, until none changes. The result is the unique
fixed point, with ties to the smaller sample. Neither the order of slabs nor the number of threads changes it.

Coarse graphs of Voronoi cells: R. Wiersma, A. Nasikun, E. Eisemann, K. Hildebrandt, "A fast geometric
multigrid method for curved surfaces", 2023.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from sshade.core.kernels import kernel
from sshade.core.threads import ThreadTeam, available_cpus, in_ranges
from sshade.mesh.adjacency import VertexGraph
from sshade.mesh.incidence import sort_by_id
from sshade.mesh.mesh import Mesh
from sshade.proxy import advance
from sshade.proxy.fronts import Fronts, band, farthest_point_sampling

#: Fraction of the samples chosen on the coarse graph, number of net vertices for each of them, and least
#: number of vertices of the mesh for each of those. Below, plain farthest point sampling is faster.
FRACTION, NET, FINER = 0.5, 16, 8
#: Number of slabs: more than most machines have cores, and few enough that borders stay short.
SLABS = 32
#: Expected area for each vertex of a net, over its squared radius.
_NET_AREA = 0.8
#: Fraction of the expected number of net vertices that is enough.
_ENOUGH = 0.25
#: Factor on upper bounds of distances. It exceeds the rounding error of a sum of lengths in another order.
_ROUNDING = 1 + 1e-9


def sample_coarsely(mesh: Mesh, graph: VertexGraph, count: int, *, first: np.ndarray) -> Fronts:
    """Sample like :func:`sshade.proxy.sample.sample_farthest`, but from coarse to fine for any size.

    `count` must be at least h.
    """
    coarse_count = coarse_samples(count, first)
    slabs = _Slabs(mesh.V)
    with ThreadTeam(available_cpus()) as team:
        net, state = _net(graph, slabs, team, first, area=mesh.area, count=NET * coarse_count)
        coarse, borders = _coarse_graph(graph, slabs, team, state, net)
        sampled = farthest_point_sampling(coarse, coarse_count, first=state.cell[first])
        samples = np.concatenate(net)[sampled.samples]
        state = state._replace(width=band(graph))

        def bound(begin: int, end: int) -> None:
            """Turn distances to the net into upper bounds of distances to samples."""
            state.distance[begin:end] += sampled.distance[state.cell[begin:end]]
            state.distance[begin:end] *= _ROUNDING
            state.cell[begin:end] = -1

        in_ranges(bound, graph.n)
        _sweep(slabs, team, state, samples, borders)
    fronts = Fronts.advanced(graph, samples, state)
    fronts.insert_farthest(count - coarse_count)
    return fronts


def coarse_samples(count: int, first: np.ndarray) -> int:
    """Return the number of samples chosen on the coarse graph."""
    return max(len(first), round(FRACTION * count))


def has_room(n: int, count: int, first: np.ndarray) -> bool:
    """Whether a mesh of n vertices is large enough for a net that chooses `count` samples."""
    return n >= FINER * NET * coarse_samples(count, first)


class _Slabs:
    """Slabs along the longest axis, of about equally many vertices.

    Attributes
    ----------
    slab : (n,) uint8
        Slab of each vertex.
    vertices : list of (s,) int32
        Vertices of each slab, in ascending order.
    """

    def __init__(self, V: np.ndarray) -> None:
        few = V[:: max(1, len(V) // 10_000)]
        axis = int(np.argmax(np.ptp(few, axis=0)))
        planes = np.quantile(few[:, axis], np.arange(1, SLABS) / SLABS)
        self.slab = np.empty(len(V), dtype=np.uint8)

        def assign(begin: int, end: int) -> None:
            self.slab[begin:end] = np.searchsorted(planes, V[begin:end, axis])

        in_ranges(assign, len(V))
        start, order = sort_by_id(self.slab, SLABS)
        self.vertices = np.split(order, start[1:-1])

    def inside(self, state: advance.State, slab: int) -> advance.State:
        """Return the state for fronts confined to a slab."""
        return state.within(self.slab, slab, len(self.vertices[slab]))

    def among(self, vertices: np.ndarray, slab: int) -> np.ndarray:
        """Return the positions (a,) int64 in `vertices` of those in a slab."""
        return np.flatnonzero(self.slab[vertices] == slab)


def _net(
    graph: VertexGraph, slabs: _Slabs, team: ThreadTeam, first: np.ndarray, *, area: float, count: int
) -> tuple[list[np.ndarray], advance.State]:
    """Choose a net of about `count` vertices on a surface of an area, among them `first`.

    Returns the vertices of the net in each slab, and the state with their cells, numbered within each slab.
    Across the border of two slabs, vertices of the net may be nearer to each other than the radius.
    """
    radius, least = float(np.sqrt(_NET_AREA * area / count)), min(graph.n, _ENOUGH * count)
    while True:
        distance, cell = np.full(graph.n, radius), np.full(graph.n, -1, dtype=np.int32)
        state = advance.State.of(graph, width=radius, distance=distance, cell=cell)

        def cover(slab: int, state: advance.State = state) -> np.ndarray:
            few = first[slabs.among(first, slab)].astype(np.int32)
            return advance.cover(slabs.inside(state, slab), slabs.vertices[slab], few)

        net = team(cover, SLABS)
        if sum(map(len, net)) >= least:
            return net, state
        radius /= 2  # a crumpled surface has short distances for its area


def _coarse_graph(
    graph: VertexGraph, slabs: _Slabs, team: ThreadTeam, state: advance.State, net: list[np.ndarray]
) -> tuple[VertexGraph, list[np.ndarray]]:
    """Return the graph of a net, and for each slab its vertices with neighbours in other slabs.

    Renumbers the cells in `state` so that they count on from slab to slab.
    """
    ends = np.cumsum([0, *map(len, net)])
    cell, distance = state.cell, state.distance

    def gather(slab: int) -> tuple[np.ndarray, np.ndarray]:
        vertices = slabs.vertices[slab]
        begin, order = sort_by_id(cell[vertices], len(net[slab]))
        cell[vertices] += np.int32(ends[slab])
        return begin, vertices[order]

    gathered = team(gather, SLABS)

    def join(slab: int) -> tuple[np.ndarray, ...]:
        rows = graph.indptr, graph.indices, graph.lengths
        return _join(*gathered[slab], *rows, cell, distance, ends[slab], int(ends[-1]))

    *rows, borders = zip(*team(join, SLABS), strict=True)
    size, indices, lengths = map(np.concatenate, rows)
    indptr = np.concatenate([[0], np.cumsum(size)]).astype(np.int32)
    joined = csr_array((lengths, indices, indptr), shape=(ends[-1], ends[-1]))
    joined.sort_indices()
    return VertexGraph(indptr, joined.indices, joined.data, np.zeros(len(indices), dtype=bool)), list(borders)


def _sweep(
    slabs: _Slabs, team: ThreadTeam, state: advance.State, samples: np.ndarray, borders: list[np.ndarray]
) -> None:
    """Advance fronts from samples on the mesh until no vertex gets nearer."""

    def insert(slab: int) -> None:
        number = slabs.among(samples, slab)
        advance.insert(slabs.inside(state, slab), samples[number], number)

    team(insert, SLABS)
    while True:
        reached = team(lambda slab: advance.from_outside(state, borders[slab]), SLABS)
        if not any(len(vertices) for vertices, _, _ in reached):
            return

        def resume(slab: int, reached: list[tuple[np.ndarray, ...]] = reached) -> None:
            advance.resume(slabs.inside(state, slab), *reached[slab])

        team(resume, SLABS)


@kernel
def _join(begin, member, indptr, indices, lengths, cell, distance, offset, cells):
    """Build the rows of the coarse graph for the k cells of one slab, numbered from `offset` on.

    Returns the number of neighbours of each cell, the neighbours, the lengths to them, and the vertices of
    the slab with a neighbour in another slab.
    """
    k, most = len(begin) - 1, 0
    border, beside = np.empty(len(member), dtype=np.int32), 0
    for u in member:
        most += indptr[u + 1] - indptr[u]
    size, count = np.zeros(k, dtype=np.int64), 0
    to, way = np.empty(most, dtype=np.int32), np.empty(most)
    place = np.full(cells, -1, dtype=np.int64)  # of each neighbouring cell, in the current or an earlier row
    for c in range(k):
        row = count
        for q in range(begin[c], begin[c + 1]):
            u, foreign = member[q], False
            for p in range(indptr[u], indptr[u + 1]):
                other = cell[indices[p]]
                if other == c + offset:
                    continue
                foreign = foreign or other < offset or other >= offset + k
                length = (distance[u] + distance[indices[p]]) + lengths[p]
                if place[other] < row:
                    place[other] = count
                    to[count], way[count] = other, length
                    count += 1
                elif length < way[place[other]]:
                    way[place[other]] = length
            if foreign:
                border[beside] = u
                beside += 1
        size[c] = count - row
    return size, to[:count].copy(), way[:count].copy(), border[:beside].copy()
