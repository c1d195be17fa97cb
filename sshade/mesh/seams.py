"""Seams: where a file gives a surface two vertices at one place, to give each side its texture or normal."""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sshade.mesh.adjacency import sides_by_edge
from sshade.mesh.mesh import Mesh, repeats_vertex


def same_rows(rows: np.ndarray) -> np.ndarray:
    """(k,) int64 ids of the rows of (k, d) float64: equal ones have the same, counted from 0.

    Ids are in the order of their first rows.
    """
    rows = np.ascontiguousarray(rows, dtype=np.float64) + 0.0  # no -0.0, which has other bits than 0.0
    return _same_rows(rows.view(np.uint64))


@njit(cache=True, nogil=True)
def _same_rows(rows):
    """Ids of rows (k, d) of bits, by a hash table that is at most half full."""
    size = 2
    while size < 2 * len(rows):
        size *= 2
    table, ids = np.full(size, -1, dtype=np.int64), np.empty(len(rows), dtype=np.int64)
    count = 0
    for i in range(len(rows)):
        mixed = np.uint64(0x9E3779B97F4A7C15)
        for bits in rows[i]:
            mixed = (mixed ^ bits) * np.uint64(0xBF58476D1CE4E5B9)
            mixed ^= mixed >> np.uint64(29)
        place = np.int64(mixed & np.uint64(size - 1))
        while table[place] >= 0 and (rows[table[place]] != rows[i]).any():
            place = (place + 1) & (size - 1)
        if table[place] < 0:
            table[place], ids[i] = i, count
            count += 1
        else:
            ids[i] = ids[table[place]]
    return ids


def join_seams(mesh: Mesh) -> tuple[Mesh, np.ndarray]:
    """Make one vertex of those that stand twice at exactly one place along matching boundary edges.

    Boundary edges match that join the same two places and run in opposite directions, as the two
    sides of a cut do. A boundary edge without length, as around the pole of a globe made of squares,
    becomes one vertex too. Other vertices at one place, as of parts that touch in a point, stay apart.
    Faces that then repeat a vertex, which have no area, are left out.

    Parameters
    ----------
    mesh : Mesh

    Returns
    -------
    joined : Mesh
        The same object where there is no seam.
    vertex : (n,) int64
        For each vertex of `mesh` its vertex in `joined`.
    """
    if mesh.is_closed:
        return mesh, np.arange(mesh.n)
    # Faces with two corners on the boundary: all that lie at edges which may be on it.
    near = mesh.connectivity.neighbours
    on_boundary = np.zeros(mesh.n, dtype=bool)
    on_boundary[near.indices[near.boundary]] = True
    F = mesh.F[on_boundary[mesh.F].sum(axis=1) >= 2]
    edges = sides_by_edge(F, mesh.n)
    side = edges.side[edges.start[:-1][edges.faces == 1]].astype(np.int64)
    begin, end = F.ravel()[side], F[side // 3, (side + 1) % 3]
    place = np.full(mesh.n, -1)
    rim = np.unique(begin)
    place[rim] = same_rows(mesh.V[rim]) if len(rim) else 0
    forward = place[begin] < place[end]
    low, high = np.where(forward, begin, end), np.where(forward, end, begin)
    _, first, edge = np.unique(place[low] * mesh.n + place[high], return_index=True, return_inverse=True)
    edge = edge.ravel()
    count, ahead = np.bincount(edge), np.bincount(edge, forward)
    point = place[low] == place[high]
    matched = ((ahead > 0) & (ahead < count))[edge] & ~point
    if not (matched | point).any():
        return mesh, np.arange(mesh.n)
    twin = first[edge[matched]]
    links = (
        np.concatenate([low[matched], high[matched], low[point]]),
        np.concatenate([low[twin], high[twin], high[point]]),
    )
    graph = coo_array((np.ones(len(links[0]), dtype=bool), links), shape=(mesh.n, mesh.n))
    _, group = connected_components(graph, directed=False)
    _, first, group = np.unique(group, return_index=True, return_inverse=True)
    kept = np.sort(first)
    vertex = np.searchsorted(kept, first[group.ravel()])
    F = vertex[mesh.F]
    F = F[~repeats_vertex(F)]
    return Mesh(mesh.V[kept], F), vertex
