"""Multigrid for Laplacians: a V-cycle that stands in for a factorisation, in linear time and memory.

Levels are made by smoothed aggregation, from the matrix alone: a vertex and its strong
neighbours become one of the next level, piecewise constants are smoothed by one damped Jacobi
step, and the coarse matrix is Galerkin's ``P^T A P``. The smoother is a Chebyshev polynomial of
the fourth kind in ``D^-1 A`` with ``D_ii = sum_j |A_ij|``, before and after the coarse correction, on the
finest level of lower degree if asked for;
the coarsest level is factorised. No eigenvalue is estimated: D - A is diagonally dominant, so
that the eigenvalues of D^-1 A are at most 1, and the error polynomials stay under 1 in size.

The V-cycle M is therefore linear, symmetric and positive definite, with eigenvalues of M A in (0, 1]: a
step ``x + M (b - A x)`` shrinks every error in the energy norm, with degree 3 to 0.45 to 0.65 of it on
well-shaped triangles, and the same step down a function that a quadratic with the matrix A majorises never
raises it. Triangles without area cost nothing, as rows are only joined where they are strongly
coupled; on meshes of long ones (1 : 5) 0.9 is left. Threads share rows, which do not depend on each
other: bits do not depend on the number of threads.

Levels are made in double precision, one after the other, and kept in single precision: half of the memory
and of its traffic. What is said of M holds to rounding then, some 1e-6.

P. Vanek, J. Mandel, M. Brezina, "Algebraic multigrid by smoothed aggregation for second and fourth
order elliptic problems", Computing 56, 1996; J. Lottes, "Optimal polynomial smoothers for multigrid
V-cycles", Numerical Linear Algebra with Applications 30, 2023; A. H. Baker, R. D. Falgout,
T. V. Kolev, U. M. Yang, "Multigrid smoothers for ultraparallel computing", SIAM J. Sci. Comput. 33,
2011 (the diagonal D).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.sparse import csr_array, vstack

from sshade.solver.factorisation import Factorisation
from sshade.threads import ThreadTeam

#: Unknowns up to which a level is factorised.
COARSEST = 3000
#: A level that has more than this share of the finer one's unknowns is not worth its time.
LITTLE = 0.7
#: Factors a, b of the smoother's steps ``d = a d + b D^-1 r``; so many are its degree, the first of them one
#: of a lower degree.
SMOOTHER = [(0.0, 4 / 3), (1 / 5, 12 / 5), (3 / 7, 20 / 7)]
#: Rows of products of matrices that a thread makes at a time.
PRODUCTS = 32_768
#: Of the Jacobi step that smooths the prolongation.
DAMPING = 4 / 3
#: Rows i, j are weakly coupled by an entry up to this x sqrt(A_ii A_jj).
WEAK = 0.08


class Multigrid:
    """V-cycles for a sparse symmetric matrix A; for one caller at a time.

    Parameters
    ----------
    A : (n, n) csr_array float64
        Positive definite without the rows and columns that are held; both triangles must be
        stored, with int32 indices.
    held : (n,) bool
        Rows that are left out: vectors are zero there.
    coarsest : int
        Unknowns up to which a level is factorised.
    degree : int
        Of the smoother on the finest level, 1 to 3; on the others it is 3. There each degree costs as much as
        a coarser level altogether.
    team : ThreadTeam, optional
        Threads that make levels.

    Attributes
    ----------
    sizes : list of int
        Unknowns of each level, the finest first, those held included.

    Raises
    ------
    FloatingPointError
        When the coarsest matrix is not positive definite to rounding, or has entries that are not finite.
    """

    def __init__(
        self,
        A: csr_array,
        held: np.ndarray,
        *,
        coarsest: int = COARSEST,
        degree: int = len(SMOOTHER),
        team: ThreadTeam | None = None,
    ) -> None:
        team = team or ThreadTeam(1)
        self._levels: list[_Level] = []
        self._finest = SMOOTHER[:degree]
        while A.shape[0] > coarsest:
            inverse, P = _prolongation(A, held, team)
            if P.shape[1] > LITTLE * A.shape[0]:
                break
            R = csr_array(P.T)
            self._levels.append(_Level(A, P, R, inverse))
            A = _product(R, _product(A, P, team), team)
            held = np.zeros(A.shape[0], dtype=bool)
        self._free = np.flatnonzero(~held)
        self._coarsest = Factorisation(A[self._free][:, self._free])
        self.sizes = [*(len(level.x) for level in self._levels), A.shape[0]]

    def apply(self, B: np.ndarray, X: np.ndarray, *, team: ThreadTeam) -> None:
        """Write M B to X, both (n, 3) and zero in rows that are held; X may be B.

        B may have any size that a float64 has: it is worked on over its largest entry.
        """
        if not self._levels:
            solution = self._coarsest.solve(B[self._free])
            X[:] = 0.0
            X[self._free] = solution
            return
        size = max(team.ranges(lambda *own: np.abs(B[slice(*own)]).max(), len(B))) or 1.0
        x = self._cycle(0, B, 1.0 / size, team)
        team.ranges(lambda *own: np.multiply(x[slice(*own)], size, out=X[slice(*own)], dtype=float), len(B))

    @property
    def finest(self) -> tuple[np.ndarray, ...] | None:
        """A as cycles have it: starts, columns and values of its rows; None where it is factorised itself."""
        return self._levels[0].matrix[:3] if self._levels else None

    def _cycle(self, depth: int, B: np.ndarray, scale: float, team: ThreadTeam) -> np.ndarray:
        if depth == len(self._levels):
            X = np.zeros(B.shape, dtype=np.float32)
            X[self._free] = self._coarsest.solve(B[self._free])
            return X
        level, smoother = self._levels[depth], SMOOTHER if depth else self._finest
        level.begin(B, scale, team)
        for a, b in smoother[1:]:
            level.step(a, b, team)
        level.prolong(self._cycle(depth + 1, level.restrict(team), 1.0, team), team)
        for a, b in smoother:
            level.step(a, b, team)
        return level.x


def _product(A: csr_array, B: csr_array, team: ThreadTeam) -> csr_array:
    """A B; SciPy lets go of the GIL, and each row is made as it is in the whole."""
    if A.shape[0] <= PRODUCTS:
        return csr_array(A @ B)
    return csr_array(vstack(team.ranges(lambda *own: A[slice(*own)] @ B, A.shape[0], rows=PRODUCTS)))


def _prolongation(A: csr_array, held: np.ndarray, team: ThreadTeam) -> tuple[np.ndarray, csr_array]:
    """The inverse (n,) of the smoother's diagonal, 0 where held, and P (n, c)."""
    n = A.shape[0]
    inverse, diagonal = np.empty((2, n))
    _diagonals(A.indptr, A.indices, A.data, held, inverse, diagonal)
    aggregate, count = _aggregates(A.indptr, A.indices, A.data, held, WEAK * np.sqrt(diagonal))
    start = np.concatenate([[0], np.cumsum(~held)]).astype(np.int32)
    T = csr_array((np.ones(start[-1]), aggregate[~held], start), shape=(n, count))
    smooth = _product(A, T, team)
    smooth.data *= np.repeat(-DAMPING * inverse, np.diff(smooth.indptr))
    P = csr_array(T + smooth)
    P.eliminate_zeros()
    return inverse, P


