"""Interpolation by radial basis functions: SciPy's RBFInterpolator, the usual tool for dense landmarks.

Each vertex is mapped by the spline through its nearest handles, without regard to the surface. SciPy solves
one linear system for each set of nearest handles.

Proof: SciPy's own call (tests/baselines/test_arap.py).
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import RBFInterpolator

from baselines.hard_handles import require_hard
from baselines.stopwatch import Stopwatch
from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.problem.task import DeformationResult, DeformationTask

#: Number of vertices between two reports of progress.
BLOCK = 20_000


def rbf(
    task: DeformationTask,
    *,
    neighbours: int = 50,
    kernel: str = "thin_plate_spline",
    seed: int = 0,
    progress: Progress = silent,
) -> DeformationResult:
    """Interpolate between the handles.

    Parameters
    ----------
    task : DeformationTask
        Any mesh, with hard handles that span space.
    neighbours : int
        Number of nearest handles for each vertex. A larger number is more exact and slower.
    kernel : str
        A kernel of SciPy without a shape parameter, such as ``thin_plate_spline``, ``linear`` or ``cubic``.
    seed : int
        Unused: the method is deterministic.
    progress : Progress

    Returns
    -------
    DeformationResult
        ``iterations`` is 1.

    Raises
    ------
    InputError
        If a handle is soft, or SciPy refuses the handles, as where they lie in a plane.
    """
    handles, V, watch = task.handles, task.mesh.V, Stopwatch()
    require_hard(handles, "rbf")
    out = np.empty_like(V)
    try:
        spline = RBFInterpolator(V[handles.index], handles.target, neighbors=neighbours, kernel=kernel)
        for first in range(0, len(V), BLOCK):
            progress("vertices", first, len(V))
            out[first : first + BLOCK] = spline(V[first : first + BLOCK])
    except (ValueError, np.linalg.LinAlgError) as error:
        raise InputError(f"rbf: {' '.join(str(error).split())}") from error
    progress("vertices", len(V), len(V))
    out[handles.index] = handles.target
    watch.end("solve")
    return DeformationResult(out, iterations=1, converged=None, seconds=watch.seconds)
