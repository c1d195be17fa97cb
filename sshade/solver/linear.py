"""The linear solve of the global step: a factorisation, V-cycles, or conjugate gradients.

The forces B at positions u are minus half of the energy's gradient, divided by the number of corners of an
element. The global step is ``u + M B``. M is a symmetric positive definite matrix here, not the mesh. A
factorisation has ``M = L^-1`` for the Laplacian L of the rest shape, and the step ends in the minimum for the
present rotations. It may instead have the Laplacian with the strain weights at the start of a solve, and then
descends in its metric. A V-cycle (:mod:`sshade.solver.multigrid`) approximates the inverse, and descends in
its metric, too. The directions of constraints are M times their gradients. The whole step, constraints
included, is therefore M times a vector, as quasi-Newton steps require.

The V-cycle approximates the inverse of the Laplacian with the strain weights at the start of a solve. Its
steps still descend, because the energy lies below the quadratic energy with the present weights. The better
metric outweighs the error of the V-cycle: after the same number of steps, a polish of bodies of 25,000 and
170,000 vertices has a lower energy than with L^-1. One V-cycle for each direction of a constraint is as good
as an exact solve, and a second V-cycle for each step hardly pays.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from scipy.sparse import csr_array

from sshade.core.errors import InputError
from sshade.core.threads import ThreadTeam
from sshade.mesh.conjugate_gradients import conjugate_gradients
from sshade.solver.factorisation import Factorisation
from sshade.solver.multigrid import Multigrid, multiply

#: Error of a solve by conjugate gradients, as a fraction of the solution's energy norm.
TOLERANCE = 1e-2
#: Largest number of conjugate gradient steps. Three or four are usual, and each leaves a fifth of the error.
MOST_STEPS = 40


class Linear(Protocol):
    """The linear solve of the global step. B and X are (n, 3) float64, in the solver's order."""

    def solve(self, B: np.ndarray, X: np.ndarray, team: ThreadTeam | None = None) -> None:
        """Write M B to X. Rows of fixed vertices become 0 in both. The threads of a team share the work."""

    def end_step(self, short: bool) -> bool:
        """Count a global step, and return whether it proves convergence. By default every short step does.

        Parameters
        ----------
        short : bool
            The residual of the step is below the tolerance.
        """
        return short


class Factorised(Linear):
    """M is the inverse of a matrix without the rows and columns of fixed vertices.

    Any number of solves may use it at the same time.

    Parameters
    ----------
    matrix : (n, n) csr_array
        Symmetric; in the order of the mesh's vertices.
    fixed : (k,) int
        Fixed vertices.
    place : (n,) int, optional
        Place of each vertex in the order of B and X; by default the same order.

    Attributes
    ----------
    factorisation : Factorisation

    Raises
    ------
    InputError
        When the matrix is not positive definite to rounding.
    """

    def __init__(self, matrix: csr_array, fixed: np.ndarray, place: np.ndarray | None = None) -> None:
        movable = np.delete(np.arange(matrix.shape[0]), fixed)
        try:
            self.factorisation = Factorisation(matrix[movable][:, movable])
        except FloatingPointError as error:  # every component has a handle, so the mesh is the cause
            raise not_positive_definite() from error
        rows = movable[self.factorisation.order]
        self._rows: np.ndarray = rows if place is None else place[rows].astype(np.int64)
        self._fixed: np.ndarray = fixed if place is None else place[fixed]
        #: Row of the solution for each row of X; fixed ones take the row of zeros at the end.
        self._solved = np.full(matrix.shape[0], len(rows))
        self._solved[self._rows] = np.arange(len(rows))

    def solve(self, B: np.ndarray, X: np.ndarray, team: ThreadTeam | None = None) -> None:
        B[self._fixed] = 0.0
        solution = np.zeros((len(self._rows) + 1, 3))
        # NumPy's take is ten times as fast as an index array.
        np.take(B, self._rows, axis=0, out=solution[:-1], mode="clip")
        self.factorisation.solve_ordered(solution[:-1], team)
        np.take(solution, self._solved, axis=0, out=X, mode="clip")


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


def not_positive_definite() -> InputError:
    return InputError(
        "the equations of the rest mesh have no unique solution to rounding: remesh triangles of nearly no "
        "area, or raise weights near 0 where all handles of a component are soft"
    )
