"""Lattice ARAP: ARAP on cubes around the surface, which follows them.

    E = sum_ij w_ij |e'_ij - R_i e_ij|^2 + w / k sum_h |(C q)_h - target_h|^2 sum_ij w_ij

over the edges ij of the lattice, w_ij the share of an inner edge's four cubes that there are, C the
trilinear weights of the k handle vertices. w is large; what it leaves is taken away in the end. The
surface is carried by trilinear interpolation of the positions, or, smoother, of the rigid motions of the
nodes, as by a deformation graph. It may be of any kind, intersect itself and have many components: those
in neighbouring cubes move as one, and limbs that are closer than a cube grow together.

After the description of M. Zollhoefer, E. Sert, G. Greiner, J. Suessmuth, "GPU based ARAP deformation using
volumetric lattices", Eurographics 2012 short papers, whose code is not public: theirs is a multiresolution
iteration on a GPU; weights of edges, the cubes inside and the motions of nodes are filled in.
"""

from __future__ import annotations

from time import perf_counter
from typing import Literal, get_args

import numpy as np
from scipy.sparse import csc_array

from baselines.global_step import iterate, iterated
from baselines.start_motion import start_motion
from baselines.volumetric.lattice import lattice
from baselines.volumetric.node_handles import on_targets, require_handles
from sshade.errors import InputError
from sshade.progress import Progress, silent
from sshade.solver.cotangents import laplacian_matrix
from sshade.solver.factorisation import Factorisation
from sshade.solver.options import Start
from sshade.solver.rotations import fit_rotations
from sshade.solver.terms import Terms, covariances, right_hand_side
from sshade.task import DeformationResult, DeformationTask

Carry = Literal["trilinear", "motions"]


def lattice_arap(
    task: DeformationTask,
    *,
    cells: int = 64,
    filled: bool = True,
    carry: Carry = "motions",
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
        Its mesh may be of any kind.
    cells : int
        Sides of a cube in the bounding box's diagonal.
    filled : bool
        With cubes inside, where the surface encloses any, or those alone that it passes through.
    carry : {"motions", "trilinear"}
    handle_weight : float
        w, without unit.
    tolerance : float
        Residual of the nodes, over the mesh's diagonal. 0 never stops early.
    max_iterations : int
    start : {"rest", "rigid"}
    seed : int
        Unused: the method is deterministic.
    progress : Progress

    Returns
    -------
    DeformationResult
        ``extra`` has ``nodes``, ``cubes``, ``residual`` and ``handle_before``, as handles are put on
        their targets in the end.

    Raises
    ------
    InputError
        On parameters out of range or soft handles, or when cubes hang together without a handle.
    """
    if cells < 2 or not 0 < handle_weight < np.inf or carry not in get_args(Carry):
        raise InputError(
            f"cells={cells!r}, handle_weight={handle_weight!r} and carry={carry!r}: the first must be 2 or "
            "more, the second above 0, the third 'motions' or 'trilinear'"
        )
    mesh, handles = task.mesh, task.handles
    handles.require_hard("Lattice ARAP")
    R0, t0 = start_motion(task, start)
    begin = perf_counter()
    grid = lattice(mesh, cells=cells, filled=filled)
    C, p = grid.carry[handles.index], len(grid.V)
    require_handles(grid.component, np.unique(C.indices))
    weights = grid.sharing / 4
    i, j = grid.edges.T
    terms = Terms(
        grid.edges.astype(np.int32),
        (weights[:, None] * (grid.V[i] - grid.V[j]))[:, None],
        weights[:, None],
    )
    # Handles weigh by their number: nodes of a cube with many are as those of one with a few.
    pull = handle_weight * weights.sum() / len(handles)
    factor = Factorisation(csc_array(laplacian_matrix(p, grid.edges, weights) + pull * (C.T @ C)))
    pulled = pull * (C.T @ handles.target)
    precomputed = perf_counter()

    q = grid.V @ R0.T + t0
    R, Q, B = np.empty((p, 9)), np.tile([1.0, 0.0, 0.0, 0.0], (p, 1)), np.empty((p, 3))

    def advance(q: np.ndarray, out: np.ndarray) -> None:
        covariances(terms, q, R, 0, p)
        fit_rotations(R, Q)
        right_hand_side(terms, R, B, 0, p)
        out[:] = factor.solve(B + pulled)

    residuals = iterate(
        advance,
        q,
        scale=mesh.diagonal,
        tolerance=tolerance,
        max_iterations=max_iterations,
        progress=progress,
    )
    solved = perf_counter()
    V = grid.carry @ q
    if carry == "motions":
        covariances(terms, q, R, 0, p)
        fit_rotations(R, Q)
        turns = R.reshape(-1, 3, 3)
        # sum_m phi_m (R_m (v - p_m) + q_m), the motions apart from the points that they are about
        shifts = q - np.einsum("pij,pj->pi", turns, grid.V)
        blended = (grid.carry @ R).reshape(-1, 3, 3)
        V = np.einsum("vij,vj->vi", blended, mesh.V) + grid.carry @ shifts
    V, facts = on_targets(mesh, handles, V, nodes=p)
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
            **facts,
            "nodes": p,
            "cubes": len(grid.cubes),
        },
    )
