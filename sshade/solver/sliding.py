"""Sliding handles in a solve: the global step for vertices that are fixed in some directions only.

The matrix of the global step leaves sliding vertices free. A step first ignores their slides. Multipliers mu
then bring each vertex j back to its set: with the directions n_a of all sliding vertices, the nearest allowed
positions q, and the inverse matrix M,

    x_j = g_j - sum_i M_ji mu_i,   mu_i = sum_a f_a n_a,   n_a . (x_j - q_j) = c_j f_a.

The compliance c_j is 0 for a hard handle and 1 / stiffness for a soft one. This is a dense system of one
equation for each direction. The step remains the minimum of the quadratic energy under the linearised
conditions, so that planes and lines need no multipliers from earlier steps and no penalty. On a surface, q is
the nearest point to ``x_j + (M_jj + c_j) mu_j``, where the vertex would go without its own slide; its offset
from q is a direction in which the surface pushes, also at edges and at a boundary.

J. J. Moreau, "Unilateral contact and dry friction in finite freedom dynamics", 1988 (projection of a point
plus its force); J. Nocedal, S. Wright, "Numerical optimization", 2006, chapter 18 (linearised conditions).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from sshade.errors import InputError
from sshade.kernels import kernel
from sshade.slides import Nearest, nearest
from sshade.solver.linear import Linear

#: Largest number of sliding vertices of a solve: the memory of its dense matrices grows with the square.
MOST = 4000
#: Rounds of linearisation in a step, and distance, as a fraction of the diagonal, at which they end.
ROUNDS, CLOSE = 5, 1e-12
#: Stiffness in the matrix alone, not in the energy, of each sliding vertex of a component that has no other
#: handles. Motions that nothing determines stay where they are.
PROXIMAL = 1e-2

Solve = Callable[[np.ndarray, np.ndarray], None]


class Sliding(NamedTuple):
    """The sliding handles of a bound system, s of its k handles.

    Attributes
    ----------
    handle : (s,) int64
        Their numbers among the handles.
    vertex : (s,) int64
        The vertices of the mesh.
    place : (s,) int
        Their places in the solver's order.
    slide : (s,) object
        The :class:`sshade.Slide` of each handle.
    compliance : (s,) float64
        0 for hard handles.
    """

    handle: np.ndarray
    vertex: np.ndarray
    place: np.ndarray
    slide: np.ndarray
    compliance: np.ndarray

    def response(self, linear: Linear, n: int) -> np.ndarray:
        """Return the entries (s, s) of the inverse matrix; raise InputError for more than :data:`MOST`."""
        s = len(self.place)
        if s > MOST:
            raise InputError(
                f"{s} vertices of the proxy slide, and at most {MOST} may; lower the option vertices"
            )
        M, B, X = np.empty((s, s)), np.zeros((n, 3)), np.empty((n, 3))
        for first in range(0, s, 3):
            own = np.arange(first, min(first + 3, s))
            B[self.place[own], own - first] = 1.0
            linear.solve(B, X)
            M[:, own] = X[self.place, : len(own)]
            B[self.place[own]] = 0.0
        return 0.5 * (M + M.T)


class Slides:
    """The sliding handles of one solve. Positions P, U, G and forces B are (n, 3), in the solver's order.

    Parameters
    ----------
    sliding : Sliding
    response : (s, s) float64
        See :meth:`Sliding.response`.
    corners : int
        Number of times that the energy counts each edge.
    origin : (3,) float64
        Of the solver's positions.
    unit : float
        Diagonal of the mesh.
    """

    def __init__(
        self, sliding: Sliding, response: np.ndarray, *, corners: int, origin: np.ndarray, unit: float
    ) -> None:
        self._sliding, self._M, self._corners, self._origin = sliding, response, corners, origin
        self._close, self._mu = CLOSE * unit, np.zeros((len(response), 3))
        self._hard = sliding.compliance == 0
        self._reach = (np.diag(response) + sliding.compliance)[:, None]
        self._flat = all(slide.surface is None for slide in sliding.slide)
        self._factors: dict[bool, Any] = {}
        self._last: Nearest | None = None

    def aim(self, targets: np.ndarray) -> None:
        """Set the targets (k, 3) of all handles."""
        self._targets = targets[self._sliding.handle]

    def positions(self, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the vertices of hard sliding handles, and the nearest allowed positions to P there."""
        found = self._nearest(P[self._sliding.place]).position
        return self._sliding.vertex[self._hard], found[self._hard] + self._origin

    def _nearest(self, points: np.ndarray) -> Nearest:
        found = nearest(self._sliding.slide, points + self._origin, self._targets)
        return found._replace(position=found.position - self._origin)

    def penalty(self, P: np.ndarray) -> float:
        """Return the energy of the soft slides."""
        return self._corners * self._pull(P)[1]

    def _pull(self, P: np.ndarray) -> tuple[np.ndarray, float]:
        """Return stiffness times offset (s, 3) of soft handles, 0 for hard ones, and their energy."""
        if self._hard.all():
            return np.zeros((len(self._hard), 3)), 0.0
        points, compliance = P[self._sliding.place], self._sliding.compliance
        off = points - self._nearest(points).position
        force = np.divide(1.0, compliance, out=np.zeros(len(off)), where=~self._hard)[:, None] * off
        return force, float((force * off).sum())

    def project(self, G: np.ndarray, U: np.ndarray, B: np.ndarray, solve: Solve) -> None:
        """Move G, the end of a global step from U, onto the slides, and add their forces to B.

        `solve(B, X)` writes M B to X. B then has minus the gradient at U: of the energy with soft slides,
        and of the hard slides with their multipliers.
        """
        place = self._sliding.place
        free, mu = G[place], self._mu
        x = free - self._moved(mu)
        for _ in range(ROUNDS):
            at, last = self._nearest(x + self._reach * mu), x
            mu = self._multipliers(at, free - at.position)
            x = free - self._moved(mu)
            if self._flat or np.abs(x - last).max() <= self._close:
                break
        self._mu = mu
        self._move(G, mu, solve)
        B[place] -= np.where(self._hard[:, None], mu, self._pull(U)[0])

    def _moved(self, mu: np.ndarray) -> np.ndarray:
        """(s, 3) moves by forces (s, 3). No product of matrices: BLAS would start threads that spin."""
        return np.einsum("ij,jc->ic", self._M, mu)

    def restrict(self, X: np.ndarray, solve: Solve) -> None:
        """Remove the part of a direction X = M B that leaves the slides of the last step."""
        assert self._last is not None
        self._move(X, self._multipliers(self._last, X[self._sliding.place]), solve)

    def restore(self, P: np.ndarray, solve: Solve) -> None:
        """Move P until hard handles are on their slides, with the surface around them."""
        place, hard = self._sliding.place, self._hard
        for _ in range(ROUNDS):
            points = P[place]
            at = self._nearest(points)
            self._last = self._last or at
            off = np.where(hard[:, None], points - at.position, 0.0)
            if np.abs(off).max() <= self._close:
                return
            self._move(P, self._multipliers(at, off, only_hard=True), solve)

    def _multipliers(self, at: Nearest, off: np.ndarray, *, only_hard: bool = False) -> np.ndarray:
        """Return the forces (s, 3) that remove the offsets (s, 3) in the directions of `at`."""
        kept = self._hard[at.number] if only_hard else np.ones(len(at.number), dtype=bool)
        number, N, mu = at.number[kept], at.across[kept], np.zeros((len(self._M), 3))
        if not only_hard:
            self._last = at
        if len(number) == 0:
            return mu
        factor = self._factors.get(only_hard)
        if factor is None:
            factor = _factor(self._M, self._sliding.compliance, number, N)
            if self._flat:  # then the directions never change
                self._factors[only_hard] = factor
        force = np.einsum("ac,ac->a", N, off[number])
        _substitute(factor, force)
        np.add.at(mu, number, force[:, None] * N)
        return mu

    def _move(self, P: np.ndarray, mu: np.ndarray, solve: Solve) -> None:
        """Subtract M mu from P."""
        B, X = np.zeros_like(P), np.empty_like(P)
        B[self._sliding.place] = mu
        solve(B, X)
        P -= X


# Own kernels, because LAPACK would start threads that spin beside ours.
@kernel(fastmath={"reassoc", "contract"})
def _factor(M, compliance, number, N):
    """Cholesky factor of ``M_ij n_a . n_b``, plus c_i on its diagonal, with the handles i, j of a, b."""
    count = len(number)
    S = np.zeros((count, count))
    for a in range(count):
        i = number[a]
        for b in range(a + 1):
            cosine = N[a, 0] * N[b, 0] + N[a, 1] * N[b, 1] + N[a, 2] * N[b, 2]
            x = M[i, number[b]] * cosine
            if a == b:
                x += compliance[i]
            row, other, dot = S[a, :b], S[b, :b], 0.0
            for k in range(b):
                dot += row[k] * other[k]
            S[a, b] = np.sqrt(x - dot) if a == b else (x - dot) / S[b, b]
    return S


@kernel
def _substitute(S, x):
    """Replace x (c,) by the solution for the factor S."""
    for a in range(len(x)):
        for b in range(a):
            x[a] -= S[a, b] * x[b]
        x[a] /= S[a, a]
    for a in range(len(x) - 1, -1, -1):
        x[a] /= S[a, a]
        for b in range(a):
            x[b] -= S[a, b] * x[a]
