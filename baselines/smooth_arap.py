"""Smooth ARAP: as rigid as possible in its edges and in its Laplacian vectors.

    E = (1 - l) / 2 sum_i sum_j w_ij |e'_ij - R_i e_ij|^2 + l sum_i (1 / a_i) |(L p)_i - b_i(R)|^2

over the neighbours j of i, with 0 <= l < 1, L the cotangent Laplacian, b(R) the right-hand side of ARAP's
global step and a_i the vertex areas over their mean. The rotations are fitted to the edges alone, as
in ARAP; the global step solves

    [l L A^-1 L + (1 - l) L] p = l L A^-1 b(R) + (1 - l) b(R),   A = diag(a),

with the handle vertices eliminated. The second term weighs as a bi-Laplacian does, which is smooth at
handles of a single vertex, where ARAP has spikes. As a is without unit, l is tied to the spacing of the
vertices: the same l is smoother on a coarser mesh, and l / (1 - l) times the mean vertex area is the
square of a length, up to a factor.

Differences from the authors' program, of which no code was used: this is written from the formulas of
the paper; barycentric vertex areas; a residual of positions stops it; spokes and rims can take the place
of spokes.

A. Oehri, P. Herholz, O. Sorkine-Hornung, "Higher order continuity for smooth as-rigid-as-possible shape
modeling", 2025.
"""

from __future__ import annotations

from typing import get_args

import numpy as np
from scipy.sparse import csr_array, diags_array

from baselines.iteration import iterate, iterated
from baselines.stopwatch import Stopwatch
from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.options import Energy, Start
from sshade.progress import Progress, silent
from sshade.solver.cotangents import edge_weights, half_cotangents, laplacian_matrix
from sshade.solver.linear import Factorised
from sshade.solver.rotations import fit_rotations
from sshade.solver.run import Stop
from sshade.solver.start import initial_guess
from sshade.solver.terms.arap import Edges, Elements, Triangles, covariances, forces
from sshade.task import DeformationResult, DeformationTask

#: Least area of a vertex over the mean, where triangles have none: it is divided by.
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
    """Deform with Smooth ARAP, by plain local/global iterations with one factorisation.

    Its matrix has an entry for each pair of vertices with a common neighbour, three times as many as
    ARAP's, so that a factorisation of a large mesh takes several times the time and memory of ARAP's.

    Parameters
    ----------
    task : DeformationTask
        Its mesh may have a boundary, several components and triangles without area.
    smoothness : float
        l, in [0, 1). 0 is ARAP.
    energy : {"spokes", "spokes_and_rims"}
        Spokes are the authors'.
    tolerance : float
        Residual, relative to the diagonal, under which iteration stops. 0 never stops early.
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
        On a smoothness outside of [0, 1), an unknown energy or start, or soft handles.
    FloatingPointError
        When the matrix is not positive definite.
    """
    if not 0 <= smoothness < 1:
        raise InputError(f"smoothness={smoothness!r} is out of range; it takes a number from 0 to below 1")
    if energy not in get_args(Energy):
        raise InputError(f"unknown energy {energy!r}; use 'spokes' or 'spokes_and_rims'")
    watch = Stopwatch()
    mesh, handles = task.mesh, task.handles
    handles.require_hard("Smooth ARAP")
    u = initial_guess(task, start)
    h = half_cotangents(mesh)
    edges, weights = edge_weights(mesh, h)
    laplacian = laplacian_matrix(mesh.n, edges, weights)
    blend = blending_matrix(mesh, laplacian, smoothness)
    linear = Factorised(csr_array(blend @ laplacian), handles.index)
    if energy == "spokes":
        i, j = edges.T
        elements: Elements = Edges(
            edges, (weights[:, None] * (mesh.V[i] - mesh.V[j]))[:, None], weights[:, None]
        )
    else:
        elements = Triangles(mesh.F.astype(np.uint32), mesh.V, h)
    watch.end("precompute")

    R, B = np.empty((mesh.n, 9)), np.empty((mesh.n, 3))
    Q = np.tile([1.0, 0.0, 0.0, 0.0], (mesh.n, 1))

    def advance(u: np.ndarray, out: np.ndarray) -> None:
        covariances(elements, u, R, 0, mesh.n)
        fit_rotations(R, Q)
        forces(elements, u, R, B, 0, mesh.n)
        linear.solve(blend @ B, out)
        out += u

    stop = Stop(tolerance, max_iterations)
    done = iterate(advance, u, stop, diagonal=mesh.diagonal, progress=progress)
    watch.end("solve")
    return iterated(u, done, watch.seconds, rotations=R.reshape(-1, 3, 3))


def blending_matrix(mesh: Mesh, laplacian: csr_array, smoothness: float) -> csr_array:
    """(n, n) ``l L A^-1 + (1 - l) I``, which both sides of ARAP's global step are multiplied by."""
    area = mesh.vertex_areas
    share = np.maximum(area / area.mean(), LEAST_AREA)
    identity = diags_array(np.full(mesh.n, 1 - smoothness), format="csr")
    return csr_array(laplacian @ diags_array(smoothness / share, format="csr") + identity)