class _Level:
    """A matrix A (n, n), its smoother and its prolongation P (n, c), with work arrays.

    Between calls r is what is left of the right-hand side without A d, d the last move, x their sum.
    """

    def __init__(self, A: csr_array, P: csr_array, R: csr_array, inverse: np.ndarray) -> None:
        self.matrix = *_single(A), inverse.astype(np.float32)
        self._down, self._up = _single(R), _single(P)
        self._r, self._d, self._e, self.x = np.empty((4, A.shape[0], 3), dtype=np.float32)
        self._coarse = np.empty((P.shape[1], 3), dtype=np.float32)

    def begin(self, B: np.ndarray, scale: float, team: ThreadTeam) -> None:
        """The smoother's first step, from 0, for `scale` times B (n, 3)."""
        inverse, b = self.matrix[-1], np.float32(SMOOTHER[0][1])
        team.ranges(lambda *own: _begin(*own, inverse, b, scale, B, self._r, self._d, self.x), len(B))

    def step(self, a: float, b: float, team: ThreadTeam) -> None:
        """``r -= A d``, ``d = a d + b D^-1 r``, ``x += d``."""
        r, d, e, factors = self._r, self._d, self._e, (np.float32(a), np.float32(b))
        team.ranges(lambda *own: _step(*own, *self.matrix, *factors, r, d, e, self.x), len(r))
        self._d, self._e = e, d

    def restrict(self, team: ThreadTeam) -> np.ndarray:
        """``r -= A d``, and (c, 3) ``P^T r``."""
        r, d = self._r, self._d
        team.ranges(lambda *own: _subtract(*own, *self.matrix, d, r), len(r))
        team.ranges(lambda *own: multiply(*own, *self._down, r, self._coarse), len(self._coarse))
        return self._coarse

    def prolong(self, X: np.ndarray, team: ThreadTeam) -> None:
        """``d = P X``, ``x += d``."""
        team.ranges(lambda *own: _prolong(*own, *self._up, X, self._d, self.x), len(self.x))


def _single(A: csr_array) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    start, column, value = compressed_rows(A)
    return start, column, value.astype(np.float32)


