"""Global steps without a factorisation: multigrid V-cycles in linear time and memory.

Levels are made by smoothed aggregation, from the matrix alone. A vertex and its strong neighbours are
aggregated into one vertex of the next level. Piecewise constants are smoothed by one damped Jacobi step, and
the coarse matrix is Galerkin's ``P^T A P``. The smoother before and after the coarse correction is a
Chebyshev polynomial of the fourth kind in ``D^-1 A`` with ``D_ii = sum_j |A_ij|``. Its degree may be lower on
the finest level. The coarsest level is factorised. No eigenvalue is estimated: D - A is diagonally
dominant, so that the eigenvalues of D^-1 A are at most 1, and the error polynomials stay under 1 in size.

The V-cycle M is therefore linear, symmetric and positive definite, and the eigenvalues of M A lie in (0, 1].
A step ``x + M (b - A x)`` shrinks every error in the energy norm, for degree 3 and well-shaped triangles to
0.45 to 0.65. On a function below a quadratic with the matrix A, such a step never raises the value.
Triangles of zero area cost nothing, because only strongly coupled rows are aggregated. On meshes of long
triangles (1 : 5) a step leaves 0.9 of an error. Threads share independent rows, and the result has the same
bits with any number of threads.

Levels are made in double precision and stored in single precision, which halves memory and its traffic. The
properties of M then hold up to rounding errors of about 1e-6.

In a solve, the V-cycle approximates the inverse of the Laplacian with the strain weights at its start. Its
steps still descend, because the energy lies below the quadratic energy with the present weights. The better
metric outweighs the error of the V-cycle: after the same number of steps, a polish of bodies of 25,000 and
170,000 vertices has a lower energy than with L^-1. One V-cycle for each direction of a constraint is as good
as an exact solve, and a second V-cycle for each step hardly pays.

This is not a library's multigrid: pyamg takes 2.5 times as long to set up at 41,000 unknowns, and 12 times as
long for a cycle.

P. Vanek, J. Mandel, M. Brezina, "Algebraic multigrid by smoothed aggregation for second and fourth
order elliptic problems", Computing 56, 1996; J. Lottes, "Optimal polynomial smoothers for multigrid
V-cycles", Numerical Linear Algebra with Applications 30, 2023; A. H. Baker, R. D. Falgout,
T. V. Kolev, U. M. Yang, "Multigrid smoothers for ultraparallel computing", SIAM J. Sci. Comput. 33,
2011 (the diagonal D).
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, vstack

from sshade.core.kernels import kernel, subroutine
from sshade.core.threads import ThreadTeam
from sshade.mesh.harmonic import conjugate_gradients
from sshade.solver.factorisation import Factorisation, Linear

#: Unknowns up to which a level is factorised.
COARSEST = 3000
#: Largest ratio of the unknowns of two successive levels; with a larger one a level is not worth its time.
LITTLE = 0.7
#: Factors a, b of the smoother's steps ``d = a d + b D^-1 r``. A smoother of degree k uses the first k.
SMOOTHER = [(0.0, 4 / 3), (1 / 5, 12 / 5), (3 / 7, 20 / 7)]
#: Number of rows of a matrix product that a thread makes at a time.
PRODUCTS = 32_768
#: Damping of the Jacobi step that smooths the prolongation.
DAMPING = 4 / 3
#: Rows i, j are weakly coupled by an entry up to this x sqrt(A_ii A_jj).
WEAK = 0.08


class Multigrid:
    """V-cycles for a sparse symmetric matrix A; for one caller at a time.

    Parameters
    ----------
    A : (n, n) csr_array float64
        Positive definite without the fixed rows and columns; both triangles must be stored, with int32
        indices.
    fixed : (n,) bool
        Rows that are left out; vectors are zero there.
    degree : int
        Degree of the smoother on the finest level, 1 to 3; coarser levels have 3. Each degree of the finest
        level takes as much time as all coarser levels. Smaller values make faster but weaker cycles.
    team : ThreadTeam, optional
        Threads that make levels.

    Raises
    ------
    FloatingPointError
        When the coarsest matrix is not positive definite to rounding, or has entries that are not finite.
    """

    def __init__(
        self,
        A: csr_array,
        fixed: np.ndarray,
        *,
        degree: int = len(SMOOTHER),
        team: ThreadTeam | None = None,
    ) -> None:
        team = team or ThreadTeam(1)
        self._levels: list[_Level] = []
        self._finest_smoother = SMOOTHER[:degree]
        while A.shape[0] > COARSEST:
            inverse, P = _prolongation(A, fixed, team)
            if P.shape[1] > LITTLE * A.shape[0]:
                break
            R = csr_array(P.T)
            self._levels.append(_Level(A, P, R, inverse))
            A = _product(R, _product(A, P, team), team)
            fixed = np.zeros(A.shape[0], dtype=bool)
        self._movable = np.flatnonzero(~fixed)
        self._coarsest = Factorisation(A[self._movable][:, self._movable])

    def apply(self, B: np.ndarray, X: np.ndarray, *, team: ThreadTeam) -> None:
        """Write M B to X, both (n, 3) and zero in fixed rows; X may be B.

        B may have any finite size, because it is divided by its largest entry first.
        """
        if not self._levels:
            solution = self._coarsest.solve(B[self._movable])
            X[:] = 0.0
            X[self._movable] = solution
            return
        size = max(team.ranges(lambda *own: np.abs(B[slice(*own)]).max(), len(B))) or 1.0
        x = self._cycle(0, B, 1.0 / size, team)
        team.ranges(lambda *own: np.multiply(x[slice(*own)], size, out=X[slice(*own)], dtype=float), len(B))

    @property
    def finest(self) -> tuple[np.ndarray, ...] | None:
        """Starts, columns and values of the rows of A in single precision; None if A itself is factorised."""
        return self._levels[0].matrix[:3] if self._levels else None

    def _cycle(self, depth: int, B: np.ndarray, scale: float, team: ThreadTeam) -> np.ndarray:
        """Return the V-cycle of `scale` times B on a level and all coarser levels."""
        if depth == len(self._levels):
            X = np.zeros(B.shape, dtype=np.float32)
            X[self._movable] = self._coarsest.solve(B[self._movable])
            return X
        level, smoother = self._levels[depth], SMOOTHER if depth else self._finest_smoother
        level.begin(B, scale, team)
        for a, b in smoother[1:]:
            level.step(a, b, team)
        level.prolong(self._cycle(depth + 1, level.restrict(team), 1.0, team), team)
        for a, b in smoother:
            level.step(a, b, team)
        return level.x


def _product(A: csr_array, B: csr_array, team: ThreadTeam) -> csr_array:
    """A B, in blocks of rows; SciPy releases the GIL, and blocks have the bits of the whole product."""
    if A.shape[0] <= PRODUCTS:
        return csr_array(A @ B)
    return csr_array(vstack(team.ranges(lambda *own: A[slice(*own)] @ B, A.shape[0], rows=PRODUCTS)))


def _prolongation(A: csr_array, fixed: np.ndarray, team: ThreadTeam) -> tuple[np.ndarray, csr_array]:
    """The inverse (n,) of the smoother's diagonal, 0 in fixed rows, and P (n, c)."""
    n = A.shape[0]
    total = csr_array((np.abs(A.data), A.indices, A.indptr), shape=(n, n)) @ np.ones(n)
    inverse = np.divide(1.0, total, out=np.zeros(n), where=(total > 0.0) & ~fixed)
    aggregate, count = _aggregates(A.indptr, A.indices, A.data, fixed, WEAK * np.sqrt(A.diagonal()))
    start = np.concatenate([[0], np.cumsum(~fixed)]).astype(np.int32)
    T = csr_array((np.ones(start[-1]), aggregate[~fixed], start), shape=(n, count))
    smooth = _product(A, T, team)
    smooth.data *= np.repeat(-DAMPING * inverse, np.diff(smooth.indptr))
    P = csr_array(T + smooth)
    P.eliminate_zeros()
    return inverse, P


