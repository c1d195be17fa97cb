"""Sparse positive definite systems: factorise once, solve often, from any thread.

SuperLU finds a symmetric factorisation, of which only L and D of ``Q = P^T L D L^T P`` are kept. The
substitutions are kernels here, because SciPy's `solve` holds the GIL. SuperLU comes with SciPy, so that no
other library is needed; CHOLMOD through `cholespy` solves a system of 12,000 unknowns in three quarters of
the time, and takes 1.4 times as long to factorise it.

Two threads share a substitution. Columns of the factor that lie in different subtrees of the elimination tree
do not depend on each other. A division collects subtrees in two halves of equal work; the remaining columns,
the top, come after both halves. The division depends on the matrix alone, so that results do not depend on
the number of threads.

The forces B at positions u are minus half of the energy's gradient, divided by the number of corners of an
element. The global step is ``u + M B``. M is a symmetric positive definite matrix here, not the mesh. A
factorisation has ``M = L^-1`` for the Laplacian L of the rest shape, and the step ends in the minimum for the
present rotations. It may instead have the Laplacian with the strain weights at the start of a solve, and then
descends in its metric. A V-cycle (:mod:`sshade.solver.multigrid`) approximates the inverse, and descends in
its metric, too. The directions of constraints are M times their gradients. The whole step, constraints
included, is therefore M times a vector, as quasi-Newton steps require.

X. S. Li, "An overview of SuperLU", 2005; T. A. Davis, "Direct methods for sparse linear systems", 2006.
"""

from __future__ import annotations

from heapq import heapify, heappop, heappush
from typing import Protocol

import numpy as np
from scipy.sparse import csc_array, csc_matrix, csr_array, sparray, spmatrix

from sshade.core.errors import InputError
from sshade.core.kernels import kernel
from sshade.core.threads import ThreadTeam, in_turn

#: Number of entries below which a thread solves alone. A second thread would work for less time than it takes
#: to start.
SHARED = 100_000
#: Largest part of the work in the top, and largest part of the two halves' work in one of them.
TOP, HALF = 0.3, 0.54


class Factorisation:
    """``L D L^T`` of a sparse symmetric positive definite matrix Q.

    Parameters
    ----------
    Q : (n, n) sparse float64
        Both triangles must be stored.

    Attributes
    ----------
    order : (n,) int64
        Row of Q at each position of the elimination order. Unknowns stored in this order need no
        permutation: see :meth:`solve_ordered`.
    halves : (int, int)
        Ends of the two halves in that order; 0 if there are none. The top follows.
    factors : tuple
        In that order: starts (n + 1,) uint32, rows uint32 and values float64 of the columns of L, without the
        unit diagonal, and (n,) float64 the inverse of D. Unsigned indices save the kernels tests for negative
        ones, a quarter of their time.

    Raises
    ------
    FloatingPointError
        When Q is not positive definite to rounding, or has entries that are not finite.
    """

    def __init__(self, Q: sparray | spmatrix) -> None:
        from scipy.sparse.linalg import splu

        if not np.isfinite(Q.data).all():
            raise FloatingPointError("the matrix has entries that are not finite")
        n = Q.shape[0]
        if n == 0:  # SuperLU refuses it, but a mesh may consist of handles only
            lower, pivots, position = csc_array((0, 0)), np.empty(0), np.empty(0, dtype=np.int64)
        else:
            # With a symmetric ordering and no pivoting the fill is half that of the
            # default column ordering, and U is D L^T.
            try:
                lu = splu(
                    csc_matrix(Q),
                    permc_spec="MMD_AT_PLUS_A",
                    diag_pivot_thresh=0.0,
                    # For Laplacians: a quarter less time than with the defaults, and fewer explicit zeros.
                    panel_size=2,
                    relax=1,
                    options={"SymmetricMode": True},
                )
            except RuntimeError as error:  # "Factor is exactly singular"
                raise _no_factor() from error
            lower, pivots, position = lu.L, lu.U.diagonal(), lu.perm_c
            if not (np.array_equal(lu.perm_r, lu.perm_c) and (pivots > 0).all()):
                raise _no_factor()
        lower.sort_indices()  # the unit diagonal is then the first entry of each column
        rows = lower.indptr, lower.indices
        half = _halves(*rows)
        new = np.argsort(half, kind="stable")
        self.halves = int((half == 0).sum()), int((half < 2).sum())
        self.order = np.argsort(position)[new].astype(np.int64)
        *columns, self._top = _in_order(*rows, lower.data, new, np.argsort(new), self.halves[1])
        self.factors = *columns, 1.0 / pivots[new]

    def solve_ordered(self, X: np.ndarray, team: ThreadTeam | None = None) -> None:
        """Replace X (n, 3) float64, C-contiguous, by the solutions, both with their rows in `order`.

        The threads of a team, if there is one, share the work.
        """
        first, top = self.halves
        n, bounds, each = len(X), [(0, first), (first, top)], team or in_turn
        start, row, value, _ = self.factors
        if top:
            to_top = np.zeros((2, n - top, 3))
            each(lambda i: _forward(*bounds[i], start, self._top, row, value, X, top, to_top[i]), 2)
            X[top:] += to_top[0]
            X[top:] += to_top[1]
        _forward(top, n, start, start, row, value, X, top, X[top:])
        _backward(top, n, *self.factors, X)
        if top:
            each(lambda i: _backward(*bounds[i], *self.factors, X), 2)

    def solve(self, B: np.ndarray) -> np.ndarray:
        """Solve ``Q X = B`` for B (n, c) of at most three columns; returns X (n, c) float64."""
        X, ordered, columns = np.empty(B.shape), np.zeros((len(B), 3)), B.shape[1]
        ordered[:, :columns] = B[self.order]
        self.solve_ordered(ordered)
        X[self.order] = ordered[:, :columns]
        return X


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


