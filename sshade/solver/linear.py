"""The linear solve of the global step: a factorisation, V-cycles, or conjugate gradients.

The forces B at positions u are minus half of the energy's gradient, divided by the number of corners of an
element. The global step is ``u + M B``. M is a symmetric positive definite matrix here, not the mesh. A
factorisation has ``M = L^-1`` for the Laplacian L of the rest shape, and the step ends in the minimum for the
present rotations. It may instead have the Laplacian with the strain weights at the start of a solve, and then
descends in its metric. A V-cycle (:mod:`sshade.solver.cycles`) approximates the inverse, and descends in
its metric, too. The directions of constraints are M times their gradients. The whole step, constraints
included, is therefore M times a vector, as quasi-Newton steps require.

"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from scipy.sparse import csr_array

from sshade.core.errors import InputError
from sshade.core.threads import ThreadTeam
from sshade.solver.factorisation import Factorisation


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


def not_positive_definite() -> InputError:
    return InputError(
        "the equations of the rest mesh have no unique solution to rounding: remesh triangles of nearly no "
        "area, or raise weights near 0 where all handles of a component are soft"
    )
