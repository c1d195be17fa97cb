"""Seams: places where a file stores a surface point twice, to give each side its own texture or normal."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sshade.kernels import kernel
from sshade.mesh.mesh import Mesh, repeats_vertex
from sshade.mesh.sides import sides_by_edge


def same_rows(rows: np.ndarray) -> np.ndarray:
    """Return (k,) int64 ids of rows (k, d) float64, such that equal rows have the same id.

    Ids count from 0 in the order in which the rows first occur. Zeros of both signs are equal.
    """
    rows = np.ascontiguousarray(rows, dtype=np.float64) + 0.0  # turns -0.0 into 0.0, which has other bits
    return _same_rows(rows.view(np.uint64))


@kernel
def _same_rows(rows):
    """Number rows (k, d) of bits with a hash table that is at most half full."""
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
    """Merge vertices at exactly the same position along matching boundary edges.

    Two boundary edges match if they join the same two positions and run in opposite directions, like the
    two sides of a cut. The two ends of a boundary edge of length zero, as around the pole of a globe made
    of squares, are merged too. Other vertices at one position, as of parts that touch in a point, stay
    apart. Faces that repeat a vertex after merging have no area and are left out.

    Returns
    -------
    joined : Mesh
        `mesh` itself if it has no seam.
    vertex : (n,) int64
        Vertex of `joined` for each vertex of `mesh`.
    """
    unchanged = mesh, np.arange(mesh.n)
    if mesh.is_closed:
        return unchanged
    # Faces with two corners on the boundary include all faces at boundary edges.
    near = mesh.connectivity.neighbours
    on_boundary = np.bincount(near.indices[near.boundary], minlength=mesh.n) > 0
    F = mesh.F[on_boundary[mesh.F].sum(axis=1) >= 2]
    edges = sides_by_edge(F, mesh.n)
    side = edges.side[edges.start[:-1][edges.faces == 1]].astype(np.int64)
    begin, end = F.ravel()[side], F[side // 3, (side + 1) % 3]
    place, rim = np.full(mesh.n, -1), np.unique(begin)
    place[rim] = same_rows(mesh.V[rim]) if len(rim) else 0
    forward = place[begin] < place[end]
    low, high = np.where(forward, begin, end), np.where(forward, end, begin)
    _, first, edge = np.unique(place[low] * mesh.n + place[high], return_index=True, return_inverse=True)
    edge = edge.ravel()
    count, ahead = np.bincount(edge), np.bincount(edge, forward)
    point = place[low] == place[high]
    matched = ((ahead > 0) & (ahead < count))[edge] & ~point
    if not (matched | point).any():
        return unchanged
    twin = first[edge[matched]]
    one = np.concatenate([low[matched], high[matched], low[point]])
    other = np.concatenate([low[twin], high[twin], high[point]])
    graph = coo_array((np.ones(len(one), dtype=bool), (one, other)), shape=(mesh.n, mesh.n))
    _, group = connected_components(graph, directed=False)
    _, first, group = np.unique(group, return_index=True, return_inverse=True)
    kept = np.sort(first)
    vertex = np.searchsorted(kept, first[group.ravel()])
    F = vertex[mesh.F]
    return Mesh(mesh.V[kept], F[~repeats_vertex(F)]), vertex
