"""SLIM on coarse tetrahedra: the symmetric Dirichlet energy, which no tetrahedron can invert against.

    E = sum_t v_t (|D_t|_F^2 + |D_t^-1|_F^2) + w / h sum_i |p_i - target_i|^2

with D_t the deformation gradient of tetrahedron t, v_t its share of the volume, and i the h nodes next to
handles; lengths are over the diagonal, so that w, the weight of the handles, has no unit. Handles are
soft, as in the authors' program: they stay where the balance leaves them, and so does the surface,
which is carried by barycentric coordinates. libigl's `slim_solve` iterates; a residual stops it.

M. Rabinovich, R. Poranne, D. Panozzo, O. Sorkine-Hornung, "Scalable locally injective mappings", 2017.
"""

from __future__ import annotations

from time import perf_counter
from typing import Unpack

import numpy as np

from baselines.global_step import iterate, iterated
from baselines.start_motion import start_motion
from baselines.volumetric.coarse_tetrahedra import TetrahedraOptions, coarse_tetrahedra
from baselines.volumetric.node_handles import handle_error, node_handles, rigid_parts
from sshade.errors import InputError
from sshade.progress import Progress, silent
from sshade.solver.options import Start
from sshade.task import DeformationResult, DeformationTask


def slim(
    task: DeformationTask,
    *,
    handle_weight: float = 1000.0,
    tolerance: float = 1e-5,
    max_iterations: int = 1000,
    start: Start = "rest",
    seed: int = 0,
    progress: Progress = silent,
    **options: Unpack[TetrahedraOptions],
) -> DeformationResult:
    """Deform with SLIM; handles are soft.

    Parameters
    ----------
    task : DeformationTask
        Its mesh must be closed.
    handle_weight : float
        w, above 0.
    tolerance : float
        Residual of the nodes, over the mesh's diagonal. 0 never stops early.
    max_iterations : int
    start : {"rest", "rigid"}
        No tetrahedron may be inverted there, so that the handles begin there, too.
    seed : int
        Unused: the method is deterministic.
    progress : Progress
    **options
        See :class:`baselines.volumetric.coarse_tetrahedra.TetrahedraOptions`.

    Returns
    -------
    DeformationResult
        ``extra`` has ``nodes``, ``tetrahedra``, ``tetrahedra_seconds``, ``residual``, the number of
        ``inverted`` tetrahedra, and ``handle_error``, the mean distance to targets over the diagonal.

    Raises
    ------
    ImportError
        When pytetwild is not installed.
    InputError
        As of :func:`baselines.volumetric.coarse_tetrahedra.coarse_tetrahedra`, on a weight that is not
        positive, an unknown start or soft handles, or when tetrahedra hang together without a handle.
    """
    import igl

    if not 0 < handle_weight < np.inf:
        raise InputError(f"handle_weight={handle_weight!r} is no weight; it takes a number above 0")
    mesh, handles = task.mesh, task.handles
    handles.require_hard("SLIM")
    R, t = start_motion(task, start)
    begin = perf_counter()
    tetrahedra = coarse_tetrahedra(mesh, **options)
    held = node_handles(tetrahedra, mesh, handles, rigid_parts(mesh, handles))
    # About the origin and in size 1. libigl weighs by volumes and counts its penalty for each node.
    centre, scale = mesh.V.mean(axis=0), mesh.diagonal
    rest = (tetrahedra.V - centre) / scale
    u = np.asfortranarray((tetrahedra.V @ R.T + t - centre) / scale)
    volume = float(tetrahedra.volumes.sum()) / scale**3
    data = igl.slim_precompute(
        np.asfortranarray(rest),
        np.asfortranarray(tetrahedra.T, dtype=np.int32),
        u,
        igl.MappingEnergyType.SYMMETRIC_DIRICHLET,
        held.index.astype(np.int32),
        np.asfortranarray((held.target - centre) / scale),
        handle_weight * volume / len(held.index),
    )
    precomputed = perf_counter()

    def advance(_: np.ndarray, out: np.ndarray) -> None:
        out[:] = igl.slim_solve(data, 1)

    residuals = iterate(
        advance,
        u,
        scale=1.0,
        tolerance=tolerance,
        max_iterations=max_iterations,
        progress=progress,
    )
    solved = perf_counter()
    nodes = u * scale + centre
    V = tetrahedra.carry @ nodes
    inverted = np.linalg.det(nodes[tetrahedra.T[:, 1:]] - nodes[tetrahedra.T[:, :1]]) <= 0
    return iterated(
        V,
        residuals,
        tolerance=tolerance,
        seconds={
            "precompute": precomputed - begin,
            "solve": solved - precomputed,
            "carry": perf_counter() - solved,
        },
        extra={
            **tetrahedra.facts(),
            "inverted": int(inverted.sum()),
            "handle_error": handle_error(mesh, handles, V),
        },
    )
