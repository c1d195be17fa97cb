"""Places at which several vertices lie: copies of one vertex, fans that meet in a point, parts that touch."""

from __future__ import annotations

from collections.abc import Callable
from weakref import WeakKeyDictionary

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sshade.core.kernels import kernel
from sshade.mesh.incidence import flagged
from sshade.mesh.mesh import Mesh, repeats_vertex
from sshade.mesh.weld import COPY

#: Largest width of a group of near positions, as a multiple of the tolerance. A wider chain of positions is
#: no vertex, but an edge with vertices closer together than the tolerance.
WIDEST = 4.0
#: Largest mean number of positions near a position. In a denser mesh, near positions are no copies.
CROWD = 64
#: Largest distance of touching vertices from their place, as a fraction of the bounding-box diagonal.
TOUCHING = 1e-6


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


def same_places(
    P: np.ndarray, tolerance: np.ndarray, *, reach: Callable[[np.ndarray], np.ndarray] | None = None
) -> np.ndarray:
    """Return (k,) int64 ids of positions P (k, 3), such that copies of one place have the same id.

    Copies differ from their place by at most the tolerance (3,) on each axis. Without a tolerance, copies are
    equal. Chains of near positions that are wider than :data:`WIDEST` tolerances are no copies.

    Parameters
    ----------
    P : (k, 3) float64
    tolerance : (3,) float64
    reach : callable, optional
        ``reach(rows)`` returns how far other copies of some rows (r,) of P may be from them, (r,) float64.
    """
    ids = same_rows(P)
    if not (len(P) and tolerance.all()):
        return ids
    from scipy.spatial import cKDTree

    _, first = np.unique(ids, return_index=True)
    Q = (P[first] - P.min(axis=0)) / tolerance
    tree, radius = cKDTree(Q), 2 * (1 + 1e-6)  # two copies on different sides of their place; and rounding
    if tree.count_neighbors(tree, radius, p=np.inf) > CROWD * len(Q):
        return ids
    pairs = tree.query_pairs(radius, p=np.inf, output_type="ndarray")
    if reach is not None and len(pairs):
        rows = np.flatnonzero(flagged(pairs, len(Q))[ids])
        far = np.full(len(Q), np.inf)
        np.minimum.at(far, ids[rows], reach(rows))
        apart = np.linalg.norm(P[first[pairs[:, 0]]] - P[first[pairs[:, 1]]], axis=1)
        pairs = pairs[apart <= far[pairs].min(axis=1)]
    if not len(pairs):
        return ids
    group = connected(len(Q), pairs[:, 0], pairs[:, 1])
    low, high = np.full((2, len(Q), 3), [[[np.inf]], [[-np.inf]]])
    np.minimum.at(low, group, Q)
    np.maximum.at(high, group, Q)
    wide = (high[group] - low[group] > WIDEST * (1 + 1e-6)).any(axis=1)
    group[wide] = np.flatnonzero(wide)
    return group[ids]


