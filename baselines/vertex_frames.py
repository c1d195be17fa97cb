"""Pose transfer with reference frames at the vertices of the full mesh, a peer of frames on a proxy.

The frame of vertex i consists of the vertex normal z and a tangent direction. The tangent direction comes
from x~, the area-weighted mean of a function's gradient over the 1-ring: y = z x x~ / |z x x~|, x = y x z,
F_i = [x y z]. F_i is a rotation. The 1-ring is the smallest neighbourhood of GFrames; larger ones only
smooth. The implementation follows the paper and uses no code of the authors.

Proof: the paper's formulas term by term, with libigl's gradients (tests/baselines/test_vertex_frames.py).

S. Melzi, R. Spezialetti, F. Tombari, M. Bronstein, L. Di Stefano, E. Rodola,
"GFrames: gradient-based local reference frame for 3D shape matching", CVPR 2019.
"""

from __future__ import annotations

import logging

import numpy as np
from scipy.sparse import coo_array

from sshade.core.errors import counted
from sshade.core.progress import Progress, silent
from sshade.mesh.mesh import Mesh
from sshade.problem.task import DeformationResult, TransferTask
from sshade.proxy.blended import nearest_rotations
from sshade.proxy.triangle import FLAT
from sshade.proxy.vertex_maps import fill_from_neighbours

log = logging.getLogger(__name__)

#: Relative length below which a vector has no direction.
NO_DIRECTION = 1e-12


def transfer(task: TransferTask, *, seed: int = 0, progress: Progress = silent) -> DeformationResult:
    """Transfer an edit of a rest mesh to another pose: ``s'_i = m'_i + F'_i F_i^T (s_i - m_i)``.

    Each vertex rotates its displacement independently of its neighbours. Displacements keep their length even
    if the pose is scaled, because frames only rotate. The method reads every vertex of M', so it reproduces a
    shape that was not edited.

    The function is the rest coordinate of largest extent. Where its tangential gradient in the rest mesh is
    below :data:`sshade.proxy.triangle.FLAT`, the rest coordinate with the largest gradient replaces it in
    both poses.

    Parameters
    ----------
    task : TransferTask
        M with positions m_i, S with positions s_i, M' with positions m'_i. The mesh must be oriented; it may
        have a boundary and several components.
    seed, progress
        Unused.

    Returns
    -------
    DeformationResult
        ``iterations`` is 0.
    """
    mesh = task.rest
    values = np.column_stack([mesh.V[:, np.argmax(np.ptp(mesh.V, axis=0))], mesh.V])
    rest = _Pose(mesh, mesh.V, values)
    chosen = _choose(np.linalg.norm(rest.gradient, axis=2))
    F, missing = rest.frames(chosen)
    F_posed, missing_posed = _Pose(mesh, task.posed, values).frames(chosen)
    R = F_posed @ F.transpose(0, 2, 1)
    missing |= missing_posed
    if missing.any():
        take = ("vertex has no frame and takes", "vertices have no frame and take")
        log.warning("%s the rotation of neighbours", counted(int(missing.sum()), *take))
        R = fill_from_neighbours(R, ~missing, pairs=mesh.edges, onto=nearest_rotations)
    V = task.posed + np.einsum("nab,nb->na", R, task.mesh.V - mesh.V)
    return DeformationResult(vertices=V, iterations=0, converged=None)


def _choose(length: np.ndarray) -> np.ndarray:
    """Return the column (n,) of each vertex's function, from the lengths (n, 4) of the rest gradients."""
    return np.where(length[:, 0] < FLAT, 1 + np.argmax(length[:, 1:], axis=1), 0)


class _Pose:
    """Normals of a pose, and tangential mean gradients.

    Attributes
    ----------
    normal : (n, 3) float64
        Area-weighted unit normals; zero where the faces at a vertex cancel.
    gradient : (n, c, 3) float64
        Tangential part of each function's mean gradient over the 1-ring.
    """

    def __init__(self, mesh: Mesh, V: np.ndarray, values: np.ndarray) -> None:
        a, b, c = (V[mesh.F[:, corner]] for corner in range(3))
        doubled = np.cross(b - a, c - a)
        length = np.linalg.norm(doubled, axis=1)
        unit = np.divide(doubled, length[:, None], out=np.zeros_like(doubled), where=length[:, None] > 0)
        # Twice the area times the gradient: sum over corners of f times n x (the opposite edge).
        across = np.stack([np.cross(unit, edge) for edge in (c - b, a - c, b - a)], axis=1)
        weighted = np.einsum("mkf,mkx->mfx", values[mesh.F], across)
        faces = np.repeat(np.arange(mesh.m), 3)
        star = coo_array((np.ones(3 * mesh.m), (mesh.F.ravel(), faces)), shape=(mesh.n, mesh.m)).tocsr()
        total = star @ np.column_stack([doubled, length, weighted.reshape(mesh.m, -1)])
        size = np.linalg.norm(total[:, :3], axis=1, keepdims=True)
        # Where faces cancel, rounding errors remain instead of a normal.
        usable = size > NO_DIRECTION * total[:, 3:4]
        self.normal = np.divide(total[:, :3], size, out=np.zeros((mesh.n, 3)), where=usable)
        area = total[:, 3:4]
        mean = np.divide(total[:, 4:], area, out=np.zeros_like(total[:, 4:]), where=area > 0)
        mean = mean.reshape(mesh.n, -1, 3)
        along = np.einsum("nfx,nx->nf", mean, self.normal)
        self.gradient = mean - along[:, :, None] * self.normal[:, None]

    def frames(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the frames (n, 3, 3) for a choice of functions, and a mask of vertices without a frame."""
        x = self.gradient[np.arange(len(chosen)), chosen]
        length = np.linalg.norm(x, axis=1)
        missing = (length <= NO_DIRECTION * length.max()) | ~self.normal.any(axis=1)
        x = x / np.where(missing, 1.0, length)[:, None]
        F = np.stack([x, np.cross(self.normal, x), self.normal], axis=2)
        F[missing] = np.eye(3)
        return F, missing
