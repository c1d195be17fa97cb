"""Sparse positive definite systems: factorise once, solve often, from any thread.

SuperLU finds a symmetric factorisation, of which only L and D of ``Q = P^T L D L^T P`` are kept. The
substitutions are kernels here, because SciPy's `solve` holds the GIL. SuperLU comes with SciPy, so that no
other library is needed; CHOLMOD through `cholespy` solves a system of 12,000 unknowns in three quarters of
the time, and takes 1.4 times as long to factorise it.

X. S. Li, "An overview of SuperLU", 2005; T. A. Davis, "Direct methods for sparse linear systems", 2006.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csc_array, csc_matrix, sparray, spmatrix

from sshade.kernels import kernel


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
    factors : tuple
        In that order: starts (n + 1,) uint32, rows uint32 and values float64 of the columns of L, without the
        unit diagonal, and (n,) float64 the inverse of D. Unsigned indices save the kernel tests for negative
        ones, a quarter of its time.

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
                raise _not_positive_definite() from error
            lower, pivots, position = lu.L, lu.U.diagonal(), lu.perm_c
            if not (np.array_equal(lu.perm_r, lu.perm_c) and (pivots > 0).all()):
                raise _not_positive_definite()
        lower.sort_indices()
        below = np.ones(lower.nnz, dtype=bool)
        below[lower.indptr[:-1]] = False  # the unit diagonal is the first entry of each column
        self.order = np.argsort(position).astype(np.int64)
        self.factors = (
            (lower.indptr - np.arange(n + 1)).astype(np.uint32),
            lower.indices[below].astype(np.uint32),
            lower.data[below].astype(np.float64, copy=False),
            1.0 / pivots,
        )

    def solve_ordered(self, X: np.ndarray) -> None:
        """Replace X (n, 3) float64, C-contiguous, by the solutions, both with their rows in `order`."""
        _substitute(*self.factors, X)

    def solve(self, B: np.ndarray) -> np.ndarray:
        """Solve ``Q X = B`` for B (n, c) float64; returns X (n, c)."""
        X, part = np.empty(B.shape), np.zeros((len(B), 3))
        for first in range(0, B.shape[1], 3):  # three columns at a time: mostly points or vectors
            count = min(3, B.shape[1] - first)
            part[:, :count] = B[self.order, first : first + count]
            self.solve_ordered(part)
            X[self.order, first : first + count] = part[:, :count]
        return X


def _not_positive_definite() -> FloatingPointError:
    return FloatingPointError(
        "the matrix is not positive definite; a component without a handle or a nearly "
        "zero-area triangle does this"
    )


@kernel(fastmath={"contract"})
def _substitute(start, row, value, inverse_pivot, X):
    """Solve ``L D L^T X = X`` in place, for X (n, 3)."""
    n, one = len(inverse_pivot), np.uint32(1)
    for j in range(n):
        x, y, z = X[j, 0], X[j, 1], X[j, 2]
        for k in range(start[j], start[j + 1]):
            i, v = row[k], value[k]
            X[i, 0] -= v * x
            X[i, 1] -= v * y
            X[i, 2] -= v * z
    # A row subtracts first the terms that are known first, and has two sums, so that the processor does not
    # wait for the last addition.
    for j in range(n - 1, -1, -1):
        d, k, first = inverse_pivot[j], start[j + 1], start[j]
        x, y, z = d * X[j, 0], d * X[j, 1], d * X[j, 2]
        a = b = c = 0.0
        while k > first + one:
            i, v, h, w = row[k - one], value[k - one], row[k - one - one], value[k - one - one]
            x -= v * X[i, 0]
            y -= v * X[i, 1]
            z -= v * X[i, 2]
            a += w * X[h, 0]
            b += w * X[h, 1]
            c += w * X[h, 2]
            k -= one + one
        if k > first:
            i, v = row[first], value[first]
            x -= v * X[i, 0]
            y -= v * X[i, 1]
            z -= v * X[i, 2]
        X[j, 0], X[j, 1], X[j, 2] = x - a, y - b, z - c
