"""Weights on coarse tetrahedra that carry the motions of handles to the surface.

- Bounded biharmonic weights: of each rigid part of the handles one, which minimises the Laplacian energy
  between 0 and 1, is 1 at the part and 0 at the others. The surface follows by linear blend skinning.
- Biharmonic coordinates: the interpolation of least squared Laplacian that reproduces affine maps,
  of handles that are points or whole regions.

Both are libigl's. The motion of a part is the rigid one that fits its handles best; the authors' user gives
it. Weights are interpolated by barycentric coordinates from coarse tetrahedra, where the authors' conform
to the surface.

A. Jacobson, I. Baran, J. Popovic, O. Sorkine, "Bounded biharmonic weights for real-time deformation", 2011;
Y. Wang, A. Jacobson, J. Barbic, L. Kavan, "Linear subspace design for real-time shape deformation", 2015.
"""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import Unpack

import numpy as np

from baselines.volumetric.coarse_tetrahedra import CoarseTetrahedra, TetrahedraOptions, coarse_tetrahedra
from baselines.volumetric.node_handles import NodeHandles, RigidParts, node_handles, on_targets, rigid_parts
from sshade.errors import InputError
from sshade.progress import Progress, silent
from sshade.task import DeformationResult, DeformationTask

#: Smallest singular value of a region's nodes, over the largest, with which they fix an affine map.
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
        Its mesh must be closed. Its handle groups are the bones; see
        :func:`baselines.volumetric.node_handles.rigid_parts` for those that do not move rigidly.
    qp_iterations : int
        Steps of the active set method, for each weight.
    seed : int
        Unused: the method is deterministic.
    progress : Progress
        Unused.
    **options
        See :class:`baselines.volumetric.coarse_tetrahedra.TetrahedraOptions`.

    Returns
    -------
    DeformationResult
        ``extra`` has ``nodes``, ``tetrahedra``, ``tetrahedra_seconds``, the number of ``bones`` and
        ``handle_before``, as handles are put on their targets in the end.

    Raises
    ------
    ImportError
        When pytetwild is not installed.
    InputError
        As of :func:`baselines.volumetric.coarse_tetrahedra.coarse_tetrahedra`, on soft handles,
        or when tetrahedra hang together without a handle, or no weights were found.
    """
    if qp_iterations < 1:
        raise InputError(f"{qp_iterations} steps of the active set were asked for; at least one is needed")

    def carried(tetrahedra: CoarseTetrahedra, parts: RigidParts, held: NodeHandles) -> np.ndarray:
        W = _bounded_weights(tetrahedra, held, len(parts.t), qp_iterations)
        W = np.clip(tetrahedra.carry @ W, 0.0, 1.0)
        W /= W.sum(axis=1, keepdims=True)
        V = task.mesh.V
        blended = np.einsum("vg,gij,vj->vi", W, parts.R, V, optimize=True)
        return blended + W @ parts.t

    return _skinned(task, carried, options)


def biharmonic_coordinates(
    task: DeformationTask, *, seed: int = 0, progress: Progress = silent, **options: Unpack[TetrahedraOptions]
) -> DeformationResult:
    """Deform in the linear subspace of biharmonic coordinates.

    Parameters
    ----------
    task : DeformationTask
        Its mesh must be closed. Its handle groups are regions, which move by the rigid motion that
        fits best; the nodes of a group that do not fix an affine map, fewer than four
        or nearly in a plane, are points.
    seed : int
        Unused: the method is deterministic.
    progress : Progress
        Unused.
    **options
        See :class:`baselines.volumetric.coarse_tetrahedra.TetrahedraOptions`.

    Returns
    -------
    DeformationResult
        As of :func:`bounded_biharmonic_weights`, with the parts as ``bones``.

    Raises
    ------
    ImportError
        When pytetwild is not installed.
    InputError
        As of :func:`bounded_biharmonic_weights`.
    """

    def carried(tetrahedra: CoarseTetrahedra, parts: RigidParts, held: NodeHandles) -> np.ndarray:
        import igl

        # Its equations mix positions with ones: well conditioned about the origin and in size 1.
        centre, scale = task.mesh.V.mean(axis=0), task.mesh.diagonal
        V = (tetrahedra.V - centre) / scale
        selected: list[list[int]] = []
        controls: list[np.ndarray] = []
        for part in np.unique(held.part):
            own = np.flatnonzero(held.part == part)
            if _fix_an_affine_map(V[held.index[own]]):
                selected.append(held.index[own].tolist())
                moved = parts.R[part] @ centre + parts.t[part] - centre
                controls.append(np.vstack([parts.R[part].T, moved / scale]))
            else:
                selected += [[int(node)] for node in held.index[own]]
                controls.append((held.target[own] - centre) / scale)
        W = igl.biharmonic_coordinates(V, tetrahedra.T, selected, 2)
        return (tetrahedra.carry @ (W @ np.vstack(controls))) * scale + centre

    return _skinned(task, carried, options)


def _skinned(
    task: DeformationTask,
    carried: Callable[[CoarseTetrahedra, RigidParts, NodeHandles], np.ndarray],
    options: TetrahedraOptions,
) -> DeformationResult:
    mesh, handles = task.mesh, task.handles
    handles.require_hard("skinning")
    begin = perf_counter()
    tetrahedra = coarse_tetrahedra(mesh, **options)
    parts = rigid_parts(mesh, handles)
    held = node_handles(tetrahedra, mesh, handles, parts)
    made = perf_counter()
    V = carried(tetrahedra, parts, held)
    solved = perf_counter()
    V, facts = on_targets(mesh, handles, V, nodes=len(tetrahedra.V))
    return DeformationResult(
        vertices=V,
        iterations=1,
        converged=None,
        seconds={
            "precompute": made - begin,
            "solve": solved - made,
            "carry": perf_counter() - solved,
        },
        extra={**tetrahedra.facts(), **facts, "bones": len(parts.t)},
    )


def _bounded_weights(
    tetrahedra: CoarseTetrahedra, held: NodeHandles, bones: int, iterations: int
) -> np.ndarray:
    """(p, bones) of the nodes, those of each adding up to 1."""
    import igl

    if bones == 1:
        return np.ones((len(tetrahedra.V), 1))
    values = np.zeros((len(held.index), bones))
    values[np.arange(len(held.index)), held.part] = 1.0
    V = (tetrahedra.V - tetrahedra.V.mean(axis=0)) / np.ptp(tetrahedra.V, axis=0).max()
    W = np.array(igl.bbw(V, tetrahedra.T, held.index, values, max_iter=iterations))
    if W.shape != (len(V), bones) or not np.isfinite(W).all():
        raise InputError("libigl found no bounded biharmonic weights on the tetrahedra of this mesh")
    W = np.clip(W, 0.0, 1.0)
    return W / W.sum(axis=1, keepdims=True)


def _fix_an_affine_map(points: np.ndarray) -> bool:
    if len(points) < 4:
        return False
    s = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(s[-1] > GENERAL_POSITION * s[0])
