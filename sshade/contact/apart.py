"""Penetrating vertices, those behind other faces, moved out by a field that is smooth along the surface."""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.mesh import Mesh

#: Vertices with a gap of less than this many margins are held while the patch is relaxed.
HELD = 5.0
#: Rings of vertices around a contact that move along, and averagings of the field.
RINGS, AVERAGINGS = 4, 200
#: Width of the patch that is relaxed, over the size of the contact.
WIDTH = 0.5
#: Squared: a face lies across from a vertex if it was this many times as far from it at rest, which the
#: back of a thin part was not.
ACROSS = 4.0


class Surface:
    """The rest mesh as a graph of its edges, and the vertices that stay."""

    def __init__(self, mesh: Mesh, index: np.ndarray) -> None:
        graph = vertex_graph(mesh)
        self.mesh, self.mean_edge = mesh, float(graph.lengths.mean())
        self.lengths = csr_array((graph.lengths, graph.indices, graph.indptr), shape=(mesh.n, mesh.n))
        self.ones = csr_array(
            (np.ones(len(graph.indices)), graph.indices, graph.indptr), shape=(mesh.n, mesh.n)
        )
        self.still = np.zeros(mesh.n, dtype=bool)
        self.still[index] = True
        #: -1 where normals point inwards.
        self.side = -1.0 if mesh.is_closed and mesh.is_oriented and mesh.volume < 0 else 1.0

    def near(self, seeds: np.ndarray) -> tuple[np.ndarray, float]:
        """(n,) bool, vertices near the seeds along edges, and the distance that counts as near.

        :data:`WIDTH` diameters of the largest region of seeds, and some rings of vertices.
        """
        ids = np.flatnonzero(seeds)
        _, region = connected_components(self.lengths[ids][:, ids], directed=False)
        places = [self.mesh.V[ids[region == r]] for r in range(region.max() + 1)]
        size = 2 * max(float(np.linalg.norm(own - own.mean(axis=0), axis=1).max()) for own in places)
        far = WIDTH * size + (RINGS + 1) * self.mean_edge
        return np.isfinite(self._distance(ids, far)), far

    def mobility(self, far: float) -> np.ndarray:
        """(n,) distance of each vertex from those that stay, at most `far`."""
        return np.minimum(self._distance(np.flatnonzero(self.still), far), far)

    def _distance(self, ids: np.ndarray, far: float) -> np.ndarray:
        return dijkstra(self.lengths, directed=False, indices=ids, min_only=True, limit=far)

    def grown(self, seeds: np.ndarray, rings: int) -> np.ndarray:
        """(n,) bool: the seeds and some rings of neighbours."""
        for _ in range(rings):
            seeds = seeds | (self.ones @ seeds > 0)
        return seeds

    def enclosed(self, seeds: np.ndarray, patch: np.ndarray) -> np.ndarray:
        """(n,) bool: the seeds, and what they cut off from the patch's boundary, or from still vertices."""
        rest = np.flatnonzero(patch & ~seeds)
        result = seeds.copy()
        if len(rest):
            count, region = connected_components(self.lengths[rest][:, rest], directed=False)
            reached = np.zeros(count, dtype=bool)
            outside = self.ones @ ~patch > 0
            if not outside[rest].any():
                outside = self.still
            reached[region[outside[rest]]] = True
            if not reached.any():
                reached[np.bincount(region).argmax()] = True
            result[rest[~reached[region]]] = True
        return result


def move_apart(
    surface: Surface,
    P: np.ndarray,
    penetrating: np.ndarray,
    mobility: np.ndarray,
    *,
    share: float,
    margin: float,
) -> np.ndarray:
    """Move penetrating vertices (n,) bool, and those near them, in P; return (n,) bool, which to hold there.

    Each goes its mobility share of `share` times its penetration depth.
    """
    mesh, still, ids = surface.mesh, surface.still, np.flatnonzero(penetrating)
    faces = mesh.F[penetrating[mesh.F].any(axis=1)]
    corners = P[faces]
    normals = surface.side * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    at = np.zeros_like(P)
    for corner in range(3):
        np.add.at(at, faces[:, corner], normals)
    rest = mesh.V[faces]
    margin *= float(np.linalg.norm(rest - np.roll(rest, 1, axis=1), axis=2).mean())
    direction, depth, mobile_share, across = _penetrations(
        P, mesh.V, faces, normals, mobility, ids, at[ids], margin
    )
    distance, pull = np.zeros(mesh.n), np.zeros_like(P)
    distance[ids] = mobile_share * np.maximum(depth, 0.0)
    pull[ids] = distance[ids, None] * direction
    for i in np.flatnonzero(still[ids] & (depth > 0)):  # handles stay: the face across moves back
        for corner in faces[across[i]]:
            distance[corner] = max(distance[corner], depth[i])
            pull[corner] -= depth[i] * direction[i]
    _move_smoothly(surface, P, penetrating, share * distance, pull)
    held = still | (distance > 0)
    held[ids[depth > (1.0 - HELD) * margin]] = True
    return held


