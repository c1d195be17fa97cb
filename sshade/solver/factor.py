"""Sparse positive definite systems: factor once, solve often, from any thread.

The default engine lets SuperLU find a symmetric factorisation and then keeps
only L and D of ``Q = P^T L D L^T P``; the substitutions are kernels of ours.
It needs nothing that is not installed anyway, it runs without the GIL (the
solvers of cholespy and scipy hold it in `solve`), and on meshes of 6,000 to
50,000 vertices no other engine tried solves faster.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Literal

import numpy as np
from scipy.sparse import csc_array, csc_matrix, sparray, spmatrix

from sshade.errors import InputError
from sshade.solver.substitution import Branches, Factors, divide, substitute, substitute_together
from sshade.threads import Crew

Engine = Literal["auto", "superlu", "cholespy"]

ENGINES = ("auto", "superlu", "cholespy")
#: Rows from which on several threads share a substitution.
SHARED = 20_000


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
    def solve_ordered(self, X: np.ndarray, *, crew: Crew | None = None) -> None:
        """Replace right-hand sides by solutions, both with their rows in `order`.

        Parameters
        ----------
        X : (n, c) float64, C-contiguous
            Overwritten.
        crew : Crew, optional
            Threads to share the work, by engines and for sizes where that pays. The same bits.
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
                    # Of Laplacians: a quarter less time than with the defaults, and fewer explicit zeros.
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
        self._factors = Factors(
            lower.indptr.astype(np.int64) - np.arange(n + 1),
            lower.indices[below].astype(np.int32, copy=False),
            lower.data[below].astype(np.float64, copy=False),
            1.0 / pivots,
        )
        self._branches: Branches | None = None
        if n >= SHARED:
            divided, self._factors, self._branches = divide(self._factors)
            self.order = self.order[divided]

    def solve_ordered(self, X: np.ndarray, *, crew: Crew | None = None) -> None:
        if crew is None or crew.workers == 1 or self._branches is None or X.shape[1] % 3:
            substitute(self._factors, X)
        else:
            substitute_together(self._factors, self._branches, X, crew=crew)


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

    def solve_ordered(self, X: np.ndarray, *, crew: Crew | None = None) -> None:
        if self._solver is not None:
            B = X.copy()
            self._solver.solve(B, X)


def _not_positive_definite() -> FloatingPointError:
    return FloatingPointError(
        "the matrix is not positive definite; a component without a handle or a nearly "
        "zero-area triangle does this"
    )
