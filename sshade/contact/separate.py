"""Self-intersections of a deformed surface resolved.

No energy of the shape alone keeps a chin out of a chest. Where faces intersect that did not at
rest, the penetrating vertices are moved out by a field that is smooth along the surface. Both
sides move, in proportion to their mobility: the distance along the surface to the nearest handle,
which stays. They are held there while the energy of a patch around them is minimised for a few
iterations, and so on for some rounds.

Which vertices penetrate, the intersecting faces tell: they form loops that cut the part inside the
other side off from the rest of the surface (cf. D. Baraff, A. Witkin, M. Kass, "Untangling
cloth", ACM TOG 22(3), 2003). A fan folded over itself, which no move resolves, is smoothed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from sshade.contact.apart import AVERAGINGS, Surface, move_apart
from sshade.contact.flips import new_flips
from sshade.contact.intersections import new_crossings
from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.solver.local_global import LocalGlobal
from sshade.task import Progress, silent

#: Gap between separated sides by default, over the mean edge around the contact.
MARGIN = 0.25
#: How much farther than needed vertices move: the one to begin with, others where a round did not help.
SHARES = 1.3, 1.0
#: Where no move helps, so many attempts to smooth: the faces alone, then two more rings each time.
PINCH = 5
#: So many faces are few, and every one less counts. Of more, no more than this share may be left.
FEW, WORTH = 100, 0.97
#: Iterations of the patch that is relaxed.
ITERATIONS = 30


class Separated(NamedTuple):
    """A shape with fewer intersections, and how it came about.

    Attributes
    ----------
    positions : (n, 3) float64
    before, after : int
        Faces that intersect others, or are inverted (oppose their neighbours), and did not at rest.
    rounds : int
    penetrating : (n,) bool
        Vertices that were behind other faces in some round.
    """

    positions: np.ndarray
    before: int
    after: int
    rounds: int
    penetrating: np.ndarray


def separate(
    mesh: Mesh,
    positions: np.ndarray,
    index: np.ndarray,
    *,
    penetrating: np.ndarray | None = None,
    stiffness: float = 1.0,
    strain: float = 0.02,
    margin: float = MARGIN,
    rounds: int = 24,
    workers: int = 1,
    progress: Progress = silent,
) -> Separated:
    """Resolve self-intersections and inverted faces of a deformed shape that were not there at rest.

    Parameters
    ----------
    mesh : Mesh
        Rest shape; manifold. Of one with a boundary, the normals tell which side is out.
    positions : (n, 3) float64
    index : (k,) int
        Vertices that stay, the handles.
    penetrating : (n,) bool, optional
        Of an earlier call: they are moved from the first round on.
    stiffness, strain
        How the triangles of the patch soften; see :mod:`sshade.solver.strain_softening`.
    margin : float
        Gap between separated sides, over the mean edge around the contact.
    rounds : int
        At most.
    workers : int
        Threads that look for intersections; no influence on the result.
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
    bad = _intersecting_or_inverted(mesh, positions, workers=workers)
    before = int(bad.sum())
    penetrating = np.zeros(mesh.n, dtype=bool) if penetrating is None else penetrating
    if before == 0:
        return Separated(positions.copy(), 0, 0, 0, penetrating)
    surface, best, attempts = Surface(mesh, index), positions, len(SHARES) + PINCH
    done, failed, attempt = 0, 0, 0
    while bad.any() and done < rounds and failed < attempts:
        progress("contact", done, rounds, f"{int(bad.sum())} faces intersect or are inverted")
        seeds = np.zeros(mesh.n, dtype=bool)
        seeds[mesh.F[bad]] = True
        P = best.copy()
        patch, far = surface.near(seeds | penetrating)
        inside = surface.enclosed(seeds, patch) | (penetrating if failed == attempt == 0 else False)
        if attempt < len(SHARES):
            mobility = surface.mobility(far)
            held = move_apart(surface, P, inside, mobility, share=SHARES[attempt], margin=margin)
            shapes = [_relaxed(surface, P, patch, held, stiffness=stiffness, strain=strain), P]
        else:
            _smooth_out(surface, P, surface.grown(seeds, 2 * (attempt - len(SHARES))))
            shapes = [P]
        done += 1
        now = np.ones(mesh.m, dtype=bool)
        for shape in shapes:  # what is relaxed may intersect again: then rather not
            among = bad | _moved_faces(mesh.F, best, shape)
            found = _intersecting_or_inverted(mesh, shape, among=among, workers=workers)
            if found.sum() < now.sum():
                P, now = shape, found
            if not now.any():
                break
        if now.sum() < bad.sum() * (1.0 if bad.sum() <= FEW else WORTH):
            best, penetrating, bad, failed = P, penetrating | inside, now, 0
        else:  # the attempt that helped last comes first again
            failed, attempt = failed + 1, (attempt + 1) % attempts
    progress("contact", rounds, rounds, f"{int(bad.sum())} faces intersect or are inverted")
    return Separated(best.copy(), before, int(bad.sum()), done, penetrating)


def _intersecting_or_inverted(
    mesh: Mesh, P: np.ndarray, *, among: np.ndarray | None = None, workers: int = 1
) -> np.ndarray:
    """(m,) bool: faces that intersect others `among` (m,), or are inverted near these, unlike at rest."""
    return new_crossings(mesh, P, among=among, workers=workers) | new_flips(mesh, P, among=among)


def _smooth_out(surface: Surface, P: np.ndarray, zone: np.ndarray) -> None:
    """Bring each vertex of the zone (n,) bool to the mean of its neighbours, in P."""
    ids = np.flatnonzero(zone & ~surface.still)
    mean = surface.ones[ids]
    degree = mean.sum(axis=1)[:, None]
    for _ in range(AVERAGINGS):
        P[ids] = mean @ P / degree


def _relaxed(
    surface: Surface,
    P: np.ndarray,
    patch: np.ndarray,
    held: np.ndarray,
    *,
    stiffness: float,
    strain: float,
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
        solver = LocalGlobal(Mesh(mesh.V[ids], place[mesh.F[whole]]), index)
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
def _moved_faces(F, A, B):
    """(m,) bool: faces with a corner at which the positions A and B differ."""
    moved = np.empty(len(A), dtype=np.bool_)
    for i in range(len(A)):
        moved[i] = (A[i, 0] != B[i, 0]) | (A[i, 1] != B[i, 1]) | (A[i, 2] != B[i, 2])
    found = np.empty(len(F), dtype=np.bool_)
    for f in range(len(F)):
        found[f] = moved[F[f, 0]] | moved[F[f, 1]] | moved[F[f, 2]]
    return found