def _no_factor() -> FloatingPointError:
    return FloatingPointError(
        "the matrix is not positive definite; a component without a handle or a nearly "
        "zero-area triangle does this"
    )


def _halves(start: np.ndarray, row: np.ndarray) -> np.ndarray:
    """(n,) half of each column, or 2 for the top. All are 2 if the work is small or cannot be divided.

    The columns have their diagonal entries first.
    """
    n = len(start) - 1
    half, parent, inner = np.full(n, 2), np.full(n, -1), np.flatnonzero(np.diff(start) > 1)
    parent[inner] = row[start[inner] + 1]
    work = _subtree_work(start, parent)
    if len(row) - n >= SHARED:
        for column, number in _roots_of_halves(parent, work):
            half[column] = number
    _spread(parent, half)
    return half


def _roots_of_halves(parent: np.ndarray, work: np.ndarray) -> list[tuple[int, int]]:
    """Return the roots of the subtrees in the halves, each with its half; none if the top becomes too large.

    The top grows from the roots of the elimination tree, by the column with the largest subtree, until the
    subtrees below fill two halves.
    """
    child = np.argsort(parent, kind="stable")
    begin = np.searchsorted(parent[child], np.arange(len(parent) + 1))
    heap = [(-work[root], root) for root in np.flatnonzero(parent < 0)]
    heapify(heap)
    rest = total = float(work[parent < 0].sum())
    while rest > (1.0 - TOP) * total:
        if -heap[0][0] <= HALF * rest:
            load, found = [0.0, 0.0], []
            for size, column in sorted(heap):
                number = int(load[1] < load[0])
                load[number] -= size
                found.append((int(column), number))
            if max(load) <= HALF * rest:
                return found
        size, column = heappop(heap)
        children = child[begin[column] : begin[column + 1]]
        rest += size + float(work[children].sum())
        for one in children:
            heappush(heap, (-work[one], one))
    return []


@kernel
def _subtree_work(start, parent):
    """(n,) number of entries in the columns of the subtree of each column."""
    work = np.zeros(len(parent))
    for j in range(len(parent)):
        work[j] += start[j + 1] - start[j]
        if parent[j] >= 0:
            work[parent[j]] += work[j]
    return work


@kernel
def _spread(parent, half):
    """Put each column below the top in the half of its parent."""
    for j in range(len(parent) - 1, -1, -1):
        if half[j] == 2 and parent[j] >= 0:
            half[j] = half[parent[j]]


@kernel
def _in_order(start, row, value, new, place, top):
    """Copy the columns `new` (n,) of a factor without their diagonal entries; row i becomes ``place[i]``.

    Returns starts, rows and values, and the number of the first entry of each column in a row from `top` on.
    """
    n, count = len(new), 0
    size = len(row) - n
    starts, tops = np.zeros(n + 1, dtype=np.uint32), np.empty(n, dtype=np.uint32)
    rows, values = np.empty(size, dtype=np.uint32), np.empty(size)
    for c in range(n):
        j = new[c]
        tops[c] = count
        for k in range(start[j] + 1, start[j + 1]):
            i = place[row[k]]
            rows[count], values[count] = i, value[k]
            count += 1
            if i < top:
                tops[c] = count
        starts[c + 1] = count
    return starts, rows, values, tops


@kernel(fastmath={"contract"})
def _forward(first, end, start, top_entry, row, value, X, top, to_top):
    """Solve ``L X = X`` in place for a range of columns, for X (n, 3).

    Entries of each column from `top_entry` (n,) on are in rows from `top` on, which `to_top` takes instead.
    """
    for j in range(first, end):
        x, y, z = X[j, 0], X[j, 1], X[j, 2]
        for k in range(start[j], top_entry[j]):
            i, v = row[k], value[k]
            X[i, 0] -= v * x
            X[i, 1] -= v * y
            X[i, 2] -= v * z
        for k in range(top_entry[j], start[j + 1]):
            i, v = row[k] - np.uint32(top), value[k]
            to_top[i, 0] -= v * x
            to_top[i, 1] -= v * y
            to_top[i, 2] -= v * z


@kernel(fastmath={"contract"})
def _backward(first, end, start, row, value, inverse_pivot, X):
    """Solve ``D L^T X = X`` in place for a range of columns, from the last, for X (n, 3)."""
    one = np.uint32(1)
    # A row subtracts first the terms that are known first, and has two sums, so that the processor does not
    # wait for the last addition.
    for j in range(end - 1, first - 1, -1):
        d, k, begin = inverse_pivot[j], start[j + 1], start[j]
        x, y, z = d * X[j, 0], d * X[j, 1], d * X[j, 2]
        a = b = c = 0.0
        while k > begin + one:
            i, v, h, w = row[k - one], value[k - one], row[k - one - one], value[k - one - one]
            x -= v * X[i, 0]
            y -= v * X[i, 1]
            z -= v * X[i, 2]
            a += w * X[h, 0]
            b += w * X[h, 1]
            c += w * X[h, 2]
            k -= one + one
        if k > begin:
            i, v = row[begin], value[begin]
            x -= v * X[i, 0]
            y -= v * X[i, 1]
            z -= v * X[i, 2]
        X[j, 0], X[j, 1], X[j, 2] = x - a, y - b, z - c
