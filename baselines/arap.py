"""ARAP and Elastic at full resolution through libigl, with a stopping rule, which libigl lacks.

Proof: libigl's own call, whose iterates are equal bit for bit (tests/baselines/test_arap.py).

O. Sorkine, M. Alexa, "As-rigid-as-possible surface modeling", 2007 (spokes: ARAP);
I. Chao, U. Pinkall, P. Sanan, P. Schroeder, "A simple geometric model for
elastic deformations", 2010 (spokes and rims: the paper's "Elastic").
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, get_args

import numpy as np

from baselines.hard_handles import require_hard
from baselines.iteration import Plain, iterated
from baselines.stopwatch import Stopwatch
from sshade.core.errors import InputError, counted
from sshade.core.progress import Progress, silent
from sshade.mesh.mesh import Mesh
from sshade.problem.options import ITERATION, Elements, Start, Stop, takes_options
from sshade.problem.task import DeformationResult, DeformationTask
from sshade.solver.aim import initial_guess
from sshade.solver.run import run


@takes_options(ITERATION)
def arap(
    task: DeformationTask, *, seed: int = 0, progress: Progress = silent, **options: Any
) -> DeformationResult:
    """ARAP: the spokes energy of Sorkine and Alexa (2007); see :func:`libigl_arap`."""
    return libigl_arap(task, energy="spokes", progress=progress, **options)


@takes_options(ITERATION)
def elastic(
    task: DeformationTask, *, seed: int = 0, progress: Progress = silent, **options: Any
) -> DeformationResult:
    """Elastic: the spokes-and-rims energy of Chao et al. (2010); see :func:`libigl_arap`."""
    return libigl_arap(task, energy="spokes_and_rims", progress=progress, **options)


def libigl_arap(
    task: DeformationTask,
    *,
    energy: Elements = "spokes_and_rims",
    tolerance: float = 1e-5,
    max_iterations: int = 1000,
    start: Start = "rest",
    seed: int = 0,
    progress: Progress = silent,
) -> DeformationResult:
    """Minimise an as-rigid-as-possible energy with libigl, to a residual.

    libigl runs a fixed number of local/global iterations in one call. Calls of one iteration each give
    the same bits, and the residual can be tested between them. The residual is the largest move of a
    vertex in one iteration, divided by the rest shape's bounding-box diagonal.

    Parameters
    ----------
    task : DeformationTask
        Each component needs a handle. No triangle may have zero area.
    energy : {"spokes", "spokes_and_rims"}
        Sorkine and Alexa's energy ("ARAP"), or Chao et al.'s ("Elastic").
    tolerance : float
        Residual below which the iteration stops. 0 disables the test.
    max_iterations : int
        Maximum number of iterations; the paper uses 1000.
    start : {"rest", "rigid"}
        Initialisation: the rest shape, or the best rigid motion of the handles.
    seed : int
        Unused: the method is deterministic.
    progress : Progress

    Returns
    -------
    DeformationResult
        ``extra`` holds the last ``residual``.

    Raises
    ------
    InputError
        If the energy or start is unknown, a limit is out of its range, a handle is soft, a component has no
        handle, or a triangle has zero area.
    FloatingPointError
        If the result is not finite.
    """
    if energy not in get_args(Elements):
        raise InputError(f"unknown energy {energy!r}; use 'spokes' or 'spokes_and_rims'")
    mesh, handles = task.mesh, task.handles
    require_hard(handles, "libigl's ARAP")
    mesh.require_handles(handles.index)
    require_areas(mesh)
    watch = Stopwatch()
    advance = libigl_iteration(mesh.V, mesh.F, handles.index, handles.target, energy=energy)
    watch.end("precompute")
    U = initial_guess(task, start)
    state = Plain(advance, U, diagonal=mesh.diagonal)
    done = run(state, Stop(tolerance, max_iterations), progress=progress, report_every=1)
    watch.end("solve")
    return iterated(U, done, watch.seconds)


def libigl_iteration(
    V: np.ndarray, elements: np.ndarray, index: np.ndarray, target: np.ndarray, *, energy: str
) -> Callable[[np.ndarray, np.ndarray], None]:
    """Prepare libigl's local/global solver and return its iteration.

    Parameters
    ----------
    V : (n, 3) float64
        Rest positions.
    elements : (m, 3) or (m, 4) int
        Triangles or tetrahedra.
    index : (k,) int
        Fixed vertices.
    target : (k, 3) float64
        Their positions.
    energy : {"spokes", "spokes_and_rims", "elements"}

    Returns
    -------
    callable
        ``advance(u, out)`` writes the iterate that follows u (n, 3) to `out`.
    """
    import igl

    data, target = igl.ARAPData(), np.array(target)
    data.energy = getattr(igl.ARAPEnergyType, f"ARAP_ENERGY_TYPE_{energy.upper()}")
    data.max_iter = 1
    igl.arap_precomputation(np.array(V), np.array(elements), 3, np.array(index), data)

    def advance(u: np.ndarray, out: np.ndarray) -> None:
        out[:] = igl.arap_solve(target, data, u)

    return advance


def require_areas(mesh: Mesh) -> None:
    """Raise InputError if a triangle of the rest mesh has zero area, because libigl then returns NaN."""
    if flat := int(mesh.without_area.sum()):
        raise InputError(
            f"{counted(flat, 'triangle', 'triangles')} of the rest mesh {'has' if flat == 1 else 'have'} no "
            "area, and libigl would return NaN; remove faces without area, or use accelerated_arap or "
            "accelerated_elastic"
        )
