"""Farthest point sampling of large meshes, from coarse to fine and in threads.

The first fronts of farthest point sampling sweep the whole mesh, again and again. Here they sweep a coarse
graph: of a net, vertices such that none is within a radius of another and all others are within it of
one. Two of the net are joined where their Voronoi cells meet, by the shortest way from one to the
other over an edge between the cells. The first half of the samples are its farthest points; then
fronts from all of them advance on the mesh itself, where each goes only as far as the coarse graph
has none that is nearer; and the other half is inserted there, each the vertex farthest from all. So cells
and distances are exact, and the half of the samples that decides on the spacing is chosen by exact distances.

Threads share the mesh by slabs along its longest axis. Fronts advance within slabs; then each slab takes
over what is nearer through an edge from another, until none finds anything. Distances are the one fixed
point of that, with ties to the smaller sample: neither the slabs' order nor the number of threads changes a
bit.

Coarse graphs of Voronoi cells: R. Wiersma, A. Nasikun, E. Eisemann, K. Hildebrandt, "A fast geometric
multigrid method for curved surfaces", 2023.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.sparse import csr_array

from sshade.mesh.adjacency import VertexGraph
from sshade.mesh.mesh import Mesh
from sshade.sampling import advance
from sshade.sampling.fronts import Fronts, band, farthest_point_sampling
from sshade.threads import ThreadTeam, available_cpus, in_ranges

#: Share of the samples that come from the coarse graph, and vertices of the net for each of these.
SHARE, NET = 0.5, 16
#: Vertices of a large mesh, at least, and those over the vertices of the net: from there on this pays.
LARGE, FINER = 300_000, 8
#: Slabs: more than most machines have cores, and few enough that little of the mesh lies at their borders.
SLABS = 32
#: Area that a net's vertex has, over its radius squared, of nets whose vertices are taken in any order.
_NET_AREA = 0.8
#: Share of the vertices that it should have from which on a net is fine enough.
_ENOUGH = 0.25
#: Above rounding: sums of lengths in another order stay under this times the sum.
_ROUNDING = 1 + 1e-9


def sample(mesh: Mesh, graph: VertexGraph, count: int, *, first: np.ndarray) -> Fronts:
    """Sample the farthest vertices, beginning with `first`; of large meshes from coarse to fine.

    Parameters
    ----------
    mesh : Mesh
        Its positions and area tell how to share it out, not how far things are.
    graph : VertexGraph
        Of the mesh; its lengths may be others.
    count : int
    first : (h,) int

    Raises
    ------
    InputError
        See :func:`sshade.sampling.fronts.farthest_point_sampling`.
    """
    if graph.n < max(LARGE, FINER * NET * _coarsely(count, first)):
        return farthest_point_sampling(graph, count, first=first)
    return sample_coarsely(mesh, graph, count, first=first)


def sample_coarsely(mesh: Mesh, graph: VertexGraph, count: int, *, first: np.ndarray) -> Fronts:
    """As :func:`sample`, from coarse to fine whatever the size; `count` is that of `first` at least."""
    coarsely = _coarsely(count, first)
    slabs = _Slabs(mesh.V)
    with ThreadTeam(available_cpus()) as team:
        net, state = _net(
            graph,
            slabs,
            team,
            first,
            radius=float(np.sqrt(_NET_AREA * mesh.area / (NET * coarsely))),
            least=min(graph.n, _ENOUGH * NET * coarsely),
        )
        coarse, borders = _coarse_graph(graph, slabs, team, state, net)
        sampled = farthest_point_sampling(coarse, coarsely, first=state.cell[first])
        samples = np.concatenate(net)[sampled.samples]
        state = state._replace(width=band(graph))
        _bound(state, sampled.distance)
        _sweep(slabs, team, state, samples, borders)
    fronts = Fronts.advanced(graph, samples, state)
    fronts.insert_farthest(count - coarsely)
    return fronts


def _coarsely(count: int, first: np.ndarray) -> int:
    """How many samples come from the coarse graph."""
    return max(len(first), round(SHARE * count))


class _Slabs:
    """Slabs of about as many vertices each.

    Attributes
    ----------
    slab : (n,) uint8
        Of each vertex.
    vertices : list of (s,) int32
        Of each slab, in ascending order.
    """

    def __init__(self, V: np.ndarray) -> None:
        few = V[:: max(1, len(V) // 10_000)]
        axis = int(np.argmax(np.ptp(few, axis=0)))
        planes = np.quantile(few[:, axis], np.arange(1, SLABS) / SLABS)
        self.slab = np.empty(len(V), dtype=np.uint8)

        def assign(begin: int, end: int) -> np.ndarray:
            self.slab[begin:end] = np.searchsorted(planes, V[begin:end, axis])
            return np.bincount(self.slab[begin:end], minlength=SLABS)

        ends = np.cumsum(np.sum(in_ranges(assign, len(V)), axis=0))
        self.vertices = np.split(_sorted(self.slab, ends), ends[:-1])

    def inside(self, state: advance.State, own: int) -> advance.State:
        """The state for fronts that stay in a slab."""
        return state.within(self.slab, own, len(self.vertices[own]))

    def among(self, vertices: np.ndarray, own: int) -> np.ndarray:
        """(a,) int64 places of those of some vertices that are in a slab."""
        return np.flatnonzero(self.slab[vertices] == own)


def _net(
    graph: VertexGraph,
    slabs: _Slabs,
    team: ThreadTeam,
    first: np.ndarray,
    *,
    radius: float,
    least: float,
) -> tuple[list[np.ndarray], advance.State]:
    """A net of `least` vertices at least, by slab, and the state with their cells, numbered on over slabs.

    The `first` ones are of it; on both sides of a border vertices of it may be nearer than the radius.
    """
    while True:
        distance, cell = np.full(graph.n, radius), np.full(graph.n, -1, dtype=np.int32)
        state = advance.State.of(graph, width=radius, distance=distance, cell=cell)

        def cover(own: int, state: advance.State = state) -> np.ndarray:
            few = first[slabs.among(first, own)].astype(np.int32)
            return advance.cover(slabs.inside(state, own), slabs.vertices[own], few)

        net = team(cover, SLABS)
        if sum(map(len, net)) >= least:
            return net, state
        radius /= 2  # the surface is crumpled: its distances are small for its area


def _coarse_graph(
    graph: VertexGraph, slabs: _Slabs, team: ThreadTeam, state: advance.State, net: list[np.ndarray]
) -> tuple[VertexGraph, list[np.ndarray]]:
    """The graph of a net, and for each slab its vertices beside others.

    The cells in `state` are numbered through on the way.
    """
    ends = np.cumsum([0, *map(len, net)])
    cell, distance = state.cell, state.distance

    def gather(own: int) -> tuple[np.ndarray, np.ndarray]:
        return _gather(slabs.vertices[own], cell, ends[own], len(net[own]))

    gathered = team(gather, SLABS)

    def join(own: int) -> tuple[np.ndarray, ...]:
        rows = graph.indptr, graph.indices, graph.lengths
        return _join(*gathered[own], *rows, cell, distance, ends[own], int(ends[-1]))

    *rows, borders = zip(*team(join, SLABS), strict=True)
    size, indices, lengths = map(np.concatenate, rows)
    indptr = np.concatenate([[0], np.cumsum(size)]).astype(np.int32)
    joined = csr_array((lengths, indices, indptr), shape=(ends[-1], ends[-1]))
    joined.sort_indices()
    return VertexGraph(indptr, joined.indices, joined.data, np.zeros(len(indices), dtype=bool)), list(borders)


def _bound(state: advance.State, coarse: np.ndarray) -> None:
    """Turn distances to the net into bounds above those to samples; `coarse` are those from it to samples."""

    def add(begin: int, end: int) -> None:
        state.distance[begin:end] += coarse[state.cell[begin:end]]
        state.distance[begin:end] *= _ROUNDING
        state.cell[begin:end] = -1

    in_ranges(add, len(state.distance))


def _sweep(
    slabs: _Slabs,
    team: ThreadTeam,
    state: advance.State,
    samples: np.ndarray,
    borders: list[np.ndarray],
) -> None:
    """Let the fronts of samples advance until none is nearer anywhere."""

    def insert(own: int) -> None:
        number = slabs.among(samples, own)
        advance.insert(slabs.inside(state, own), samples[number], number)

    team(insert, SLABS)
    while True:
        reached = team(lambda own: advance.from_outside(state, borders[own]), SLABS)
        if not any(len(vertices) for vertices, _, _ in reached):
            return

        def resume(own: int, reached: list[tuple[np.ndarray, ...]] = reached) -> None:
            advance.resume(slabs.inside(state, own), *reached[own])

        team(resume, SLABS)


@njit(cache=True, nogil=True)
def _sorted(slab, ends):
    """(n,) int32 vertices by slab, in ascending order in each."""
    vertices, place = np.empty(len(slab), dtype=np.int32), ends.copy()
    for v in range(len(slab) - 1, -1, -1):
        place[slab[v]] -= 1
        vertices[place[slab[v]]] = v
    return vertices


@njit(cache=True, nogil=True)
def _gather(vertices, cell, offset, k):
    """Where the vertices of each of k cells begin, (k + 1,), and these; raise the cells' numbers."""
    begin, member = np.zeros(k + 1, dtype=np.int64), np.empty(len(vertices), dtype=np.int32)
    for v in vertices:
        begin[cell[v] + 1] += 1
    for c in range(k):
        begin[c + 1] += begin[c]
    fill = begin[:-1].copy()
    for v in vertices:
        member[fill[cell[v]]] = v
        fill[cell[v]] += 1
        cell[v] += offset
    return begin, member


@njit(cache=True, nogil=True)
def _join(begin, member, indptr, indices, lengths, cell, distance, offset, cells):
    """Rows of the coarse graph: the number of neighbours of each cell, these, and the ways to them.

    Also the vertices beside cells of another slab.
    """
    k, most = len(begin) - 1, 0
    border, beside = np.empty(len(member), dtype=np.int32), 0
    for c in range(k):
        row = 0
        for q in range(begin[c], begin[c + 1]):
            row += indptr[member[q] + 1] - indptr[member[q]]
        most = max(most, row)
    size, count = np.zeros(k, dtype=np.int64), 0
    to, way = np.empty(most + 16 * k, dtype=np.int32), np.empty(most + 16 * k)
    place = np.full(cells, -1, dtype=np.int64)  # of each neighbour, in the row at work or an earlier one
    for c in range(k):
        if count + most > len(to):
            to, way = np.concatenate((to, to)), np.concatenate((way, way))
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
