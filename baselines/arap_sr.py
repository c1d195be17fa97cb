"""ARAP with smooth rotations (ARAP-SR, also SR-ARAP) at full resolution.

    E = sum_i sum_j w_ij |e'_ij - R_i e_ij|^2 + alpha A sum_i sum_j v_ij |R_i - R_j|_F^2

with e_ij = p_i - p_j at rest and e'_ij deformed, w_ij the cotangent weights, A
the rest area (which frees alpha of the model's scale) and v_ij = 1 / deg(i). Its
global step is that of spokes ARAP; the local step of vertex i maximises
``tr(R_i S~_i)``, ``S~_i = sum_j w_ij e_ij e'_ij^T + (alpha A / deg(i)) sum_j R_j^T``.

The second term outweighs the first by about alpha n : 1, so that rotations
spread by diffusion and the iterations needed grow like n: on dense meshes the
method stops at the cutoff, far from its minimum. Anderson acceleration of the
positions and rotations together, not part of the paper, reaches it in about a
hundred iterations.

Z. Levi, C. Gotsman, "Smooth rotation enhanced as-rigid-as-possible mesh
animation", IEEE TVCG 21(2), 2015.
"""

from __future__ import annotations

from time import perf_counter
from typing import Literal

import numpy as np
from numba import njit
from scipy.sparse import coo_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from baselines.global_step import GlobalStep, iterate
from sshade.anderson import Anderson
from sshade.coarse import Start, initial_guess
from sshade.cotangents import edge_weights, half_cotangents, laplacian_matrix
from sshade.errors import InputError
from sshade.linalg import Engine
from sshade.mesh import Mesh
from sshade.rotations import fit_rotations, right_hand_side
from sshade.task import DeformationResult, DeformationTask, Progress, rigid_motion, silent

#: Differences that the acceleration keeps.
WINDOW = 5
#: A step this much longer than the one before it ends an acceleration; it begins anew.
LONGER = 2.0


def arap_sr(
    task: DeformationTask,
    *,
    alpha: float = 0.02,
    clamp: bool = True,
    accelerate: bool = False,
    tolerance: float = 1e-5,
    max_iterations: int = 1000,
    start: Start = "rest",
    first_step: Literal["local", "global"] = "local",
    engine: Engine = "auto",
    seed: int = 0,
    progress: Progress = silent,
) -> DeformationResult:
    """Deform with ARAP-SR; one iteration is a sweep over the rotations, then a global step.

    The sweep is Gauss-Seidel, each rotation from the newest ones of its
    neighbours, in the order of a greedy colouring (see :func:`vertex_colours`).
    Compared with Jacobi's two buffers the rotations spread about twice as far
    in a sweep, and the result depends on no number of threads. CGAL sweeps the
    vertices in their order instead, which differs little.

    Differences from CGAL's SRE_ARAP: the local step comes first, as everywhere in
    this project (see `first_step`); a boundary edge has one weight, where
    CGAL's counts from one of its ends only; a residual of positions stops it,
    not the energy without its rotation term, nor after 5 iterations. From
    Open3D's "Smoothed": Gauss-Seidel for Jacobi, half its weight on boundary
    edges, each cotangent clamped and not their mean, smoothing from the first
    iteration; its default alpha of 0.01 with a factor of 2 is the same term.

    Parameters
    ----------
    task : DeformationTask
        Its mesh may have a boundary and several components; no zero-area triangle.
    alpha : float
        Weight of the rotations' smoothness. 0 is ARAP, infinity one rotation for all.
    clamp : bool
        Raise negative cotangents to zero, as CGAL does; without, the energy has no lower
        bound of zero where angles are obtuse.
    accelerate : bool
        Anderson acceleration, off in the paper.
    tolerance : float
        Residual, relative to the diagonal, under which iteration stops. 0 never stops early.
    max_iterations : int
        Cutoff; the paper's is 1000.
    start : {"rest", "rigid"}
        See :func:`sshade.coarse.initial_guess`.
    first_step : {"local", "global"}
        ``global`` begins with the start's rotations and forgets its positions, as CGAL does;
        where the energy has several minima this may lead to another one. The rotations are
        those that fit the task's guess, or else one for all.
    engine : {"auto", "superlu", "cholespy"}
        See :func:`sshade.linalg.factor`.
    seed : int
        Unused: the method is deterministic.
    progress : Progress

    Returns
    -------
    DeformationResult
        ``extra`` holds ``rotations`` (n, 3, 3) of the last sweep, ``residual``,
        ``restarts`` of the acceleration, ``colours`` and ``engine``.

    Raises
    ------
    InputError
        On an unknown start, first step or engine, or an alpha that is negative or infinite.
    FloatingPointError
        When triangles have no area.
    """
    if not 0 <= alpha < np.inf:
        raise InputError(f"alpha={alpha!r} is no weight; it takes a number from 0")
    if first_step not in ("local", "global"):
        raise InputError(f"unknown first step {first_step!r}; use 'local' or 'global'")
    begin = perf_counter()
    mesh, handles = task.mesh, task.handles
    U = initial_guess(task, start)
    R0 = rigid_motion(mesh.V[handles.index], handles.target)[0] if start == "rigid" else np.eye(3)
    colour = vertex_colours(mesh)
    # Kernels meet the vertices colour by colour, and neighbours close together within a colour.
    order = np.lexsort((_band_position(mesh), colour))
    position = np.empty_like(order)
    position[order] = np.arange(mesh.n)
    cells = _Cells(Mesh(mesh.V[order], position[mesh.F]), alpha=alpha, clamp=clamp, colour=colour[order])
    held = position[handles.index]
    global_step = GlobalStep(cells.laplacian, held, targets=handles.target, engine=engine)
    precomputed = perf_counter()

    Q, R = cells.rotations(R0)
    before, B = Q.copy(), np.empty((mesh.n, 3))
    to_fit = first_step == "local"

    def advance(u: np.ndarray, out: np.ndarray) -> None:
        nonlocal to_fit
        before[:] = Q
        if to_fit:
            cells.fit(u, Q, R)
        to_fit = True
        right_hand_side(cells.corners, cells.Y, R, B)
        global_step.solve(B, out)

    acceleration = _Acceleration(mesh.n, scale=mesh.diagonal) if accelerate else None

    def mix(u: np.ndarray, g: np.ndarray) -> None:
        if acceleration is None:
            u[:] = g
        else:
            acceleration.mix(u, g, before=before, Q=Q)
            _matrices(Q, R)

    u = U[order]
    if task.guess is not None:
        cells.fit(u, Q, R, smooth=False)
    iterations, residual = iterate(
        advance,
        u,
        scale=mesh.diagonal,
        tolerance=tolerance,
        max_iterations=max_iterations,
        progress=progress,
        mix=mix,
    )
    return DeformationResult(
        vertices=u[position],
        iterations=iterations,
        converged=residual < tolerance,
        seconds={"precompute": precomputed - begin, "solve": perf_counter() - precomputed},
        extra={
            "rotations": R.reshape(-1, 3, 3)[position],
            "residual": residual,
            "restarts": acceleration.restarts if acceleration else 0,
            "colours": int(colour.max()) + 1,
            "engine": global_step.engine,
        },
    )