def compressed_rows(A: csr_array) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Starts, columns and values of a sparse matrix for kernels.

    Indices are unsigned: without the test for negative ones, which numba counts from the end, a
    product takes half the time.
    """
    start, column = (array.astype(np.int32, copy=False).view(np.uint32) for array in (A.indptr, A.indices))
    return start, column, A.data


@njit(cache=True, nogil=True)
def _diagonals(start, column, value, held, inverse, diagonal):
    """The diagonal of a matrix, and 1 / the sum of each row's absolute values, 0 where held."""
    for i in range(len(diagonal)):
        total = diagonal[i] = 0.0
        for k in range(start[i], start[i + 1]):
            total += abs(value[k])
            if column[k] == i:
                diagonal[i] = value[k]
        inverse[i] = 1.0 / total if total > 0.0 and not held[i] else 0.0


@njit(cache=True, nogil=True)
def _aggregates(start, column, value, held, least):
    """The aggregate of each row, -1 where held, and their number.

    Rows i and j are strongly coupled by an entry larger than ``least_i least_j``. A row without a
    strong neighbour in an aggregate makes one with all of its strong neighbours; of those left over each
    joins that of its strongest neighbour, if there is one, or else makes one with others left over.
    """
    n, count = len(held), 0
    aggregate = np.full(n, -1, dtype=np.int32)
    for i in range(n):
        alone = not held[i] and aggregate[i] < 0
        for k in range(start[i], start[i + 1]):
            j = column[k]
            alone = alone and not (aggregate[j] >= 0 and abs(value[k]) > least[i] * least[j])
        if alone:
            for k in range(start[i], start[i + 1]):
                j = column[k]
                if not held[j] and (j == i or abs(value[k]) > least[i] * least[j]):
                    aggregate[j] = count
            count += 1
    first = aggregate.copy()
    for i in range(n):
        if not held[i] and first[i] < 0:
            strongest = 0.0
            for k in range(start[i], start[i + 1]):
                j, v = column[k], abs(value[k])
                if first[j] >= 0 and v > least[i] * least[j] and v > strongest:
                    aggregate[i], strongest = first[j], v
    for i in range(n):
        if not held[i] and aggregate[i] < 0:
            for k in range(start[i], start[i + 1]):
                j = column[k]
                free = not held[j] and aggregate[j] < 0
                if free and (j == i or abs(value[k]) > least[i] * least[j]):
                    aggregate[j] = count
            count += 1
    return aggregate, count


@njit(cache=True, nogil=True)
def _begin(first, end, inverse, b, scale, B, r, d, X):
    for i in range(first, end):
        f = b * inverse[i]
        for c in range(3):
            r[i, c] = scale * B[i, c]
            d[i, c] = f * r[i, c]
            X[i, c] = d[i, c]


@njit(cache=True, nogil=True)
def _step(first, end, start, column, value, inverse, a, b, r, d, e, X):
    for i in range(first, end):
        x, y, z = _less(start, column, value, d, r, i)
        r[i, 0], r[i, 1], r[i, 2] = x, y, z
        f = b * inverse[i]
        x, y, z = a * d[i, 0] + f * x, a * d[i, 1] + f * y, a * d[i, 2] + f * z
        e[i, 0], e[i, 1], e[i, 2] = x, y, z
        X[i, 0] += x
        X[i, 1] += y
        X[i, 2] += z


@njit(cache=True, nogil=True)
def _subtract(first, end, start, column, value, inverse, d, r):
    for i in range(first, end):
        r[i, 0], r[i, 1], r[i, 2] = _less(start, column, value, d, r, i)


@njit(cache=True, nogil=True)
def multiply(first, end, start, column, value, F, out):
    """Write rows of a sparse matrix times F to `out`."""
    for i in range(first, end):
        out[i, 0], out[i, 1], out[i, 2] = _row(start, column, value, F, i)


@njit(cache=True, nogil=True)
def _prolong(first, end, start, column, value, F, d, X):
    for i in range(first, end):
        x, y, z = _row(start, column, value, F, i)
        d[i, 0], d[i, 1], d[i, 2] = x, y, z
        X[i, 0] += x
        X[i, 1] += y
        X[i, 2] += z


@njit(cache=True, nogil=True)
def _less(start, column, value, d, r, i):
    """Row i of ``r - A d``."""
    x, y, z = r[i, 0], r[i, 1], r[i, 2]
    for k in range(start[i], start[i + 1]):
        j, v = column[k], value[k]
        x -= v * d[j, 0]
        y -= v * d[j, 1]
        z -= v * d[j, 2]
    return x, y, z


@njit(cache=True, nogil=True)
def _row(start, column, value, F, i):
    """Row i of A F."""
    x = y = z = F.dtype.type(0.0)
    for k in range(start[i], start[i + 1]):
        j, v = column[k], value[k]
        x += v * F[j, 0]
        y += v * F[j, 1]
        z += v * F[j, 2]
    return x, y, z
