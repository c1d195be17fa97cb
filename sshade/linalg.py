"""Sparse positive definite systems: factor once, solve often, from any thread.

The default engine lets SuperLU find a symmetric factorisation and then keeps
only L and D of ``Q = P^T L D L^T P``; the substitutions are a kernel of ours.
It needs nothing that is not installed anyway, it runs without the GIL (the
solvers of cholespy and scipy hold it in `solve`), and on meshes of 6,000 to
50,000 vertices no other engine tried solves faster.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Literal

import numpy as np
from numba import njit
from scipy.sparse import csc_array, csc_matrix, sparray, spmatrix

from sshade.errors import InputError

Engine = Literal["auto", "superlu", "cholespy"]

ENGINES = ("auto", "superlu", "cholespy")


class Factor(ABC):
    """A factorised symmetric positive definite matrix Q of n rows.

    Attributes
    ----------
    engine : str
        Name of the library that made it.
    order : (n,) int64
        Row of Q at each position of the elimination order. Unknowns stored in
        this order need no permutation: see :meth:`solve_ordered`.
    """

    engine: str
    order: np.ndarray

    @abstractmethod
    def solve_ordered(self, X: np.ndarray) -> None:
        """Replace right-hand sides by solutions, both with their rows in `order`.

        Parameters
        ----------
        X : (n, c) float64, C-contiguous
            Overwritten.
        """

    def solve(self, B: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Solve ``Q X = B``.

        Parameters
        ----------
        B : (n, c) float64
        out : (n, c) float64, optional
            Where the solution goes; may be `B` itself.

        Returns
        -------
        (n, c) float64
            `out`, or a new array.
        """
        X = np.ascontiguousarray(B[self.order], dtype=np.float64)
        self.solve_ordered(X)
        if out is None:
            out = np.empty_like(X)
        out[self.order] = X
        return out


def factor(Q: sparray | spmatrix, *, engine: Engine = "auto") -> Factor:
    """Factorise a sparse symmetric positive definite matrix.

    Parameters
    ----------
    Q : (n, n) sparse float64
        Both triangles must be stored.
    engine : {"auto", "superlu", "cholespy"}
        ``auto`` is ``superlu``, so that an optional package changes no bit of
        a result. ``cholespy`` (CHOLMOD) has less fill beyond 100,000 rows, but
        its solves hold the GIL.

    Returns
    -------
    Factor

    Raises
    ------
    InputError
        On an unknown engine, or one that is not installed.
    FloatingPointError
        When Q is not positive definite to rounding.

    References
    ----------
    X. S. Li, "An overview of SuperLU", 2005. Y. Chen, T. A. Davis et al.,
    "Algorithm 887: CHOLMOD", 2008.
    """
    if engine not in ENGINES:
        raise InputError(f"unknown engine {engine!r}; use one of {', '.join(ENGINES)}")
    if not np.isfinite(Q.data).all():
        raise FloatingPointError("the matrix has entries that are not finite")
    return _CholespyFactor(Q) if engine == "cholespy" else _SuperLUFactor(Q)


class _SuperLUFactor(Factor):
    """``L D L^T`` out of SuperLU's symmetric mode, substituted by our kernel."""

    engine = "superlu"

    def __init__(self, Q: sparray | spmatrix) -> None:
        from scipy.sparse import tril
        from scipy.sparse.linalg import splu

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
                    options={"SymmetricMode": True},
                )
            except RuntimeError as error:  # "Factor is exactly singular"
                raise _not_positive_definite() from error
            lower, pivots, position = csc_array(tril(lu.L, -1)), lu.U.diagonal(), lu.perm_c
            if not (np.array_equal(lu.perm_r, lu.perm_c) and (pivots > 0).all()):
                raise _not_positive_definite()
        lower.sort_indices()
        self.order = np.argsort(position).astype(np.int64)
        self._start = lower.indptr.astype(np.int64)
        self._row = lower.indices.astype(np.int32)
        self._value = np.asarray(lower.data, dtype=np.float64)
        self._inverse_pivot = 1.0 / pivots

    def solve_ordered(self, X: np.ndarray) -> None:
        kernel = _SUBSTITUTE.get(X.shape[1], _substitute)
        kernel(self._start, self._row, self._value, self._inverse_pivot, X)


