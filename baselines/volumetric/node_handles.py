"""Handles of a surface as handles of a coarse volume: which parts move rigidly, which nodes with them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from baselines.volumetric.coarse_tetrahedra import CoarseTetrahedra
from sshade.errors import InputError
from sshade.handles import Handles
from sshade.mesh.adjacency import edge_graph
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import rigid_motion
from sshade.pipeline.regions import HandleRegions

#: How far (x diagonal) a handle may be from its target when a part moves rigidly.
RIGID = 5e-3
#: Handles near each other from which the motion of a part is guessed, and guesses a part.
GUESSED_FROM, GUESSES = 12, 16


@dataclass(frozen=True, eq=False)
class RigidParts:
    """Handles by the rigid motion that they take part in.

    Attributes
    ----------
    part : (k,) int
        Of each handle.
    R : (g, 3, 3) float64
    t : (g, 3) float64
        The motion ``R v + t`` of each part.
    """

    part: np.ndarray
    R: np.ndarray
    t: np.ndarray

    def moved(self, part: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Points (q, 3) with the motions of `part` (q,)."""
        return np.einsum("qij,qj->qi", self.R[part], points) + self.t[part]


def rigid_parts(mesh: Mesh, handles: Handles) -> RigidParts:
    """Split handles into parts that move rigidly: their groups, or where these do not, what of them does.

    Of a group that does not move rigidly to :data:`RIGID`, the largest part is taken out again and again
    whose motion, guessed from handles near each other, the most handles share; what shares no motion
    with others remains one part, with its best rigid motion.
    """
    source, close = mesh.V[handles.index], RIGID * mesh.diagonal
    part, motions = np.full(len(handles), -1), []
    for group in np.unique(handles.group):
        left = np.flatnonzero(handles.group == group)
        while len(left):
            motion = rigid_motion(source[left], handles.target[left])
            own = np.ones(len(left), dtype=bool)
            if not _sharing(motion, source[left], handles.target[left], close).all():
                guess = _largest_motion(source[left], handles.target[left], close)
                if guess is not None:
                    motion, own = guess
            part[left[own]] = len(motions)
            motions.append(motion)
            left = left[~own]
    R, t = (np.array(values) for values in zip(*motions, strict=True))
    return RigidParts(part, R, t)


def _sharing(
    motion: tuple[np.ndarray, np.ndarray], source: np.ndarray, target: np.ndarray, close: float
) -> np.ndarray:
    R, t = motion
    return np.linalg.norm(source @ R.T + t - target, axis=1) <= close


def _largest_motion(
    source: np.ndarray, target: np.ndarray, close: float
) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray] | None:
    """The motion that most handles share, and which; None where no more do than it was guessed from."""
    from scipy.spatial import cKDTree

    near = min(GUESSED_FROM, len(source))
    tree, best, motion = cKDTree(source), np.zeros(len(source), dtype=bool), None
    for seed in np.unique(np.linspace(0, len(source) - 1, GUESSES).astype(int)):
        _, around = tree.query(source[seed], k=near)
        guess = rigid_motion(source[np.atleast_1d(around)], target[np.atleast_1d(around)])
        for _ in range(2):  # fitted again to all that share it
            own = _sharing(guess, source, target, close)
            if own.sum() < 3:
                break
            guess = rigid_motion(source[own], target[own])
        own = _sharing(guess, source, target, close)
        if own.sum() > best.sum():
            best, motion = own, guess
    return None if motion is None or best.sum() < near else (motion, best)


@dataclass(frozen=True, eq=False)
class NodeHandles:
    """Nodes that move with handles of the surface.

    Attributes
    ----------
    index : (h,) int64
        Nodes, in ascending order.
    target : (h, 3) float64
        Where the motion of their parts carries them.
    part : (h,) int
        Of the nearest handle.
    """

    index: np.ndarray
    target: np.ndarray
    part: np.ndarray


def node_handles(
    tetrahedra: CoarseTetrahedra, mesh: Mesh, handles: Handles, parts: RigidParts
) -> NodeHandles:
    """The node nearest to each handle, once each.

    A node goes where its nearest handle goes, with the offset turned as the handle's part turns.

    Raises
    ------
    InputError
        When tetrahedra hang together without such a node.
    """
    from scipy.spatial import cKDTree

    source = mesh.V[handles.index]
    _, node = cKDTree(tetrahedra.V).query(source)
    index = np.unique(node)
    _, nearest = cKDTree(source).query(tetrahedra.V[index])
    part = parts.part[nearest]
    offset = np.einsum("qij,qj->qi", parts.R[part], tetrahedra.V[index] - source[nearest])
    require_handles(tetrahedra.component, index)
    return NodeHandles(index, handles.target[nearest] + offset, part)


def require_handles(component: np.ndarray, nodes: np.ndarray) -> None:
    """Raise InputError where a component of a volume, (p,) int of its nodes, has none of `nodes` (h,)."""
    count = int(component.max()) + 1
    without = count - len(np.unique(component[nodes]))
    if without:
        raise InputError(f"{without} of the {count} components of the coarse volume have no handle")


def handle_error(mesh: Mesh, handles: Handles, V: np.ndarray) -> float:
    """Mean distance of handles at positions V (n, 3) to their targets, over the diagonal."""
    return float(np.linalg.norm(V[handles.index] - handles.target, axis=1).mean()) / mesh.diagonal


def on_targets(
    mesh: Mesh, handles: Handles, V: np.ndarray, *, nodes: int
) -> tuple[np.ndarray, dict[str, float]]:
    """Put handles that were carried near their targets onto them, and the surface beside regions with them.

    Parameters
    ----------
    mesh : Mesh
    handles : Handles
    V : (n, 3) float64
        The mesh as carried.
    nodes : int
        Of the coarse volume.

    Returns
    -------
    V : (n, 3) float64
    facts : dict
        ``handle_before``, the mean distance of handles to targets as carried, over the diagonal.
    """
    before = handle_error(mesh, handles, V)
    regions = HandleRegions(mesh, handles, vertices=nodes, graph=edge_graph(mesh))
    V = np.array(regions.on_targets(V, handles))
    V[handles.index] = handles.target
    return V, {"handle_before": before}
