"""The linear solve of the global step without a factorisation: V-cycles, alone or in conjugate gradients.

The V-cycle approximates the inverse of the Laplacian with the strain weights at the start of a solve. Its
steps still descend, because the energy lies below the quadratic energy with the present weights. The better
metric outweighs the error of the V-cycle: after the same number of steps, a polish of bodies of 25,000 and
170,000 vertices has a lower energy than with L^-1. One V-cycle for each direction of a constraint is as good
as an exact solve, and a second V-cycle for each step hardly pays.
"""

from __future__ import annotations

import numpy as np

from sshade.core.threads import ThreadTeam
from sshade.mesh.conjugate_gradients import conjugate_gradients
from sshade.solver.factorisation import Linear
from sshade.solver.multigrid import Multigrid, multiply

#: Error of a solve by conjugate gradients, as a fraction of the solution's energy norm.
TOLERANCE = 1e-2
#: Largest number of conjugate gradient steps. Three or four are usual, and each leaves a fifth of the error.
MOST_STEPS = 40


class VCycle(Linear):
    """M is one V-cycle.

    Parameters
    ----------
    multigrid : Multigrid
    fixed : (k,) int
        Places of fixed vertices.
    """

    def __init__(self, multigrid: Multigrid, fixed: np.ndarray) -> None:
        self._multigrid, self._fixed = multigrid, fixed

    def solve(self, B: np.ndarray, X: np.ndarray, team: ThreadTeam | None = None) -> None:
        B[self._fixed] = 0.0
        self._multigrid.apply(B, X, team=team or ThreadTeam(1))


class ConjugateGradients(VCycle):
    """The first solves are nearly exact, by conjugate gradients; later ones are V-cycles.

    Far from a minimum, V-cycles lead to other minima than exact steps do, and to higher ones if handles are
    far from their targets. The step that proves convergence is nearly exact again.

    Parameters
    ----------
    multigrid, fixed
        As of :class:`VCycle`.
    steps : int
        Number of nearly exact solves.
    """

    def __init__(self, multigrid: Multigrid, fixed: np.ndarray, *, steps: int) -> None:
        super().__init__(multigrid, fixed)
        self._steps = steps

    def solve(self, B: np.ndarray, X: np.ndarray, team: ThreadTeam | None = None) -> None:
        """Solve by conjugate gradients up to :data:`TOLERANCE`, or by one V-cycle."""
        team = team or ThreadTeam(1)
        super().solve(B, X, team)
        if self._steps > 0:
            self.refine(B, X, TOLERANCE, team)

    def end_step(self, short: bool) -> bool:
        converged = short and self._steps > 0
        # After a short V-cycle one nearly exact step follows, which may prove convergence.
        self._steps = max(self._steps - 1, int(short and not converged))
        return converged

    def refine(self, B: np.ndarray, X: np.ndarray, tolerance: float, team: ThreadTeam) -> None:
        """Replace a V-cycle X of B by the solution, up to an error of `tolerance` in the energy norm.

        The three columns are solved at once. Both norms are estimates by V-cycles, and the matrix has single
        precision.
        """
        A, n = self._multigrid.finest, len(B)
        if A is None:
            return

        def product(one: np.ndarray, other: np.ndarray) -> np.ndarray:
            return sum(
                team.ranges(lambda *own: np.einsum("ic,ic->c", one[slice(*own)], other[slice(*own)]), n)
            )

        def times(P: np.ndarray, Q: np.ndarray) -> None:
            team.ranges(multiply, n, *A, P, Q)
            Q[self._fixed] = 0.0

        X[:] = conjugate_gradients(
            B,
            X,
            times=times,
            precondition=lambda R, Q: self._multigrid.apply(R, Q, team=team),
            converged=lambda R, now, start: bool((now <= tolerance**2 * start).all()),
            product=product,
            most_steps=MOST_STEPS,
        )
