"""Parts of a deformed surface that run through each other are led apart.

No energy of the shape alone keeps a chin out of a chest. Where faces cross that
did not at rest, the vertices behind the other side are moved out, half of the
way each, by a field that is smooth along the surface; handles stay, and what
meets them goes the whole way. The sides are held there while the energy of a
patch around them settles. A few rounds of that, and nothing crosses.

Which vertices those are, the crossing faces tell: they are loops that cut the
part inside the other side off from the rest of the surface (cf. D. Baraff,
A. Witkin, M. Kass, "Untangling cloth", ACM TOG 22(3), 2003). What no move
untangles, a fan folded over itself, is smoothed out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from sshade.errors import InputError
from sshade.flips import new_flips
from sshade.graph import vertex_graph
from sshade.intersections import new_crossings
from sshade.linalg import Engine
from sshade.local_global import LocalGlobal
from sshade.mesh import Mesh
from sshade.task import Progress, silent

#: Gap between separated sides by default, over the mean edge around the contact.
MARGIN = 0.25
#: Vertices with a gap of less than this many margins are held while the patch settles.
HELD = 5.0
#: How much farther than needed vertices move: the one to begin with, others where a round did not help.
SHARES = 1.3, 1.0
#: Where no move helps, so many attempts to smooth out: the faces alone, then two more rings each time.
PINCH = 5
#: So many faces are few, and every one less counts. Of more, no more than this share may be left.
FEW, WORTH = 100, 0.97
#: Rings of vertices around a contact that move along, and averagings of the field.
RINGS, AVERAGINGS = 4, 200
#: Width of the patch that settles, over the size of the contact, and its iterations.
WIDTH, ITERATIONS = 0.5, 30
#: Squared: a face is across if it was this many times as far at rest. The back of a thin part was not.
ACROSS = 4.0


class Separated(NamedTuple):
    """A shape with fewer intersections, and how it came about.

    Attributes
    ----------
    positions : (n, 3) float64
    before, after : int
        Faces that cross others, or oppose their neighbours, and did not at rest.
    rounds : int
    met : (n,) bool
        Vertices that were behind others in some round.
    """

    positions: np.ndarray
    before: int
    after: int
    rounds: int
    met: np.ndarray


def separate(
    mesh: Mesh,
    positions: np.ndarray,
    index: np.ndarray,
    *,
    met: np.ndarray | None = None,
    stiffness: float = 1.0,
    strain: float = 0.02,
    margin: float = MARGIN,
    rounds: int = 16,
    engine: Engine = "auto",
    workers: int = 1,
    progress: Progress = silent,
) -> Separated:
    """Lead apart what crosses in a deformed shape, and unfold what is flipped, unless it was so at rest.

    Parameters
    ----------
    mesh : Mesh
        Rest shape; manifold.
    positions : (n, 3) float64
    index : (k,) int
        Vertices that stay, the handles.
    met : (n,) bool, optional
        Of an earlier call: they are held apart from the first round on.
    stiffness, strain
        How the triangles of the patch soften; see :mod:`sshade.softening`.
    margin : float
        Gap between separated sides, over the mean edge around the contact.
    rounds : int
        At most.
    engine : {"auto", "superlu", "cholespy"}
        See :func:`sshade.linalg.factor`.
    workers : int
        Threads that look for crossings; no influence on the result.
    progress : Progress

    Returns
    -------
    Separated
        The positions of the round with the fewest such faces; those given if no round helps.

    Raises
    ------
    InputError
        On positions of another shape, or not finite, or a mesh that is not manifold.
    """
    positions = np.asarray(positions, dtype=np.float64)
    if positions.shape != mesh.V.shape or not np.isfinite(positions).all():
        raise InputError(f"the positions must be finite and of shape ({mesh.n}, 3)")
    tangled = _tangled(mesh, positions, workers=workers)
    before = int(tangled.sum())
    met = np.zeros(mesh.n, dtype=bool) if met is None else met
    if before == 0:
        return Separated(positions.copy(), 0, 0, 0, met)
    surface, done, failed, best = _Surface(mesh, index), 0, 0, positions
    while tangled.any() and done < rounds and failed < len(SHARES) + PINCH * (tangled.sum() <= FEW):
        progress("contact", done, rounds, f"{int(tangled.sum())} faces cross or flip")
        seeds = np.zeros(mesh.n, dtype=bool)
        seeds[mesh.F[tangled]] = True
        P = best.copy()
        patch = surface.near(seeds | met)
        behind = surface.enclosed(seeds, patch) | (met if failed == 0 else False)
        if failed < len(SHARES):
            held = _move_apart(surface, P, behind, share=SHARES[failed], margin=margin)
            shapes = [_settled(surface, P, patch, held, stiffness=stiffness, strain=strain, engine=engine), P]
        else:
            _smooth_out(surface, P, surface.grown(seeds, 2 * (failed - len(SHARES))))
            shapes = [P]
        done, failed = done + 1, failed + 1
        now = np.ones(mesh.m, dtype=bool)
        for shape in shapes:  # what settles may cross again: then better not
            moved = np.any(best != shape, axis=1)[mesh.F].any(axis=1)
            found = _tangled(mesh, shape, among=moved | tangled, workers=workers)
            if found.sum() < now.sum():
                P, now = shape, found
            if not now.any():
                break
        if now.sum() < tangled.sum() * (1.0 if tangled.sum() <= FEW else WORTH):
            best, met, tangled, failed = P, met | behind, now, 0
    progress("contact", rounds, rounds, f"{int(tangled.sum())} faces cross or flip")
    return Separated(best.copy(), before, int(tangled.sum()), done, met)


def _tangled(mesh: Mesh, P: np.ndarray, *, among: np.ndarray | None = None, workers: int = 1) -> np.ndarray:
    """(m,) bool: faces that cross others `among` (m,) or are flipped at P and were not at rest."""
    return new_crossings(mesh, P, among=among, workers=workers) | new_flips(mesh, P)


class _Surface:
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

    def near(self, seeds: np.ndarray) -> np.ndarray:
        """(n,) bool: vertices as near to the seeds, along edges, as the largest region of seeds tells."""
        ids = np.flatnonzero(seeds)
        _, region = connected_components(self.lengths[ids][:, ids], directed=False)
        places = [self.mesh.V[ids[region == r]] for r in range(region.max() + 1)]
        size = 2 * max(float(np.linalg.norm(own - own.mean(axis=0), axis=1).max()) for own in places)
        far = WIDTH * size + (RINGS + 1) * self.mean_edge
        return np.isfinite(dijkstra(self.lengths, directed=False, indices=ids, min_only=True, limit=far))

    def grown(self, seeds: np.ndarray, rings: int) -> np.ndarray:
        """(n,) bool: the seeds and some rings of neighbours."""
        for _ in range(rings):
            seeds = seeds | (self.ones @ seeds > 0)
        return seeds

    def enclosed(self, seeds: np.ndarray, patch: np.ndarray) -> np.ndarray:
        """(n,) bool: the seeds, and what they cut off from the patch's boundary and from still vertices."""
        rest = np.flatnonzero(patch & ~seeds)
        result = seeds.copy()
        if len(rest):
            count, region = connected_components(self.lengths[rest][:, rest], directed=False)
            reached = np.zeros(count, dtype=bool)
            reached[region[(self.still | (self.ones @ ~patch > 0))[rest]]] = True
            if not reached.any():
                reached[np.bincount(region).argmax()] = True
            result[rest[~reached[region]]] = True
        return result


