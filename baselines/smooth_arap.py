"""Smooth ARAP: as rigid as possible in its edges and in its Laplacian vectors.

    E = (1 - l) / 2 sum_i sum_j w_ij |e'_ij - R_i e_ij|^2 + l sum_i (1 / a_i) |(L p)_i - b_i(R)|^2

The sums run over the vertices i and their neighbours j, with 0 <= l < 1. L is the cotangent Laplacian, b(R)
the right-hand side of ARAP's global step, and a_i the area of a vertex divided by the mean area. Rotations
are fitted to the edges only, as in ARAP. The global step solves

    [l L A^-1 L + (1 - l) L] p = l L A^-1 b(R) + (1 - l) b(R),   A = diag(a),

with the handle vertices eliminated. The second term acts like a bi-Laplacian: the surface is smooth at a
single handle vertex, where ARAP has a spike. Because a has no unit, the effect of l depends on the spacing of
the vertices. The same l is smoother on a coarser mesh.

The implementation follows the formulas of the paper and uses no code of the authors. It differs from their
program in its barycentric vertex areas, in its stopping test, and in the choice between spokes and spokes and
rims.

A. Oehri, P. Herholz, O. Sorkine-Hornung, "Higher order continuity for smooth as-rigid-as-possible shape
modeling", 2025.
"""

from __future__ import annotations

from typing import get_args

import numpy as np
from scipy.sparse import csr_array, diags_array, eye_array

from baselines.hard_handles import require_hard
from baselines.iteration import Plain, iterated
from baselines.local_step import LocalStep, spokes
from baselines.stopwatch import Stopwatch
from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.problem.options import Energy, Start
from sshade.problem.task import DeformationResult, DeformationTask
from sshade.solver.cotangents import edge_weights, half_cotangents, laplacian_matrix
from sshade.solver.factorisation import Factorised
from sshade.solver.run import Stop, initial_guess, run
from sshade.solver.terms.arap import Elements, Triangles

#: Least area of a vertex, as a fraction of the mean, because the method divides by areas.
LEAST_AREA = 1e-3


def smooth_arap(
    task: DeformationTask,
    *,
    smoothness: float = 0.97,
    energy: Energy = "spokes",
    tolerance: float = 1e-5,
    max_iterations: int = 1000,
    start: Start = "rest",
    seed: int = 0,
    progress: Progress = silent,
) -> DeformationResult:
    """Deform with Smooth ARAP by plain local/global iterations with one factorisation.

    The matrix has an entry for each pair of vertices with a common neighbour, about three times as many as
    ARAP's matrix. A factorisation therefore takes several times the time and memory of ARAP's factorisation.

    Parameters
    ----------
    task : DeformationTask
        The mesh may have a boundary, several components, each with a handle, and triangles of zero area.
    smoothness : float
        l, in [0, 1). Larger values are smoother; 0 gives ARAP.
    energy : {"spokes", "spokes_and_rims"}
        The authors use spokes.
    tolerance : float
        Residual below which the iteration stops: the largest move of a vertex in one iteration, divided by
        the bounding-box diagonal. 0 disables the test.
    max_iterations : int
    start : {"rest", "rigid"}
    seed : int
        Unused: the method is deterministic.
    progress : Progress

    Returns
    -------
    DeformationResult
        ``extra`` holds the ``rotations`` (n, 3, 3) of the last local step and the ``residual``.

    Raises
    ------
    InputError
        If the smoothness is outside [0, 1), the energy or start is unknown, a handle is soft, a
        component has no handle, or the matrix is not positive definite.
    """
    if not 0 <= smoothness < 1:
        raise InputError(f"smoothness={smoothness!r} is out of range; use a number from 0 to below 1")
    if energy not in get_args(Energy):
        raise InputError(f"unknown energy {energy!r}; use 'spokes' or 'spokes_and_rims'")
    watch = Stopwatch()
    mesh, handles = task.mesh, task.handles
    require_hard(handles, "Smooth ARAP")
    mesh.require_handles(handles.index)
    u = initial_guess(task, start)
    h = half_cotangents(mesh)
    edges, weights = edge_weights(mesh, h)
    laplacian = laplacian_matrix(mesh.n, edges, weights)
    # l L A^-1 + (1 - l) I multiplies both sides of ARAP's global step.
    area = np.maximum(mesh.vertex_areas / mesh.vertex_areas.mean(), LEAST_AREA)
    blend = laplacian @ diags_array(smoothness / area) + (1 - smoothness) * eye_array(mesh.n)
    linear = Factorised(csr_array(blend @ laplacian), handles.index)
    elements: Elements = Triangles(mesh.F.astype(np.uint32), mesh.V, h)
    if energy == "spokes":
        elements = spokes(mesh.V, edges, weights)
    local = LocalStep(elements, mesh.n)
    watch.end("precompute")

    def advance(u: np.ndarray, out: np.ndarray) -> None:
        linear.solve(blend @ local.forces(u), out)
        out += u

    state = Plain(advance, u, diagonal=mesh.diagonal)
    done = run(state, Stop(tolerance, max_iterations), progress=progress)
    watch.end("solve")
    return iterated(u, done, watch.seconds, rotations=local.R.reshape(-1, 3, 3))
