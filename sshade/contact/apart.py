"""Vertices behind other faces are moved out from there, by a field that is smooth along the surface."""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.mesh import Mesh

#: Vertices with a gap of less than this many margins are held while the patch settles.
HELD = 5.0
#: Rings of vertices around a contact that move along, and averagings of the field.
RINGS, AVERAGINGS = 4, 200
#: Width of the patch that settles, over the size of the contact.
WIDTH = 0.5
#: Squared: a face is across if it was this many times as far at rest. The back of a thin part was not.
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
        """(n,) bool, vertices near the seeds along edges; how near, the largest region of seeds tells."""
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
    surface: Surface, P: np.ndarray, met: np.ndarray, mobility: np.ndarray, *, share: float, margin: float
) -> np.ndarray:
    """Move vertices that are met (n,) bool, and those near them, in P; return which to hold there."""
    mesh, still, ids = surface.mesh, surface.still, np.flatnonzero(met)
    faces = mesh.F[met[mesh.F].any(axis=1)]
    corners = P[faces]
    normals = surface.side * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    at = np.zeros_like(P)
    for corner in range(3):
        np.add.at(at, faces[:, corner], normals)
    rest = mesh.V[faces]
    margin *= float(np.linalg.norm(rest - np.roll(rest, 1, axis=1), axis=2).mean())
    way, lack, part, across = _lacks(P, mesh.V, faces, normals, mobility, ids, at[ids], margin)
    need, pull = np.zeros(mesh.n), np.zeros_like(P)
    need[ids] = part * np.maximum(lack, 0.0)
    pull[ids] = need[ids, None] * way
    for i in np.flatnonzero(still[ids] & (lack > 0)):  # a few handles: what they are behind goes instead
        for corner in faces[across[i]]:
            need[corner] = max(need[corner], lack[i])
            pull[corner] -= lack[i] * way[i]
    _move_smoothly(surface, P, met, share * need, pull)
    held = still | (need > 0)
    held[ids[lack > (1.0 - HELD) * margin]] = True
    return held


def _move_smoothly(
    surface: Surface, P: np.ndarray, met: np.ndarray, need: np.ndarray, pull: np.ndarray
) -> None:
    """Move P by a field at least as long as `need` (n,), along averages of the vectors `pull` (n, 3)."""
    zone = np.flatnonzero(surface.grown(met, RINGS) & ~surface.still)
    near, degree = surface.ones[zone][:, zone], surface.ones[zone].sum(axis=1)
    need, pull = need[zone], pull[zone]
    size, way = need, pull
    for _ in range(AVERAGINGS):
        size = np.maximum(need, near @ size / degree)
        way = pull + near @ way / degree[:, None]
    length = np.linalg.norm(way, axis=1)
    moving = length > 0
    P[zone[moving]] += (size[moving] / length[moving])[:, None] * way[moving]


@njit(cache=True, nogil=True)
def _lacks(P, V, F, normal, mobility, ids, at, margin):
    """How vertices get out from behind the faces across from them.

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
        Gap wanted.

    Returns
    -------
    way : (k, 3) float64
        Unit normal of the nearest face across.
    lack : (k,) float64
        What the gap to it lacks; negative where it is wider, minus infinity where no face is across.
    part : (k,) float64
        How much of that is for the vertex to go, as both it and the face are mobile; 1 where it
        cannot move.
    across : (k,) int64
        That face, or -1.
    """
    way, lack, across = np.zeros((len(ids), 3)), np.full(len(ids), -np.inf), np.full(len(ids), -1)
    part = np.ones(len(ids))
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
            way[i, d] = normal[nearest, d] / size
            gap += way[i, d] * (P[v, d] - centre[nearest, d])
        own = mobility[v]
        other = min(mobility[F[nearest, 0]], mobility[F[nearest, 1]], mobility[F[nearest, 2]])
        part[i] = own / (own + other) if own > 0.0 else 1.0
        lack[i] = margin - gap
        across[i] = nearest
    return way, lack, part, across