def _move_apart(
    surface: _Surface, P: np.ndarray, met: np.ndarray, *, share: float, margin: float
) -> np.ndarray:
    """Move vertices that are met (n,) bool, and those near them, in P; return which to hold there."""
    mesh, still, ids = surface.mesh, surface.still, np.flatnonzero(met)
    faces = mesh.F[met[mesh.F].any(axis=1)]
    corners = P[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    at = np.zeros_like(P)
    for corner in range(3):
        np.add.at(at, faces[:, corner], normals)
    rest = mesh.V[faces]
    margin *= float(np.linalg.norm(rest - np.roll(rest, 1, axis=1), axis=2).mean())
    way, lack, across = _lacks(P, mesh.V, faces, normals, still, ids, at[ids], margin)
    need, pull = np.zeros(mesh.n), np.zeros_like(P)
    need[ids] = np.maximum(lack, 0.0)
    pull[ids] = need[ids, None] * way
    for i in np.flatnonzero(still[ids] & (lack > 0)):  # a few handles: what they are behind goes instead
        for corner in faces[across[i]]:
            need[corner] = max(need[corner], lack[i])
            pull[corner] -= lack[i] * way[i]
    _move_smoothly(surface, P, met, share * need, pull)
    held = still | (need > 0)
    held[ids[2.0 * lack > (1.0 - HELD) * margin]] = True
    return held


def _move_smoothly(
    surface: _Surface, P: np.ndarray, met: np.ndarray, need: np.ndarray, pull: np.ndarray
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


def _smooth_out(surface: _Surface, P: np.ndarray, zone: np.ndarray) -> None:
    """Bring each vertex of the zone (n,) bool to the mean of its neighbours, in P."""
    ids = np.flatnonzero(zone & ~surface.still)
    mean = surface.ones[ids]
    degree = mean.sum(axis=1)[:, None]
    for _ in range(AVERAGINGS):
        P[ids] = mean @ P / degree


def _settled(
    surface: _Surface,
    P: np.ndarray,
    patch: np.ndarray,
    held: np.ndarray,
    *,
    stiffness: float,
    strain: float,
    engine: Engine,
) -> np.ndarray:
    """P (n, 3) with a lower energy of the patch (n,) bool; its boundary and the vertices `held` (n,) stay."""
    mesh, P = surface.mesh, P.copy()
    whole = patch[mesh.F].all(axis=1)
    stay = held.copy()
    stay[mesh.F[~whole]] = True
    ids = np.unique(mesh.F[whole])
    index = np.flatnonzero(stay[ids])
    if 0 < len(index) < len(ids):
        place = np.full(mesh.n, -1)
        place[ids] = np.arange(len(ids))
        solver = LocalGlobal(Mesh(mesh.V[ids], place[mesh.F[whole]]), index, engine=engine)
        # No tolerance: it is relative to the diagonal, which turns change.
        P[ids] = solver.solve(
            P[ids[index]],
            start=P[ids],
            tolerance=0.0,
            max_iterations=ITERATIONS,
            stiffness=stiffness,
            strain=strain,
        ).positions
    return P


@njit(cache=True, nogil=True)
def _lacks(P, V, F, normal, still, ids, at, margin):
    """How vertices get out from behind the faces across from them.

    Parameters
    ----------
    P, V : (n, 3) float64
        Deformed and rest positions.
    F : (m, 3) int64
        Faces that may be across, with normals `normal` (m, 3) of any length.
    still : (n,) bool
        Vertices that cannot move.
    ids : (k,) int64
        The vertices, with normals `at` (k, 3).
    margin : float
        Gap wanted.

    Returns
    -------
    way : (k, 3) float64
        Unit normal of the nearest face across.
    lack : (k,) float64
        How far to go along it: half of what the gap lacks, all if the vertex or the face cannot
        move; negative where the gap is wider, minus infinity where no face is across.
    across : (k,) int64
        That face, or -1.
    """
    way, lack, across = np.zeros((len(ids), 3)), np.full(len(ids), -np.inf), np.full(len(ids), -1)
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
            c = F[t, 0]
            dx, dy, dz = V[v, 0] - V[c, 0], V[v, 1] - V[c, 1], V[v, 2] - V[c, 2]
            if dx * dx + dy * dy + dz * dz > ACROSS * square:
                least, nearest = square, t
        if nearest < 0:
            continue
        size = np.sqrt(normal[nearest, 0] ** 2 + normal[nearest, 1] ** 2 + normal[nearest, 2] ** 2)
        gap = 0.0
        for d in range(3):
            way[i, d] = normal[nearest, d] / size
            gap += way[i, d] * (P[v, d] - centre[nearest, d])
        alone = still[v] or still[F[nearest, 0]] or still[F[nearest, 1]] or still[F[nearest, 2]]
        lack[i] = (margin - gap) * (1.0 if alone else 0.5)
        across[i] = nearest
    return way, lack, across
