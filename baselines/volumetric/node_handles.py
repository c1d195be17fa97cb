"""Transfer of a surface's handles to a coarse volume: rigid parts, and the nodes that move with them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baselines.iteration import handle_error
from baselines.volumetric.coarse_tetrahedra import CoarseTetrahedra
from sshade.core.errors import InputError, counted
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import rigid_motion
from sshade.problem.handles import Handles
from sshade.regions.handle_regions import HandleRegions

#: Maximum distance of a handle of a rigid part from its target, as a fraction of the diagonal.
RIGID = 5e-3
#: Number of neighbouring handles that a trial motion is fitted to.
TRIAL_HANDLES = 12
#: Number of trial motions for each part.
TRIALS = 16


class RigidParts(NamedTuple):
    """Handles, grouped by rigid motion.

    Attributes
    ----------
    part : (k,) int
        Part of each handle.
    R : (g, 3, 3) float64
        Rotation of each part.
    t : (g, 3) float64
        Translation of each part: the part moves by ``R v + t``.
    """

    part: np.ndarray
    R: np.ndarray
    t: np.ndarray


def rigid_parts(mesh: Mesh, handles: Handles) -> RigidParts:
    """Split handles into parts that move rigidly.

    A group that moves rigidly within :data:`RIGID` is one part. From any other group, the function repeatedly
    removes the largest set of handles that follow one rigid motion, found from trial fits to neighbouring
    handles. The remaining handles form one part with its best rigid motion.
    """
    source, close = mesh.V[handles.index], RIGID * mesh.diagonal
    part = np.full(len(handles), -1)
    motions: list[tuple[np.ndarray, np.ndarray]] = []
    for group in np.unique(handles.group):
        left = np.flatnonzero(handles.group == group)
        while len(left):
            motion, moved = _largest_motion(source[left], handles.target[left], close)
            part[left[moved]] = len(motions)
            motions.append(motion)
            left = left[~moved]
    R, t = (np.array(values) for values in zip(*motions, strict=True))
    return RigidParts(part, R, t)


def _following(
    motion: tuple[np.ndarray, np.ndarray], source: np.ndarray, target: np.ndarray, close: float
) -> np.ndarray:
    """Return a mask (k,) of the handles that a rigid motion brings close to their targets."""
    R, t = motion
    return np.linalg.norm(source @ R.T + t - target, axis=1) <= close


def _largest_motion(
    source: np.ndarray, target: np.ndarray, close: float
) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Return the motion that most handles follow, and their mask.

    If the best motion of all handles takes all close, or no trial gains handles, all handles follow that one.
    """
    from scipy.spatial import cKDTree

    whole = rigid_motion(source, target)
    near, everything = min(TRIAL_HANDLES, len(source)), np.ones(len(source), dtype=bool)
    if _following(whole, source, target, close).all():
        return whole, everything
    tree, best, motion = cKDTree(source), ~everything, whole
    for seed in np.unique(np.linspace(0, len(source) - 1, TRIALS).astype(int)):
        _, around = tree.query(source[seed], k=near)
        trial = rigid_motion(source[np.atleast_1d(around)], target[np.atleast_1d(around)])
        for _ in range(2):  # fit again to all handles that follow the trial motion
            found = _following(trial, source, target, close)
            if found.sum() < 3:
                break
            trial = rigid_motion(source[found], target[found])
        found = _following(trial, source, target, close)
        if found.sum() > best.sum():
            best, motion = found, trial
    return (motion, best) if best.sum() >= near else (whole, everything)


@dataclass(frozen=True, eq=False)
class NodeHandles:
    """Nodes of the volume whose positions the handles of the surface determine.

    Attributes
    ----------
    index : (h,) int64
        Nodes, in ascending order.
    target : (h, 3) float64
        Their positions after the motion of their parts.
    part : (h,) int
        Part of the nearest handle.
    parts : RigidParts
        Motions of the parts.
    """

    index: np.ndarray
    target: np.ndarray
    part: np.ndarray
    parts: RigidParts


def node_handles(tetrahedra: CoarseTetrahedra, mesh: Mesh, handles: Handles) -> NodeHandles:
    """Return the nodes nearest to handles, without repetition.

    A node keeps its offset from the nearest handle, rotated by the rotation of the handle's part.

    Raises
    ------
    InputError
        If a component of the tetrahedra has no node that is nearest to a handle.
    """
    from scipy.spatial import cKDTree

    parts, source = rigid_parts(mesh, handles), mesh.V[handles.index]
    _, node = cKDTree(tetrahedra.V).query(source)
    index = np.unique(node)
    _, nearest = cKDTree(source).query(tetrahedra.V[index])
    part = parts.part[nearest]
    offset = np.einsum("qij,qj->qi", parts.R[part], tetrahedra.V[index] - source[nearest])
    require_handles(tetrahedra.component, index)
    return NodeHandles(index, handles.target[nearest] + offset, part, parts)


def require_handles(component: np.ndarray, nodes: np.ndarray) -> None:
    """Raise InputError if a component (p,) of a volume's nodes contains no entry of `nodes` (h,)."""
    count = int(component.max()) + 1
    without = count - len(np.unique(component[nodes]))
    if without:
        of = f"of the {count} components of the coarse volume"
        raise InputError(f"{counted(without, f'{of} has', f'{of} have')} no handle")


def on_targets(mesh: Mesh, handles: Handles, V: np.ndarray, *, nodes: int) -> tuple[np.ndarray, float]:
    """Put handles on their targets, and move the surface beside handle regions with them.

    Parameters
    ----------
    mesh : Mesh
    handles : Handles
    V : (n, 3) float64
        Deformed positions whose handles are near their targets.
    nodes : int
        Number of nodes of the coarse volume.

    Returns
    -------
    V : (n, 3) float64
    before : float
        Mean distance of handles to targets in the given positions, divided by the diagonal.
    """
    before = handle_error(mesh, handles, V)
    regions = HandleRegions(mesh, handles, vertices=nodes, graph=vertex_graph(mesh))
    V = np.array(regions.on_targets(V, handles))
    V[handles.index] = handles.target
    return V, before