class _Level:
    """A matrix A (n, n), its smoother and its prolongation P (n, c), with work arrays.

    Between calls, d is the last move, x the sum of all moves, and r the residual before the last move.
    """

    def __init__(self, A: csr_array, P: csr_array, R: csr_array, inverse: np.ndarray) -> None:
        self.matrix = *_single(A), inverse.astype(np.float32)
        self._down, self._up = _single(R), _single(P)
        self._r, self._d, self._e, self.x = np.empty((4, A.shape[0], 3), dtype=np.float32)
        self._coarse = np.empty((P.shape[1], 3), dtype=np.float32)

    def begin(self, B: np.ndarray, scale: float, team: ThreadTeam) -> None:
        """Take the smoother's first step, from 0, for `scale` times B (n, 3)."""
        inverse, b = self.matrix[-1], np.float32(SMOOTHER[0][1])
        team.ranges(_begin, len(B), inverse, b, scale, B, self._r, self._d, self.x)

    def step(self, a: float, b: float, team: ThreadTeam) -> None:
        """``r -= A d``, ``d = a d + b D^-1 r``, ``x += d``."""
        r, d, e, factors = self._r, self._d, self._e, (np.float32(a), np.float32(b))
        team.ranges(_step, len(r), *self.matrix, *factors, r, d, e, self.x)
        self._d, self._e = e, d

    def restrict(self, team: ThreadTeam) -> np.ndarray:
        """``r -= A d``, and (c, 3) ``P^T r``."""
        r, d = self._r, self._d
        team.ranges(_subtract, len(r), *self.matrix, d, r)
        team.ranges(multiply, len(self._coarse), *self._down, r, self._coarse)
        return self._coarse

    def prolong(self, X: np.ndarray, team: ThreadTeam) -> None:
        """``d = P X``, ``x += d``."""
        team.ranges(_prolong, len(self.x), *self._up, X, self._d, self.x)