def _move_smoothly(
    surface: Surface, P: np.ndarray, penetrating: np.ndarray, distance: np.ndarray, pull: np.ndarray
) -> None:
    """Move P by a smooth field, at least as long as `distance` (n,), along averages of `pull` (n, 3)."""
    zone = np.flatnonzero(surface.grown(penetrating, RINGS) & ~surface.still)
    near, degree = surface.ones[zone][:, zone], surface.ones[zone].sum(axis=1)
    distance, pull = distance[zone], pull[zone]
    size, direction = distance, pull
    for _ in range(AVERAGINGS):
        size = np.maximum(distance, near @ size / degree)
        direction = pull + near @ direction / degree[:, None]
    length = np.linalg.norm(direction, axis=1)
    moving = length > 0
    P[zone[moving]] += (size[moving] / length[moving])[:, None] * direction[moving]


@njit(cache=True, nogil=True)
def _penetrations(P, V, F, normal, mobility, ids, at, margin):
    """How deep vertices penetrate the faces across from them, and which way is out.

    The face across from a vertex is the nearest one of those that face it (the product of the normals is
    negative) and had more than :data:`ACROSS` times the squared distance at rest.

    Parameters
    ----------
    P, V : (n, 3) float64
        Deformed and rest positions.
    F : (m, 3) int64
        Faces that may be across, with normals `normal` (m, 3) of any length.
    mobility : (n,) float64
        Of each vertex; 0 where it cannot move.
    ids : (k,) int64
        The vertices, with normals `at` (k, 3).
    margin : float
        Gap wanted, in the unit of length.

    Returns
    -------
    direction : (k, 3) float64
        Unit normal of the nearest face across.
    depth : (k,) float64
        Penetration depth: the margin less the signed gap to that face's plane through its centre;
        minus infinity where no face is across.
    mobile_share : (k,) float64
        m / (m + m_t), m the mobility of the vertex and m_t the least one of the face's corners; 1 for m = 0.
    across : (k,) int64
        That face, or -1.
    """
    direction, depth, across = np.zeros((len(ids), 3)), np.full(len(ids), -np.inf), np.full(len(ids), -1)
    mobile_share = np.ones(len(ids))
    centre = np.empty((len(F), 3))
    for t in range(len(F)):
        for d in range(3):
            centre[t, d] = (P[F[t, 0], d] + P[F[t, 1], d] + P[F[t, 2], d]) / 3.0
    for i in range(len(ids)):
        v = ids[i]
        least, nearest = np.inf, -1
        for t in range(len(F)):
            dx, dy, dz = P[v, 0] - centre[t, 0], P[v, 1] - centre[t, 1], P[v, 2] - centre[t, 2]
            square = dx * dx + dy * dy + dz * dz
            if square >= least or v in (F[t, 0], F[t, 1], F[t, 2]):
                continue
            if normal[t, 0] * at[i, 0] + normal[t, 1] * at[i, 1] + normal[t, 2] * at[i, 2] >= 0.0:
                continue
            rest = np.inf
            for corner in range(3):
                c = F[t, corner]
                dx, dy, dz = V[v, 0] - V[c, 0], V[v, 1] - V[c, 1], V[v, 2] - V[c, 2]
                rest = min(rest, dx * dx + dy * dy + dz * dz)
            if rest > ACROSS * square:
                least, nearest = square, t
        if nearest < 0:
            continue
        size = np.sqrt(normal[nearest, 0] ** 2 + normal[nearest, 1] ** 2 + normal[nearest, 2] ** 2)
        gap = 0.0
        for d in range(3):
            direction[i, d] = normal[nearest, d] / size
            gap += direction[i, d] * (P[v, d] - centre[nearest, d])
        own = mobility[v]
        other = min(mobility[F[nearest, 0]], mobility[F[nearest, 1]], mobility[F[nearest, 2]])
        mobile_share[i] = own / (own + other) if own > 0.0 else 1.0
        depth[i] = margin - gap
        across[i] = nearest
    return direction, depth, mobile_share, across