class _CholespyFactor(Factor):
    """CHOLMOD through the optional package cholespy."""

    engine = "cholespy"

    def __init__(self, Q: sparray | spmatrix) -> None:
        try:
            from cholespy import CholeskySolverD, MatrixType
        except ImportError as error:
            raise InputError(
                "the engine 'cholespy' is not installed; run: pip install 'sshade[fast]'"
            ) from error
        Q = csc_array(Q)
        n = Q.shape[0]
        self.order = np.arange(n, dtype=np.int64)
        self._solver = None
        if n:
            start, row = Q.indptr.astype(np.int32), Q.indices.astype(np.int32)
            try:
                self._solver = CholeskySolverD(n, start, row, Q.data, MatrixType.CSC)
            except ValueError as error:
                raise _not_positive_definite() from error

    def solve_ordered(self, X: np.ndarray) -> None:
        if self._solver is not None:
            B = X.copy()
            self._solver.solve(B, X)


def _not_positive_definite() -> FloatingPointError:
    return FloatingPointError(
        "the matrix is not positive definite; a component without a handle or a nearly "
        "zero-area triangle does this"
    )


@njit(cache=True, nogil=True)
def _substitute_three(start, row, value, inverse_pivot, X):
    """Solve L D L^T X = X for three columns; L is unit lower triangular, by columns, without diagonal."""
    n = len(inverse_pivot)
    for j in range(n):
        a, b, c = X[j, 0], X[j, 1], X[j, 2]
        for k in range(start[j], start[j + 1]):
            i, v = row[k], value[k]
            X[i, 0] -= v * a
            X[i, 1] -= v * b
            X[i, 2] -= v * c
    for j in range(n - 1, -1, -1):
        d = inverse_pivot[j]
        a, b, c = d * X[j, 0], d * X[j, 1], d * X[j, 2]
        for k in range(start[j], start[j + 1]):
            i, v = row[k], value[k]
            a -= v * X[i, 0]
            b -= v * X[i, 1]
            c -= v * X[i, 2]
        X[j, 0], X[j, 1], X[j, 2] = a, b, c


@njit(cache=True, nogil=True)
def _substitute(start, row, value, inverse_pivot, X):
    """:func:`_substitute_three` for any number of columns."""
    n, columns = X.shape
    for j in range(n):
        for k in range(start[j], start[j + 1]):
            i, v = row[k], value[k]
            for c in range(columns):
                X[i, c] -= v * X[j, c]
    for j in range(n - 1, -1, -1):
        for c in range(columns):
            X[j, c] *= inverse_pivot[j]
        for k in range(start[j], start[j + 1]):
            i, v = row[k], value[k]
            for c in range(columns):
                X[j, c] -= v * X[i, c]


@njit(cache=True, nogil=True)
def _substitute_six(start, row, value, inverse_pivot, X):
    """:func:`_substitute_three` for six columns."""
    n = len(inverse_pivot)
    for j in range(n):
        a, b, c, d, e, f = X[j, 0], X[j, 1], X[j, 2], X[j, 3], X[j, 4], X[j, 5]
        for k in range(start[j], start[j + 1]):
            i, v = row[k], value[k]
            X[i, 0] -= v * a
            X[i, 1] -= v * b
            X[i, 2] -= v * c
            X[i, 3] -= v * d
            X[i, 4] -= v * e
            X[i, 5] -= v * f
    for j in range(n - 1, -1, -1):
        p = inverse_pivot[j]
        a, b, c, d, e, f = p * X[j, 0], p * X[j, 1], p * X[j, 2], p * X[j, 3], p * X[j, 4], p * X[j, 5]
        for k in range(start[j], start[j + 1]):
            i, v = row[k], value[k]
            a -= v * X[i, 0]
            b -= v * X[i, 1]
            c -= v * X[i, 2]
            d -= v * X[i, 3]
            e -= v * X[i, 4]
            f -= v * X[i, 5]
        X[j, 0], X[j, 1], X[j, 2], X[j, 3], X[j, 4], X[j, 5] = a, b, c, d, e, f


#: Unrolled loops, by number of columns: positions, and with them the gradient of a constraint.
_SUBSTITUTE = {3: _substitute_three, 6: _substitute_six}