def vertex_colours(mesh: Mesh) -> np.ndarray:
    """Greedy colouring in the order of the vertices: no edge has two ends of one colour.

    Vertices of a colour do not see each other, so their order in a sweep means nothing.

    Returns
    -------
    (n,) int64
        Counted from 0; at most one more than the highest degree.
    """
    adjacency = _symmetric(mesh, np.ones(len(mesh.edges)), edges=mesh.edges)
    return _greedy_colours(adjacency.indptr, adjacency.indices)


class _Cells:
    """The vertex cells of a mesh whose vertices are sorted by colour.

    Attributes
    ----------
    laplacian : (n, n) sparse float64
    corners : (e, 2) int32
    Y : (e, 1, 3) float64
        The edges as elements of :mod:`sshade.rotations`.
    """

    def __init__(self, mesh: Mesh, *, alpha: float, clamp: bool, colour: np.ndarray) -> None:
        h = half_cotangents(mesh)
        if clamp:
            # Two angles of a triangle are acute at least, so the positive edges connect its
            # corners and the Laplacian keeps its rank.
            h = np.maximum(h, 0.0)
        edges, weights = edge_weights(mesh, h)
        self.laplacian = laplacian_matrix(mesh.n, edges, weights)
        self.corners = edges.astype(np.int32)
        self.Y = (weights[:, None] * (mesh.V[edges[:, 0]] - mesh.V[edges[:, 1]]))[:, None]
        star = _symmetric(mesh, weights, edges=edges)
        degree = np.diff(star.indptr)
        centre = np.repeat(np.arange(mesh.n), degree)
        self._start, self._neighbour = star.indptr, star.indices
        self._edges = star.data[:, None] * (mesh.V[centre] - mesh.V[star.indices])
        self._smooth = alpha * mesh.area / degree
        self._first = np.searchsorted(colour, np.arange(colour[-1] + 2))

    def rotations(self, R0: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Quaternions (n, 4) and matrices (n, 9), all of the rotation R0."""
        from scipy.spatial.transform import Rotation

        n = len(self._smooth)
        x, y, z, w = Rotation.from_matrix(R0).as_quat()
        return np.tile([w, x, y, z], (n, 1)), np.tile(R0.ravel(), (n, 1))

    def fit(self, P: np.ndarray, Q: np.ndarray, R: np.ndarray, *, smooth: bool = True) -> None:
        """One sweep: fit all rotations to positions P (n, 3), replacing Q and R."""
        weight = self._smooth if smooth else np.zeros_like(self._smooth)
        _sweep(self._start, self._neighbour, self._edges, weight, self._first, P, Q, R)


class _Acceleration:
    """Anderson acceleration of positions and quaternions as one vector; see :mod:`sshade.anderson`.

    The rotations are part of what is iterated: a sweep does not fit them to the
    positions alone. The sweep decreases no energy that could tell a bad iterate
    from a good one, so the length of the step does: where it grows by more than
    :data:`LONGER`, the plain iterate is taken and the history dropped.
    """

    def __init__(self, n: int, *, scale: float) -> None:
        self.restarts = 0
        self._scale, self._last = scale, np.inf
        self._x, self._g = np.empty(7 * n), np.empty(7 * n)
        self._mixer = Anderson(7 * n, WINDOW)

    def mix(self, u: np.ndarray, g: np.ndarray, *, before: np.ndarray, Q: np.ndarray) -> None:
        """Replace u and Q, which led from `u` and `before` to `g` and `Q`, by the next iterate."""
        n, x, out = len(u), self._x, self._g
        for vector, positions, quaternions in ((x, u, before), (out, g, Q)):
            np.divide(positions.ravel(), self._scale, out=vector[: 3 * n])
            vector[3 * n :] = quaternions.ravel()
        step = float(np.linalg.norm(out - x))
        if step > LONGER * self._last:
            self.restarts += 1
            self._mixer = Anderson(len(x), WINDOW)
            u[:] = g
        else:
            self._mixer.advance(x, out)
            u[:] = self._scale * x[: 3 * n].reshape(n, 3)
            Q[:] = x[3 * n :].reshape(n, 4)
        self._last = step


def _symmetric(mesh: Mesh, values: np.ndarray, *, edges: np.ndarray):
    """Symmetric (n, n) matrix with a value at each edge, zeros kept, columns ascending."""
    i, j = edges.T
    both = (np.concatenate([i, j]), np.concatenate([j, i]))
    matrix = coo_array((np.tile(values, 2), both), shape=(mesh.n, mesh.n)).tocsr()
    matrix.sort_indices()
    return matrix


def _band_position(mesh: Mesh) -> np.ndarray:
    """(n,) place of each vertex in an order that keeps neighbours close in memory."""
    adjacency = _symmetric(mesh, np.ones(len(mesh.edges)), edges=mesh.edges)
    position = np.empty(mesh.n, dtype=np.int64)
    position[reverse_cuthill_mckee(adjacency, symmetric_mode=True)] = np.arange(mesh.n)
    return position


@njit(cache=True, nogil=True)
def _greedy_colours(start, neighbour):
    n = len(start) - 1
    colour = np.full(n, -1, dtype=np.int64)
    seen = np.full(n + 1, -1, dtype=np.int64)
    for i in range(n):
        for p in range(start[i], start[i + 1]):
            c = colour[neighbour[p]]
            if c >= 0:
                seen[c] = i
        c = 0
        while seen[c] == i:
            c += 1
        colour[i] = c
    return colour


@njit(cache=True, nogil=True)
def _sweep(start, neighbour, edges, smooth, first, P, Q, R):
    """Gauss-Seidel over the colours; `first` is where each begins."""
    for colour in range(len(first) - 1):
        begin, end = first[colour], first[colour + 1]
        for i in range(begin, end):
            # No vertex of this colour reads R[i], so it holds the covariance meanwhile.
            S = R[i]
            S[:] = 0.0
            for p in range(start[i], start[i + 1]):
                j = neighbour[p]
                x, y, z = P[i, 0] - P[j, 0], P[i, 1] - P[j, 1], P[i, 2] - P[j, 2]
                for r in range(3):
                    e = edges[p, r]
                    S[3 * r] += e * x + smooth[i] * R[j, r]
                    S[3 * r + 1] += e * y + smooth[i] * R[j, 3 + r]
                    S[3 * r + 2] += e * z + smooth[i] * R[j, 6 + r]
        fit_rotations(R[begin:end], Q[begin:end])


@njit(cache=True, nogil=True)
def _matrices(Q, R):
    """Bring quaternions to unit length and write their matrices, row by row."""
    for i in range(len(Q)):
        norm = np.sqrt(Q[i, 0] ** 2 + Q[i, 1] ** 2 + Q[i, 2] ** 2 + Q[i, 3] ** 2)
        for c in range(4):
            Q[i, c] /= norm
        w, x, y, z = Q[i, 0], Q[i, 1], Q[i, 2], Q[i, 3]
        R[i, 0], R[i, 1], R[i, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
        R[i, 3], R[i, 4], R[i, 5] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
        R[i, 6], R[i, 7], R[i, 8] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
