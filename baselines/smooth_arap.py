"""Smooth ARAP: as rigid as possible in its edges and in its Laplacian vectors.

    E = (1 - l) / 2 sum_i sum_kl h_kl / 3 |e'_kl - R_i e_kl|^2
        + l / 2 sum_i (1 / a_i) |(L p)_i - R_i (L v)_i|^2

The sums run over the vertices i and the sides kl of their triangles (spokes and rims), with 0 <= l < 1. h_kl
is half the cotangent opposite the side, e a side at rest and e' the deformed side. L is the cotangent
Laplacian, v the rest positions, p the deformed positions, and a_i the mixed Voronoi area of a vertex divided
by the mean area. Rotations are fitted to the edges only, as in ARAP, and start as the identity. With b(R) the
right-hand side of ARAP's global step, the global step solves

    [l L A^-1 L + (1 - l) L] p = l L A^-1 d + (1 - l) b(R),   d_i = R_i (L v)_i,   A = diag(a),

with the handle vertices eliminated. The second term keeps the curvature of the rest shape: the surface is
smooth at a single handle vertex, where ARAP has a spike. Because a has no unit, the effect of l depends on
the spacing of the vertices. The same l is smoother on a coarser mesh.

The implementation follows the formulas of the paper and uses no code of the authors. Their programs stop at a
change of 1e-4, relative to the Frobenius norm of the rest positions. They take l = 0.99, 0.995 or a number
that the user types; 0.97 is our choice.

Proof: the authors' program, built unchanged. On a bent box and on a pulled ellipsoid, this function has the
converged results of that program (tests/baselines/test_arap.py).

A. Oehri, P. Herholz, O. Sorkine-Hornung, "Higher order continuity for smooth as-rigid-as-possible shape
modeling", 2025.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, diags_array, eye_array

from baselines.hard_handles import require_hard
from baselines.iteration import Plain, iterated, start_motion
from baselines.local_step import LocalStep
from baselines.stopwatch import Stopwatch
from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.mesh.mesh import Mesh
from sshade.problem.options import Start, Stop
from sshade.problem.task import DeformationResult, DeformationTask
from sshade.solver.aim import initial_guess
from sshade.solver.factorisation import Factorised
from sshade.solver.laplacian import edge_weights, half_cotangents, laplacian_matrix
from sshade.solver.run import run
from sshade.solver.terms.arap import Triangles

#: Least area of a vertex, as a fraction of the mean, because the method divides by areas.
LEAST_AREA = 1e-3


def smooth_arap(
    task: DeformationTask,
    *,
    smoothness: float = 0.97,
    tolerance: float = 1e-5,
    max_iterations: int = 1000,
    start: Start = "rest",
    seed: int = 0,
    progress: Progress = silent,
) -> DeformationResult:
    """Deform with Smooth ARAP by plain global and local steps with one factorisation.

    The matrix has an entry for each pair of vertices with a common neighbour, about three times as many as
    ARAP's matrix. A factorisation therefore takes several times the time and memory of ARAP's factorisation.

    Parameters
    ----------
    task : DeformationTask
        The mesh may have a boundary, several components, each with a handle, and triangles of zero area.
        The rotations are first fitted to the guess of the task, if it has one.
    smoothness : float
        l, in [0, 1). Larger values are smoother; 0 gives ARAP with spokes and rims. 0.97 is our choice.
    tolerance : float
        Residual below which the iteration stops: the largest move of a vertex in one iteration, divided by
        the bounding-box diagonal. 0 disables the test.
    max_iterations : int
    start : {"rest", "rigid"}
        The first global step turns all vertices by the identity, or by the best rigid motion of the handles.
    seed : int
        Unused: the method is deterministic.
    progress : Progress

    Returns
    -------
    DeformationResult
        ``extra`` holds the ``rotations`` (n, 3, 3) of the last local step, fitted to the result, and the
        ``residual``.

    Raises
    ------
    InputError
        If the smoothness is outside [0, 1), the start is unknown, a handle is soft, a component has no
        handle, or the matrix is not positive definite.
    """
    if not 0 <= smoothness < 1:
        raise InputError(f"smoothness={smoothness!r} is out of range; use a number from 0 to below 1")
    watch = Stopwatch()
    mesh, handles = task.mesh, task.handles
    require_hard(handles, "Smooth ARAP")
    mesh.require_handles(handles.index)
    u = initial_guess(task, start)
    h = half_cotangents(mesh)
    laplacian = laplacian_matrix(mesh.n, *edge_weights(mesh, h))
    areas = mixed_voronoi_areas(mesh, h)
    bending = laplacian @ diags_array(smoothness / np.maximum(areas / areas.mean(), LEAST_AREA))
    blend = bending + (1 - smoothness) * eye_array(mesh.n)
    linear = Factorised(csr_array(blend @ laplacian), handles.index)
    local = LocalStep(Triangles(mesh.F.astype(np.uint32), mesh.V, h), mesh.n)
    if task.guess is None:
        local.R[:] = start_motion(task, start)[0].ravel()
    else:
        local.rotations(u)
    curvature = laplacian @ mesh.V
    watch.end("precompute")

    def advance(u: np.ndarray, out: np.ndarray) -> None:
        turned = np.einsum("vij,vj->vi", local.R.reshape(-1, 3, 3), curvature)
        right = bending @ (turned - laplacian @ u) + (1 - smoothness) * local.forces(u)
        linear.solve(right, out)
        out += u
        local.rotations(out)

    state = Plain(advance, u, diagonal=mesh.diagonal)
    done = run(state, Stop(tolerance, max_iterations), progress=progress)
    watch.end("solve")
    return iterated(u, done, watch.seconds, {"rotations": local.R.reshape(-1, 3, 3)})


def mixed_voronoi_areas(mesh: Mesh, h: np.ndarray) -> np.ndarray:
    """Return the area (n,) of the mesh that is nearest to each vertex within its triangles.

    An obtuse triangle gives half of its area to its obtuse corner, and a quarter to each of the others.

    Parameters
    ----------
    mesh : Mesh
    h : (m, 3) float64
        From :func:`sshade.solver.laplacian.half_cotangents`.

    References
    ----------
    M. Meyer, M. Desbrun, P. Schroeder, A. H. Barr, "Discrete differential-geometry operators for triangulated
    2-manifolds", 2003.
    """
    corners = mesh.V[mesh.F]
    beside = 0.25 * h * np.square(corners - np.roll(corners, -1, axis=1)).sum(axis=2)
    parts = beside + np.roll(beside, 1, axis=1)
    # Corner c lies opposite the side that follows it.
    obtuse = np.roll(h, -1, axis=1) < 0
    quarters = mesh.face_areas[:, None] * np.where(obtuse, 0.5, 0.25)
    parts = np.where(obtuse.any(axis=1, keepdims=True), quarters, parts)
    return np.bincount(mesh.F.ravel(), parts.ravel(), minlength=mesh.n)