def connected(n: int, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return (n,) int64: the least number of each group that pairs `one` (k,) and `other` (k,) link."""
    graph = coo_array((np.ones(len(one), dtype=bool), (one, other)), shape=(n, n))
    _, group = connected_components(graph, directed=False)
    _, first, group = np.unique(group, return_index=True, return_inverse=True)
    return first[group.ravel()]


def vertex_places(
    mesh: Mesh, tolerance: np.ndarray, vertices: np.ndarray | slice = slice(None)
) -> np.ndarray:
    """Return (k,) int64 ids of vertices (k,) of a mesh, such that copies of one place have the same id.

    Copies are near each other, and far nearer than to any neighbour: see :data:`sshade.mesh.weld.COPY`. No
    face with an area therefore has two corners at one place.
    """
    ids = np.arange(mesh.n)[vertices]
    return same_places(
        mesh.V[vertices], tolerance, reach=lambda rows: COPY * _shortest_edges(mesh, ids[rows])
    )


def _shortest_edges(mesh: Mesh, vertices: np.ndarray) -> np.ndarray:
    """Return the length (k,) of the shortest edge at some vertices (k,); edges of length 0 are none."""
    at, other = _neighbours(mesh, vertices)
    length = np.linalg.norm(mesh.V[vertices[at]] - mesh.V[other], axis=1)
    shortest = np.full(len(vertices), np.inf)
    np.minimum.at(shortest, at, np.where(length > 0, length, np.inf))
    return shortest


def _neighbours(mesh: Mesh, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the places (e,) of vertices (k,) in their list, once a neighbour, and the neighbours (e,)."""
    near = mesh.connectivity.neighbours
    begin, count = near.indptr[vertices], np.diff(near.indptr)[vertices]
    at = np.repeat(np.arange(len(vertices)), count)
    rank = np.arange(len(at)) - np.repeat(np.cumsum(count) - count, count)
    return at, near.indices[begin[at] + rank]


def pinches(mesh: Mesh, part: np.ndarray) -> np.ndarray:
    """Find vertices at exactly one place in which a part touches itself: fans that meet in a point.

    Vertices stay apart where the part touches itself along an edge, as closed lips do.

    Parameters
    ----------
    mesh : Mesh
    part : (n,) int
        Part of each vertex, such as its component.

    Returns
    -------
    (n,) int64
        The first of the vertices at the place of each vertex, often the vertex itself.
    """
    first, place = np.arange(mesh.n), same_rows(mesh.V)
    vertices = np.flatnonzero(np.bincount(place)[place] > 1)
    if not len(vertices):
        return first
    pairs = np.column_stack([place, part])[vertices]
    _, one, group = np.unique(pairs, axis=0, return_index=True, return_inverse=True)
    at, other = _neighbours(mesh, vertices)
    # Neighbours at one place, of different vertices of a group, or at the place of the group.
    beside = np.unique(np.column_stack([group.ravel()[at], place[other], at]), axis=0)
    twice = (beside[1:, :2] == beside[:-1, :2]).all(axis=1)
    along = np.concatenate([beside[1:][twice, 0], group.ravel()[at[place[other] == place[vertices[at]]]]])
    in_point = ~flagged(along, len(one))[group.ravel()]
    first[vertices[in_point]] = vertices[one[group.ravel()]][in_point]
    return with_faces(mesh, first)


def touching(mesh: Mesh, distance: float) -> np.ndarray:
    """Find vertices at which a component touches itself, and is not joined.

    Parameters
    ----------
    mesh : Mesh
    distance : float
        Largest distance of boundary vertices from their place; others are at exactly one place.

    Returns
    -------
    (2, k) int64
        Vertices, and the first vertex at the place of each. No edge joins the two.
    """
    place = same_rows(mesh.V)
    vertices = np.flatnonzero(on_boundary(mesh) | (np.bincount(place)[place] > 1))
    if not len(vertices):
        return np.zeros((2, 0), dtype=np.int64)
    place = vertex_places(mesh, np.full(3, distance), vertices)
    group = same_rows(np.column_stack([place, mesh.component[vertices]]))
    first = vertices[first_at_label(group)]
    apart = first != vertices
    vertices, first = vertices[apart], first[apart]
    at, other = _neighbours(mesh, vertices)
    joined = flagged(at[other == first[at]], len(vertices))
    return np.stack([vertices, first])[:, ~joined]


#: Vertices of one component that touch in each mesh, for further poses of the mesh.
_TOUCHING: WeakKeyDictionary[Mesh, np.ndarray] = WeakKeyDictionary()


def opening_within(mesh: Mesh, V: np.ndarray) -> float:
    """Return the largest distance, at positions V (n, 3), of vertices of one component that touch at rest."""
    if mesh not in _TOUCHING:
        _TOUCHING[mesh] = touching(mesh, TOUCHING * mesh.diagonal)
    one, other = _TOUCHING[mesh]
    return float(np.linalg.norm(V[one] - V[other], axis=1).max(initial=0.0))


def first_at_label(labels: np.ndarray) -> np.ndarray:
    """Return the first position (k,) at which each of some labels (k,) occurs."""
    _, first, which = np.unique(labels, return_index=True, return_inverse=True)
    return first[which.ravel()]


def on_boundary(mesh: Mesh) -> np.ndarray:
    """Return (n,) bool: vertices with a boundary edge."""
    near = mesh.connectivity.neighbours
    return np.bincount(near.indices[near.boundary], minlength=mesh.n) > 0


def with_faces(mesh: Mesh, first: np.ndarray) -> np.ndarray:
    """Leave out groups of vertices (n,) whose merging takes the last face of a vertex, as of a sliver."""
    first = first.copy()
    while True:
        F = first[mesh.F]
        lost = ~flagged(F[~repeats_vertex(F)], mesh.n)[F]
        if not lost.any():
            return first
        apart = np.flatnonzero(flagged(F[lost.any(axis=1)], mesh.n)[first])
        first[apart] = apart
