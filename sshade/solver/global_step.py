"""The global step of an as-rigid-as-possible iteration: by a factorisation, or by a V-cycle.

From u it writes ``g = u + M (b - L u)``, with b the right-hand side and L the Laplacian of the rest
shape. A factorisation has M = L^-1, and g is the minimum for the rotations. A V-cycle
(:mod:`sshade.solver.multigrid`) is a symmetric positive definite M: g is a step of descent in its
metric. Directions of constraints are M times their gradients, so that the whole step, constraints
included, is M times something, and quasi-Newton pairs are as sound as with M = L^-1.

The V-cycle is not that of L but of the Laplacian whose triangles are weighted as softening weighs
them where a solve begins: the energy lies below the quadratic with the present weights, not only
below that of L. That makes up for what a V-cycle leaves, and more: polished from a proxy, bodies
of 25,000 and 170,000 vertices get lower in as many steps than with L^-1 itself. Directions solved
for exactly, in place of one V-cycle each, are no better; two V-cycles a step hardly pay.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numba import njit
from scipy.sparse import csr_array

from sshade.errors import InputError
from sshade.memory import give_back
from sshade.solver.conjugate_gradients import conjugate_gradients
from sshade.solver.factorisation import Factorisation
from sshade.solver.multigrid import SMOOTHER, Multigrid, compressed_rows, multiply
from sshade.threads import ThreadTeam

if TYPE_CHECKING:
    from sshade.solver.arap import ArapSystem
    from sshade.solver.interfaces import Constraints, Softening

#: What conjugate gradients leave of the error of an exact step.
NEARLY = 1e-2
#: Least weight of a triangle in the metric of a V-cycle. Weights rise where strain goes, and a step is
#: safe while they are under twice the metric's; lower ones save little (tried: 0.1 to 0.5).
SOFTEST = 0.25
#: Degree of the finest level's smoother where no step is exact. A polish gets as low as with degree 3 in 3 to
#: 26 % less time (six bodies): a step takes less, though it does less.
ROUGHEST = 1


class GlobalStep(Protocol):
    """The global step of one solve. u, B, g and F are (n, 3) float64, in the system's order."""

    @property
    def rough(self) -> bool:
        """Whether the next step is too rough for its length to say how near the minimum is."""

    def refine(self) -> None:
        """Let the next step not be rough."""

    #: Share of ``L u`` that B has in it: 1 of a right-hand side, 0 of what is left of it at u.
    kept: float

    def aim(self, targets: np.ndarray) -> None:
        """Take the positions (k, 3) of held vertices from here on."""

    def solve(self, u: np.ndarray, B: np.ndarray, g: np.ndarray) -> None:
        """Write ``u + M (B - kept L u)`` to g, held vertices of u on their targets; B may be overwritten."""

    def renew_directions(self, constraints: Constraints, u: np.ndarray) -> None:
        """Give the constraints M times their gradients at u."""

    def gradient(self, constraints: Constraints | None, F: np.ndarray, B: np.ndarray) -> None:
        """Write ``M^-1 F`` to B, F the last step as constraints left it, B as `solve` left it."""


class FactorisedLaplacian:
    """The Laplacian of vertices that are not held, factorised, and what couples them to the others.

    Parameters
    ----------
    laplacian : (n, n) csr_array
    index : (k,) int64
        Held vertices.

    Attributes
    ----------
    free : (n - k,) int64
        The others, in the elimination order.
    to_handles : (n - k, k) csr_array

    Raises
    ------
    InputError
        When the matrix is not positive definite to rounding.
    """

    def __init__(self, laplacian: csr_array, index: np.ndarray) -> None:
        free = np.delete(np.arange(laplacian.shape[0]), index)
        try:
            self.factorisation = Factorisation(laplacian[free][:, free])
        except FloatingPointError as error:  # every component has a handle: it is the mesh
            raise not_positive_definite() from error
        self.free = free[self.factorisation.order]
        self.to_handles = laplacian[self.free][:, index]


def not_positive_definite() -> InputError:
    return InputError(
        "the Laplacian of the rest mesh is not positive definite to rounding, as triangles of "
        "nearly no area make it, or weights near 0 where all handles of a component are soft"
    )


