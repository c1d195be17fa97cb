"""ARAP and Elastic at full resolution, through libigl, with the stopping rule that libigl lacks.

O. Sorkine, M. Alexa, "As-rigid-as-possible surface modeling", 2007 (spokes: ARAP);
I. Chao, U. Pinkall, P. Sanan, P. Schroeder, "A simple geometric model for
elastic deformations", 2010 (spokes and rims: the paper's "Elastic").
"""

from __future__ import annotations

from time import perf_counter
from typing import Unpack, get_args

import numpy as np

from baselines.global_step import iterate, iterated
from sshade.errors import InputError
from sshade.progress import Progress, silent
from sshade.solver.options import Energy, IterationOptions, Start
from sshade.solver.start import initial_guess
from sshade.task import DeformationResult, DeformationTask


def arap(
    task: DeformationTask, *, seed: int = 0, progress: Progress = silent, **options: Unpack[IterationOptions]
) -> DeformationResult:
    """ARAP: the spokes energy of Sorkine and Alexa (2007); see :func:`libigl_arap`."""
    return libigl_arap(task, energy="spokes", progress=progress, **options)


def elastic(
    task: DeformationTask, *, seed: int = 0, progress: Progress = silent, **options: Unpack[IterationOptions]
) -> DeformationResult:
    """Elastic: the spokes-and-rims energy of Chao et al. (2010); see :func:`libigl_arap`."""
    return libigl_arap(task, energy="spokes_and_rims", progress=progress, **options)


def libigl_arap(
    task: DeformationTask,
    *,
    energy: Energy = "spokes_and_rims",
    tolerance: float = 1e-5,
    max_iterations: int = 1000,
    start: Start = "rest",
    seed: int = 0,
    progress: Progress = silent,
) -> DeformationResult:
    """Minimise an as-rigid-as-possible energy with libigl, to a residual.

    libigl runs a fixed number of local/global iterations. One iteration a call
    gives the same bits, so the residual is tested in between: the largest move
    of a vertex in one iteration over the rest shape's bounding-box diagonal.

    Parameters
    ----------
    task : DeformationTask
        The mesh must have a handle in each component, which the task ensures.
    energy : {"spokes", "spokes_and_rims"}
        Sorkine and Alexa's energy ("ARAP"), or Chao et al.'s ("Elastic").
    tolerance : float
        Residual, relative to the diagonal, under which iteration stops. 0 never stops early.
    max_iterations : int
        Cutoff; the paper's is 1000.
    start : {"rest", "rigid"}
    seed : int
        Unused: the method is deterministic.
    progress : Progress

    Returns
    -------
    DeformationResult
        ``extra`` holds the last ``residual`` and the ``residual_curve`` of all.

    Raises
    ------
    InputError
        On an unknown energy or start, or triangles without area.
    FloatingPointError
        When the result is not finite.
    """
    import igl

    if energy not in get_args(Energy):
        raise InputError(f"unknown energy {energy!r}; use 'spokes' or 'spokes_and_rims'")
    mesh, handles = task.mesh, task.handles
    handles.require_hard("libigl's ARAP")
    flat = int((mesh.face_areas == 0).sum())
    if flat:
        raise InputError(
            f"{flat} triangles of the rest mesh have no area, of which libigl makes NaN; remove them, or "
            "take the accelerated method of the same energy"
        )
    begin = perf_counter()
    data = igl.ARAPData()
    data.energy = getattr(igl.ARAPEnergyType, f"ARAP_ENERGY_TYPE_{energy.upper()}")
    data.max_iter = 1
    igl.arap_precomputation(np.array(mesh.V), np.array(mesh.F), 3, np.array(handles.index), data)
    precomputed = perf_counter()

    targets, U = np.array(handles.target), initial_guess(task, start)

    def advance(u: np.ndarray, out: np.ndarray) -> None:
        out[:] = igl.arap_solve(targets, data, u)

    residuals = iterate(
        advance,
        U,
        scale=mesh.diagonal,
        tolerance=tolerance,
        max_iterations=max_iterations,
        progress=progress,
        report_every=1,
    )
    return iterated(
        U,
        residuals,
        tolerance=tolerance,
        seconds={"precompute": precomputed - begin, "solve": perf_counter() - precomputed},
    )
