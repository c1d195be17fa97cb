"""ARAP on coarse tetrahedra with one rotation for each tetrahedron, solved by libigl.

    E = sum_t v_t |D_t - R_t|_F^2,   D_t the deformation gradient of tetrahedron t, v_t its volume

The nodes next to handles are fixed. Barycentric coordinates prolong the result to the surface, whose handles
are then put on their targets.

Proof: libigl's own call, which comes to one minimum from both starts (tests/baselines/test_volumetric.py).

I. Chao, U. Pinkall, P. Sanan, P. Schroeder, "A simple geometric model for elastic deformations", 2010.
"""

from __future__ import annotations

from typing import Unpack

import numpy as np

from baselines.arap import libigl_iteration
from baselines.hard_handles import require_hard
from baselines.iteration import Plain, iterated, start_motion
from baselines.stopwatch import Stopwatch
from baselines.volumetric.coarse_tetrahedra import TetrahedraOptions, coarse_tetrahedra
from baselines.volumetric.node_handles import node_handles, on_targets
from sshade.core.progress import Progress, silent
from sshade.problem.options import Start, Stop
from sshade.problem.task import DeformationResult, DeformationTask
from sshade.solver.run import run


def tetrahedral_arap(
    task: DeformationTask,
    *,
    tolerance: float = 1e-5,
    max_iterations: int = 1000,
    start: Start = "rest",
    seed: int = 0,
    progress: Progress = silent,
    **options: Unpack[TetrahedraOptions],
) -> DeformationResult:
    """Minimise libigl's ARAP energy of tetrahedra, with a test of the residual after each iteration.

    Parameters
    ----------
    task : DeformationTask
        The mesh must be closed.
    tolerance : float
        Residual below which the iteration stops: the largest move of a node in one iteration, divided by
        the mesh's bounding-box diagonal. 0 disables the test.
    max_iterations : int
    start : {"rest", "rigid"}
    seed : int
        Unused: the method is deterministic.
    progress : Progress
    **options
        Size of the tetrahedra: see :class:`baselines.volumetric.coarse_tetrahedra.TetrahedraOptions`.

    Returns
    -------
    DeformationResult
        ``extra`` has ``nodes``, ``tetrahedra``, ``tetrahedra_seconds``, ``residual`` and ``handle_before``.

    Raises
    ------
    ImportError
        If pytetwild is not installed.
    InputError
        If :func:`baselines.volumetric.coarse_tetrahedra.coarse_tetrahedra` refuses the mesh, the start is
        unknown, a handle is soft, or a component of the tetrahedra has no handle.
    """
    mesh, handles = task.mesh, task.handles
    require_hard(handles, "tetrahedral ARAP")
    R, t = start_motion(task, start)
    watch = Stopwatch()
    tetrahedra = coarse_tetrahedra(mesh, **options)
    fixed = node_handles(tetrahedra, mesh, handles)
    index = fixed.index.astype(np.int32)
    advance = libigl_iteration(tetrahedra.V, tetrahedra.T, index, fixed.target, energy="elements")
    watch.end("precompute")
    u = tetrahedra.V @ R.T + t
    u[fixed.index] = fixed.target
    state = Plain(advance, u, diagonal=mesh.diagonal)
    done = run(state, Stop(tolerance, max_iterations), progress=progress)
    watch.end("solve")
    V, before = on_targets(mesh, handles, tetrahedra.carry @ u, nodes=len(u))
    watch.end("carry")
    return iterated(V, done, watch.seconds, tetrahedra.facts() | {"handle_before": before})
