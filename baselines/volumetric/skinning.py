"""Skinning with weights that libigl computes on coarse tetrahedra.

- Bounded biharmonic weights: each rigid part of the handles has a weight function between 0 and 1. It is 1 on
  the part, 0 on all other parts, and minimises the Laplacian energy. The surface follows by linear blend
  skinning.
- Biharmonic coordinates: the interpolation with the least squared Laplacian that reproduces affine maps.
  Handles are points or whole regions.

In the papers, the user prescribes the motion of each part, and tetrahedra conform to the surface. Here, the
motion of a part is the best rigid fit to its handles, and weights are interpolated to the surface by
barycentric coordinates.

Proof: libigl's own calls; affine maps of points are reproduced, and weights between two bones lie between 0
and 1 (tests/baselines/test_volumetric.py).

A. Jacobson, I. Baran, J. Popovic, O. Sorkine, "Bounded biharmonic weights for real-time deformation", 2011;
Y. Wang, A. Jacobson, J. Barbic, L. Kavan, "Linear subspace design for real-time shape deformation", 2015.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Unpack

import numpy as np

from baselines.hard_handles import require_hard
from baselines.stopwatch import Stopwatch
from baselines.volumetric.coarse_tetrahedra import CoarseTetrahedra, TetrahedraOptions, coarse_tetrahedra
from baselines.volumetric.node_handles import NodeHandles, node_handles, on_targets
from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.problem.task import DeformationResult, DeformationTask

#: Least ratio of the smallest to the largest singular value of nodes that determine an affine map.
GENERAL_POSITION = 1e-3


def bounded_biharmonic_weights(
    task: DeformationTask,
    *,
    qp_iterations: int = 8,
    seed: int = 0,
    progress: Progress = silent,
    **options: Unpack[TetrahedraOptions],
) -> DeformationResult:
    """Deform by linear blend skinning with bounded biharmonic weights.

    Parameters
    ----------
    task : DeformationTask
        The mesh must be closed. Each handle group is a bone; groups that do not move rigidly are split by
        :func:`baselines.volumetric.node_handles.rigid_parts`.
    qp_iterations : int
        Steps of the active-set method for each weight function, at least 1.
    seed : int
        Unused: the method is deterministic.
    progress : Progress
        Unused.
    **options
        Size of the tetrahedra: see :class:`baselines.volumetric.coarse_tetrahedra.TetrahedraOptions`.

    Returns
    -------
    DeformationResult
        ``extra`` has ``nodes``, ``tetrahedra``, ``tetrahedra_seconds``, the number of ``bones`` and
        ``handle_before``, the mean distance of handles to their targets before the final correction, divided
        by the diagonal.

    Raises
    ------
    ImportError
        If pytetwild is not installed.
    InputError
        If :func:`baselines.volumetric.coarse_tetrahedra.coarse_tetrahedra` refuses the mesh, a handle is
        soft, a component of the tetrahedra has no handle, or libigl finds no weights.
    """
    if qp_iterations < 1:
        raise InputError(f"{qp_iterations} steps of the active set were asked for; at least one is needed")

    def prolong(tetrahedra: CoarseTetrahedra, fixed: NodeHandles) -> np.ndarray:
        W, parts = _bounded_weights(tetrahedra, fixed, qp_iterations), fixed.parts
        W = np.clip(tetrahedra.carry @ W, 0.0, 1.0)
        W /= W.sum(axis=1, keepdims=True)
        V = task.mesh.V
        blended = np.einsum("vg,gij,vj->vi", W, parts.R, V, optimize=True)
        return blended + W @ parts.t

    return _skinned(task, prolong, **options)


def biharmonic_coordinates(
    task: DeformationTask, *, seed: int = 0, progress: Progress = silent, **options: Unpack[TetrahedraOptions]
) -> DeformationResult:
    """Deform in the linear subspace of biharmonic coordinates.

    Parameters
    ----------
    task : DeformationTask
        The mesh must be closed. Each handle group is a region that moves by its best rigid motion. The nodes
        of a group are single points if they are fewer than four or nearly coplanar, because they then do not
        determine an affine map.
    seed : int
        Unused: the method is deterministic.
    progress : Progress
        Unused.
    **options
        Size of the tetrahedra: see :class:`baselines.volumetric.coarse_tetrahedra.TetrahedraOptions`.

    Returns
    -------
    DeformationResult
        ``extra`` has the entries of :func:`bounded_biharmonic_weights`; ``bones`` counts the parts.

    Raises
    ------
    ImportError, InputError
        As :func:`bounded_biharmonic_weights` does.
    """

    def prolong(tetrahedra: CoarseTetrahedra, fixed: NodeHandles) -> np.ndarray:
        import igl

        # The equations mix positions with ones, and are well conditioned at the origin in unit size.
        centre, scale = task.mesh.V.mean(axis=0), task.mesh.diagonal
        V, parts = (tetrahedra.V - centre) / scale, fixed.parts
        selected: list[list[int]] = []
        controls: list[np.ndarray] = []
        for part in np.unique(fixed.part):
            nodes = np.flatnonzero(fixed.part == part)
            if _determine_an_affine_map(V[fixed.index[nodes]]):
                selected.append(fixed.index[nodes].tolist())
                moved = parts.R[part] @ centre + parts.t[part] - centre
                controls.append(np.vstack([parts.R[part].T, moved / scale]))
            else:
                selected += [[int(node)] for node in fixed.index[nodes]]
                controls.append((fixed.target[nodes] - centre) / scale)
        W = igl.biharmonic_coordinates(V, tetrahedra.T, selected, 2)
        return (tetrahedra.carry @ (W @ np.vstack(controls))) * scale + centre

    return _skinned(task, prolong, **options)


def _skinned(
    task: DeformationTask,
    prolong: Callable[[CoarseTetrahedra, NodeHandles], np.ndarray],
    **options: Unpack[TetrahedraOptions],
) -> DeformationResult:
    mesh, handles = task.mesh, task.handles
    require_hard(handles, "skinning")
    watch = Stopwatch()
    tetrahedra = coarse_tetrahedra(mesh, **options)
    fixed = node_handles(tetrahedra, mesh, handles)
    watch.end("precompute")
    V = prolong(tetrahedra, fixed)
    watch.end("solve")
    V, before = on_targets(mesh, handles, V, nodes=len(tetrahedra.V))
    watch.end("carry")
    extra = tetrahedra.facts() | {"handle_before": before, "bones": len(fixed.parts.t)}
    return DeformationResult(V, iterations=1, converged=None, seconds=watch.seconds, extra=extra)


def _bounded_weights(tetrahedra: CoarseTetrahedra, fixed: NodeHandles, iterations: int) -> np.ndarray:
    """Return the weights (p, bones) of the nodes; each row adds up to 1."""
    import igl

    bones = len(fixed.parts.t)
    if bones == 1:
        return np.ones((len(tetrahedra.V), 1))
    values = np.zeros((len(fixed.index), bones))
    values[np.arange(len(fixed.index)), fixed.part] = 1.0
    V = (tetrahedra.V - tetrahedra.V.mean(axis=0)) / np.ptp(tetrahedra.V, axis=0).max()
    W = np.array(igl.bbw(V, tetrahedra.T, fixed.index, values, max_iter=iterations))
    if W.shape != (len(V), bones) or not np.isfinite(W).all():
        raise InputError("libigl found no bounded biharmonic weights on the tetrahedra of this mesh")
    W = np.clip(W, 0.0, 1.0)
    return W / W.sum(axis=1, keepdims=True)


def _determine_an_affine_map(points: np.ndarray) -> bool:
    if len(points) < 4:
        return False
    s = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(s[-1] > GENERAL_POSITION * s[0])
