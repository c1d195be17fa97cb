"""ARAP on coarse tetrahedra: a rotation for each, as libigl has it.

    E = sum_t v_t |D_t - R_t|_F^2,   D_t the deformation gradient of tetrahedron t, v_t its volume

Nodes next to handles are held; the surface is carried by barycentric coordinates, then its handles are put
on their targets.

I. Chao, U. Pinkall, P. Sanan, P. Schroeder, "A simple geometric model for elastic deformations", 2010.
"""

from __future__ import annotations

from time import perf_counter
from typing import Unpack

import numpy as np

from baselines.global_step import iterate, iterated
from baselines.start_motion import start_motion
from baselines.volumetric.coarse_tetrahedra import TetrahedraOptions, coarse_tetrahedra
from baselines.volumetric.node_handles import node_handles, on_targets, rigid_parts
from sshade.progress import Progress, silent
from sshade.solver.options import Start
from sshade.task import DeformationResult, DeformationTask


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
    """Deform with libigl's ARAP of elements on tetrahedra, one iteration a call, to a residual.

    Parameters
    ----------
    task : DeformationTask
        Its mesh must be closed.
    tolerance : float
        Residual of the nodes, over the mesh's diagonal. 0 never stops early.
    max_iterations : int
    start : {"rest", "rigid"}
    seed : int
        Unused: the method is deterministic.
    progress : Progress
    **options
        See :class:`baselines.volumetric.coarse_tetrahedra.TetrahedraOptions`.

    Returns
    -------
    DeformationResult
        ``extra`` has ``nodes``, ``tetrahedra``, ``tetrahedra_seconds``, ``residual`` and ``handle_before``.

    Raises
    ------
    ImportError
        When pytetwild is not installed.
    InputError
        As of :func:`baselines.volumetric.coarse_tetrahedra.coarse_tetrahedra`, on an unknown start or
        soft handles, or when tetrahedra hang together without a handle.
    """
    import igl

    mesh, handles = task.mesh, task.handles
    handles.require_hard("tetrahedral ARAP")
    R, t = start_motion(task, start)
    begin = perf_counter()
    tetrahedra = coarse_tetrahedra(mesh, **options)
    held = node_handles(tetrahedra, mesh, handles, rigid_parts(mesh, handles))
    data = igl.ARAPData()
    data.energy = igl.ARAPEnergyType.ARAP_ENERGY_TYPE_ELEMENTS
    data.max_iter = 1
    igl.arap_precomputation(tetrahedra.V, tetrahedra.T, 3, held.index.astype(np.int32), data)
    precomputed = perf_counter()

    u = tetrahedra.V @ R.T + t
    u[held.index] = held.target

    def advance(u: np.ndarray, out: np.ndarray) -> None:
        out[:] = igl.arap_solve(held.target, data, u)

    residuals = iterate(
        advance,
        u,
        scale=mesh.diagonal,
        tolerance=tolerance,
        max_iterations=max_iterations,
        progress=progress,
    )
    solved = perf_counter()
    V, facts = on_targets(mesh, handles, tetrahedra.carry @ u, nodes=len(u))
    return iterated(
        V,
        residuals,
        tolerance=tolerance,
        seconds={
            "precompute": precomputed - begin,
            "solve": solved - precomputed,
            "carry": perf_counter() - solved,
        },
        extra={**tetrahedra.facts(), **facts},
    )