def _single(A: csr_array) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    start, column, value = compressed_rows(A)
    return start, column, value.astype(np.float32)


def compressed_rows(A: csr_array) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return starts, columns and values of a sparse matrix for kernels.

    Indices are unsigned. A product then takes half the time, because numba need not test for negative
    indices, which count from the end.
    """
    start, column = (array.astype(np.int32, copy=False).view(np.uint32) for array in (A.indptr, A.indices))
    return start, column, A.data


@kernel
def _aggregates(start, column, value, fixed, least):
    """Return the aggregate of each row, -1 in fixed rows, and the number of aggregates.

    Rows i and j are strongly coupled by an entry larger than ``least_i least_j``. First, a row makes an
    aggregate with its strong neighbours, unless some of them are in one already. Then each remaining row
    joins the aggregate of its strongest neighbour. Rows without such a neighbour aggregate among themselves.
    """
    n, count = len(fixed), 0
    aggregate = np.full(n, -1, dtype=np.int32)
    for i in range(n):
        alone = not fixed[i] and aggregate[i] < 0
        for k in range(start[i], start[i + 1]):
            j = column[k]
            alone = alone and not (aggregate[j] >= 0 and abs(value[k]) > least[i] * least[j])
        if alone:
            for k in range(start[i], start[i + 1]):
                j = column[k]
                if not fixed[j] and (j == i or abs(value[k]) > least[i] * least[j]):
                    aggregate[j] = count
            count += 1
    first = aggregate.copy()
    for i in range(n):
        if not fixed[i] and first[i] < 0:
            strongest = 0.0
            for k in range(start[i], start[i + 1]):
                j, v = column[k], abs(value[k])
                if first[j] >= 0 and v > least[i] * least[j] and v > strongest:
                    aggregate[i], strongest = first[j], v
    for i in range(n):
        if not fixed[i] and aggregate[i] < 0:
            for k in range(start[i], start[i + 1]):
                j = column[k]
                free = not fixed[j] and aggregate[j] < 0
                if free and (j == i or abs(value[k]) > least[i] * least[j]):
                    aggregate[j] = count
            count += 1
    return aggregate, count


@kernel
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


@kernel
def _subtract(first, end, start, column, value, inverse, d, r):
    for i in range(first, end):
        r[i, 0], r[i, 1], r[i, 2] = _less(start, column, value, d, r, i)


@kernel
def multiply(first, end, start, column, value, F, out):
    """Write rows of a sparse matrix times F to `out`."""
    for i in range(first, end):
        out[i, 0], out[i, 1], out[i, 2] = _row(start, column, value, F, i)


@subroutine
def _less(start, column, value, d, r, i):
    """Row i of ``r - A d``."""
    x, y, z = r[i, 0], r[i, 1], r[i, 2]
    for k in range(start[i], start[i + 1]):
        j, v = column[k], value[k]
        x -= v * d[j, 0]
        y -= v * d[j, 1]
        z -= v * d[j, 2]
    return x, y, z


@subroutine
def _row(start, column, value, F, i):
    """Row i of A F."""
    x = y = z = F.dtype.type(0.0)
    for k in range(start[i], start[i + 1]):
        j, v = column[k], value[k]
        x += v * F[j, 0]
        y += v * F[j, 1]
        z += v * F[j, 2]
    return x, y, z


@kernel
def _begin(first, end, inverse, b, scale, B, r, d, X):
    for i in range(first, end):
        f = b * inverse[i]
        for c in range(3):
            r[i, c] = scale * B[i, c]
            d[i, c] = f * r[i, c]
            X[i, c] = d[i, c]


@kernel
def _prolong(first, end, start, column, value, F, d, X):
    for i in range(first, end):
        x, y, z = _row(start, column, value, F, i)
        d[i, 0], d[i, 1], d[i, 2] = x, y, z
        X[i, 0] += x
        X[i, 1] += y
        X[i, 2] += z


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
