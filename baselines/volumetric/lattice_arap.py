"""Lattice ARAP: ARAP on a lattice of cubes around the surface.

    E = sum_ij w_ij |e'_ij - R_i e_ij|^2 + w / k sum_h |(C q)_h - target_h|^2 sum_ij w_ij

The sums run over the edges ij of the lattice and the k handle vertices h. w_ij is the number of cubes around
an edge divided by four, the number around an inner edge. C holds the trilinear weights of the handles.
w is large; the remaining distance is corrected at the end. Trilinear interpolation prolongs the rigid motions
of the nodes to the surface, as in a deformation graph. The surface may intersect itself and have many
components. Components in neighbouring cubes move together, and limbs closer than a cube merge.

Proof: closed forms: rigid motions are reproduced on any surface, and both starts come to one minimum
(tests/baselines/test_arap.py).

Source: the description in M. Zollhoefer, E. Sert, G. Greiner, J. Suessmuth, "GPU based ARAP deformation using
volumetric lattices", Eurographics 2012 short papers. The authors' code is not public and uses several
resolutions on a GPU. The edge weights, the inner cubes and the motions of nodes are our choices.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csc_array

from baselines.hard_handles import require_hard
from baselines.iteration import Plain, iterated, start_motion
from baselines.local_step import LocalStep, blend, spokes
from baselines.stopwatch import Stopwatch
from baselines.volumetric.lattice import lattice
from baselines.volumetric.node_handles import on_targets, require_handles
from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.problem.options import Start, Stop
from sshade.problem.task import DeformationResult, DeformationTask
from sshade.solver.factorisation import Factorisation
from sshade.solver.laplacian import laplacian_matrix
from sshade.solver.run import run


def lattice_arap(
    task: DeformationTask,
    *,
    cells: int = 64,
    filled: bool = True,
    handle_weight: float = 100.0,
    tolerance: float = 1e-5,
    max_iterations: int = 1000,
    start: Start = "rest",
    seed: int = 0,
    progress: Progress = silent,
) -> DeformationResult:
    """Deform with ARAP on a lattice.

    Parameters
    ----------
    task : DeformationTask
        Any mesh will do.
    cells : int
        Bounding-box diagonal divided by the side of a cube, at least 2. Raise it if limbs merge.
    filled : bool
        Add the cubes inside the surface to the cubes that it passes through.
    handle_weight : float
        w, positive, without unit. Larger values bring handles nearer to their targets.
    tolerance : float
        Residual below which the iteration stops: the largest move of a node in one iteration, divided by
        the mesh's bounding-box diagonal. 0 disables the test.
    max_iterations : int
    start : {"rest", "rigid"}
    seed : int
        Unused: the method is deterministic.
    progress : Progress

    Returns
    -------
    DeformationResult
        ``extra`` has ``nodes``, ``cubes``, ``residual`` and ``handle_before``, the mean distance of handles
        to their targets before the final correction, divided by the diagonal.

    Raises
    ------
    InputError
        If a parameter is out of range, a handle is soft, or a component of the lattice has no handle.
    """
    if cells < 2 or not 0 < handle_weight < np.inf:
        raise InputError(
            f"cells={cells!r} and handle_weight={handle_weight!r}: the first must be 2 or more, the second "
            "above 0"
        )
    mesh, handles = task.mesh, task.handles
    require_hard(handles, "Lattice ARAP")
    R0, t0 = start_motion(task, start)
    watch = Stopwatch()
    grid = lattice(mesh, cells=cells, filled=filled)
    C, p = grid.carry[handles.index], len(grid.V)
    require_handles(grid.component, np.unique(C.indices))
    weights = grid.sharing / 4
    local = LocalStep(spokes(grid.V, grid.edges, weights), p)
    # Divide by the number of handles, so that w does not depend on how densely they are sampled.
    pull = handle_weight * weights.sum() / len(handles)
    factor = Factorisation(csc_array(laplacian_matrix(p, grid.edges, weights) + pull * (C.T @ C)))
    watch.end("precompute")

    q = grid.V @ R0.T + t0

    def advance(q: np.ndarray, out: np.ndarray) -> None:
        local.rotations(q)
        out[:] = q + factor.solve(local.forces(q) + pull * (C.T @ (handles.target - C @ q)))

    state = Plain(advance, q, diagonal=mesh.diagonal)
    done = run(state, Stop(tolerance, max_iterations), progress=progress)
    watch.end("solve")
    V = blend(grid.carry, mesh.V, rest=grid.V, nodes=q, R=local.rotations(q))
    V, before = on_targets(mesh, handles, V, nodes=p)
    watch.end("carry")
    facts = {"handle_before": before, "nodes": p, "cubes": len(grid.cubes)}
    return iterated(V, done, watch.seconds, facts)