class FactorisedStep:
    """The exact :class:`GlobalStep`, by a right-hand side.

    Parameters
    ----------
    system : ArapSystem
    factorised : FactorisedLaplacian
    team : ThreadTeam
    """

    def __init__(self, system: ArapSystem, factorised: FactorisedLaplacian, *, team: ThreadTeam) -> None:
        self.kept, self._laplacian, self._team = 1.0, compressed_rows(system.laplacian), team
        self._solve, self._held = factorised.factorisation.solve_ordered, system.held
        self._free, self._to_handles = system.place[factorised.free], factorised.to_handles
        self._X = np.empty((len(self._free), 3))

    def aim(self, targets: np.ndarray) -> None:
        self._targets, self._fixed = targets, -(self._to_handles @ targets)

    @property
    def rough(self) -> bool:
        return False

    def refine(self) -> None:
        pass

    def solve(self, u: np.ndarray, B: np.ndarray, g: np.ndarray) -> None:
        free, X = self._free, self._X
        self._team.ranges(lambda *own: _gather(*own, B, free, self._fixed, X), len(free))
        self._solve(X, team=self._team)
        self._team.ranges(lambda *own: _scatter(*own, X, free, g), len(free))
        g[self._held] = self._targets

    def renew_directions(self, constraints: Constraints, u: np.ndarray) -> None:
        for right, direction in zip(*constraints.gradients(u), strict=True):
            X = right[self._free]
            self._solve(X, team=self._team)
            direction[self._free] = X
        constraints.take_directions()

    def gradient(self, constraints: Constraints | None, F: np.ndarray, B: np.ndarray) -> None:
        self._team.ranges(lambda *own: multiply(*own, *self._laplacian, F, B), len(F))


class MultigridStep:
    """A :class:`GlobalStep` by one V-cycle, of what is left of a right-hand side: no Laplacian is stored.

    Far from a minimum such steps lead to other ones than exact steps do, with torn handles often to
    higher ones. So the first ones may be all but exact, and so is then the step that says that
    the minimum is reached.

    Parameters
    ----------
    system : ArapSystem
        Its `exact_steps` are how many of the first are: solved to :data:`NEARLY` by conjugate gradients.
    softening : Softening, optional
        Its weights at the first step make the metric, but with exact steps.
    team : ThreadTeam
    """

    def __init__(self, system: ArapSystem, softening: Softening | None, *, team: ThreadTeam) -> None:
        self.kept, self._system, self._team = 0.0, system, team
        self._softening = None if system.exact_steps else softening
        self._confirms, self._left, self._exact = system.exact_steps > 0, system.exact_steps, False
        self._made: Multigrid | None = None

    @property
    def _metric(self) -> Multigrid:
        """Made when the weights are known."""
        if self._made is None:
            softening = self._softening
            weight = None if softening is None else np.maximum(softening.weight, SOFTEST)
            held = np.zeros(self._system.mesh.n, dtype=bool)
            held[self._system.held] = True
            try:
                degree = len(SMOOTHER) if self._system.exact_steps else ROUGHEST
                self._made = Multigrid(self._system.metric(weight), held, degree=degree, team=self._team)
            except FloatingPointError as error:
                raise not_positive_definite() from error
            give_back()
        return self._made

    def aim(self, targets: np.ndarray) -> None:
        """Held vertices are where u has them."""

    @property
    def rough(self) -> bool:
        return self._confirms and self._left == 0

    def refine(self) -> None:
        self._left = max(self._left, 1)

    def solve(self, u: np.ndarray, B: np.ndarray, g: np.ndarray) -> None:
        self._exact, self._left = self._left > 0, max(self._left - 1, 0)
        B[self._system.held] = 0.0
        self._apply(B, g)
        self._team.ranges(lambda *own: _add(*own, u, g), len(u))

    def renew_directions(self, constraints: Constraints, u: np.ndarray) -> None:
        for right, direction in zip(*constraints.gradients(u), strict=True):
            right[self._system.held] = 0.0
            self._apply(right, direction)
        constraints.take_directions()

    def _apply(self, B: np.ndarray, X: np.ndarray) -> None:
        if self._exact:
            held, team = self._system.held, self._team
            conjugate_gradients(self._metric, B, X, held=held, tolerance=NEARLY, team=team)
        else:
            self._metric.apply(B, X, team=self._team)

    def gradient(self, constraints: Constraints | None, F: np.ndarray, B: np.ndarray) -> None:
        if constraints:
            constraints.add_moves(B)
            B[self._system.held] = 0.0


@njit(cache=True, nogil=True)
def _add(first, end, A, B):
    for i in range(first, end):
        for c in range(3):
            B[i, c] += A[i, c]


@njit(cache=True, nogil=True)
def _gather(first, end, B, rows, fixed, X):
    for i in range(first, end):
        for c in range(3):
            X[i, c] = B[rows[i], c] + fixed[i, c]


@njit(cache=True, nogil=True)
def _scatter(first, end, X, rows, g):
    for i in range(first, end):
        for c in range(3):
            g[rows[i], c] = X[i, c]
