"""Seams: places where a file stores a surface point twice, to give each side its own texture or normal."""

from __future__ import annotations

import numpy as np

from sshade.mesh.incidence import sides_by_edge
from sshade.mesh.mesh import Mesh, unit_rows
from sshade.mesh.places import connected, on_boundary, vertex_places, with_faces

#: Cosine above which two faces at one edge lie upon each other, and do not continue each other.
UPON = 0.999


def seams(mesh: Mesh, tolerance: np.ndarray) -> np.ndarray:
    """Find vertices at one place that matching boundary edges join.

    Two boundary edges match if they join the same two places and run in opposite directions, like the two
    sides of a cut. Without a third boundary edge between the places, the two edges may run in the same
    direction, as where a file has turned some faces, unless the two faces lie upon each other. The two ends
    of a boundary edge at one place, as around the pole of a globe made of squares, are joined too. For other
    vertices at one place, see :func:`sshade.mesh.places.pinches`.

    Parameters
    ----------
    mesh : Mesh
    tolerance : (3,) float64
        See :func:`sshade.mesh.places.vertex_places`.

    Returns
    -------
    (n,) int64
        The first of the vertices that are joined with each vertex, often the vertex itself.
    """
    unchanged = np.arange(mesh.n)
    if mesh.is_closed:
        return unchanged
    # Faces with two corners on the boundary include all faces at boundary edges.
    F = mesh.F[on_boundary(mesh)[mesh.F].sum(axis=1) >= 2]
    edges = sides_by_edge(F, mesh.n)
    side = edges.side[edges.start[:-1][edges.faces == 1]].astype(np.int64)
    begin, end, third = (F[side // 3, (side + k) % 3] for k in range(3))
    place, rim = np.full(mesh.n, -1), np.unique([begin, end])
    place[rim] = vertex_places(mesh, tolerance, rim)
    forward = place[begin] < place[end]
    low, high = np.where(forward, begin, end), np.where(forward, end, begin)
    _, first, edge = np.unique(place[low] * mesh.n + place[high], return_index=True, return_inverse=True)
    edge = edge.ravel()
    count, ahead = np.bincount(edge), np.bincount(edge, forward)
    point = place[low] == place[high]
    matches = (ahead > 0) & (ahead < count)
    turned = np.flatnonzero((count == 2) & ~matches & ~point[first])
    if len(turned):
        two = np.argsort(edge, kind="stable")[np.cumsum(count)[turned, None] - [2, 1]]
        matches[turned] = ~_upon(mesh.V, begin[two], end[two], third[two], tolerance)
    matched = matches[edge] & ~point
    if not (matched | point).any():
        return unchanged
    twin = first[edge[matched]]
    one = np.concatenate([low[matched], high[matched], low[point]])
    other = np.concatenate([low[twin], high[twin], high[point]])
    return with_faces(mesh, connected(mesh.n, one, other))


def _upon(
    V: np.ndarray, begin: np.ndarray, end: np.ndarray, third: np.ndarray, tolerance: np.ndarray
) -> np.ndarray:
    """Return (k,) bool: pairs of faces at one edge that lie upon each other; corners are (k, 2)."""
    along = unit_rows(V[end[:, 0]] - V[begin[:, 0]])
    away = [V[third[:, i]] - V[begin[:, i]] for i in range(2)]
    away = [unit_rows(x - np.einsum("ki,ki->k", x, along)[:, None] * along) for x in away]
    same = (np.abs(V[third[:, 0]] - V[third[:, 1]]) <= 2 * tolerance).all(axis=1)
    return same | (np.einsum("ki,ki->k", *away) > UPON)
