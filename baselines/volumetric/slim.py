"""SLIM on coarse tetrahedra: minimise the symmetric Dirichlet energy, which prevents inverted tetrahedra.

    E = sum_t v_t (|D_t|_F^2 + |D_t^-1|_F^2) + w / h sum_i |p_i - target_i|^2

D_t is the deformation gradient of tetrahedron t, v_t its fraction of the volume, and i runs over the h nodes
next to handles. Lengths are divided by the diagonal, so the weight w of the handles has no unit. Handles are
soft, as in the authors' program, and need not reach their targets. Barycentric coordinates prolong the nodes'
positions to the surface. libigl's `slim_solve` does the iterations; a test of the residual stops it.

Proof: libigl's own call; no tetrahedron inverts (tests/baselines/test_volumetric.py). Outside the tests, its
result was a stationary point of E to 3e-6.

M. Rabinovich, R. Poranne, D. Panozzo, O. Sorkine-Hornung, "Scalable locally injective mappings", 2017.
"""

from __future__ import annotations

from typing import Unpack

import numpy as np

from baselines.hard_handles import require_hard
from baselines.iteration import Plain, handle_error, iterated, start_motion
from baselines.stopwatch import Stopwatch
from baselines.volumetric.coarse_tetrahedra import TetrahedraOptions, coarse_tetrahedra
from baselines.volumetric.node_handles import node_handles
from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.problem.options import Start, Stop
from sshade.problem.task import DeformationResult, DeformationTask
from sshade.solver.run import run


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
    """Deform with SLIM and soft handles.

    Parameters
    ----------
    task : DeformationTask
        The mesh must be closed.
    handle_weight : float
        w, positive. Larger values bring handles nearer to their targets.
    tolerance : float
        Residual below which the iteration stops: the largest move of a node in one iteration, divided by
        the mesh's bounding-box diagonal. 0 disables the test.
    max_iterations : int
    start : {"rest", "rigid"}
        Initialisation. Handles also begin there, because no tetrahedron may be inverted at the start.
    seed : int
        Unused: the method is deterministic.
    progress : Progress
    **options
        Size of the tetrahedra: see :class:`baselines.volumetric.coarse_tetrahedra.TetrahedraOptions`.

    Returns
    -------
    DeformationResult
        ``extra`` has ``nodes``, ``tetrahedra``, ``tetrahedra_seconds``, ``residual``, the number of
        ``inverted`` tetrahedra, and ``handle_error``, the mean distance of handles to their targets divided
        by the diagonal.

    Raises
    ------
    ImportError
        If pytetwild is not installed.
    InputError
        If :func:`baselines.volumetric.coarse_tetrahedra.coarse_tetrahedra` refuses the mesh, the weight is
        not positive, the start is unknown, a handle is soft, or a component of the tetrahedra has no handle.
    """
    import igl

    if not 0 < handle_weight < np.inf:
        raise InputError(f"handle_weight={handle_weight!r} is no weight; it takes a number above 0")
    mesh, handles = task.mesh, task.handles
    require_hard(handles, "SLIM")
    R, t = start_motion(task, start)
    watch = Stopwatch()
    tetrahedra = coarse_tetrahedra(mesh, **options)
    fixed = node_handles(tetrahedra, mesh, handles)
    # libigl weights by volumes and adds its penalty for each node: solve around the origin in unit size.
    centre, scale = mesh.V.mean(axis=0), mesh.diagonal
    rest = (tetrahedra.V - centre) / scale
    u = (tetrahedra.V @ R.T + t - centre) / scale
    volume = float(tetrahedra.volumes.sum()) / scale**3
    data = igl.slim_precompute(
        np.asfortranarray(rest),
        np.asfortranarray(tetrahedra.T, dtype=np.int32),
        np.asfortranarray(u),
        igl.MappingEnergyType.SYMMETRIC_DIRICHLET,
        fixed.index.astype(np.int32),
        np.asfortranarray((fixed.target - centre) / scale),
        handle_weight * volume / len(fixed.index),
    )
    watch.end("precompute")

    def advance(_: np.ndarray, out: np.ndarray) -> None:
        out[:] = igl.slim_solve(data, 1)

    state = Plain(advance, u, diagonal=1.0)
    done = run(state, Stop(tolerance, max_iterations), progress=progress)
    watch.end("solve")
    nodes = u * scale + centre
    V = tetrahedra.carry @ nodes
    inverted = tetrahedra.inverted(nodes)
    watch.end("carry")
    facts = {"inverted": inverted, "handle_error": handle_error(mesh, handles, V)}
    return iterated(V, done, watch.seconds, tetrahedra.facts() | facts)
