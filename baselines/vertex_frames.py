"""Pose transfer with reference frames at the vertices of the full mesh: the peer of frames on a proxy.

The frame of vertex i has the vertex normal z and, in the tangent plane, the
direction of the area-weighted mean x~ of a function's gradient over the 1-ring:
y = z x x~ / |z x x~|, x = y x z, F_i = [x y z], a rotation. This is the smallest
neighbourhood of GFrames, where a larger radius only smooths. No code of its
authors was at hand.

S. Melzi, R. Spezialetti, F. Tombari, M. Bronstein, L. Di Stefano, E. Rodola,
"GFrames: gradient-based local reference frame for 3D shape matching", CVPR 2019.
"""

from __future__ import annotations

import logging

import numpy as np
from scipy.sparse import coo_array

from sshade.carry.blended import nearest_rotations
from sshade.carry.neighbours import fill_from_neighbours
from sshade.carry.triangle import FLAT
from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.progress import Progress, silent
from sshade.task import DeformationResult, TransferTask

log = logging.getLogger(__name__)

#: Under this, relative to what the faces would add up to or to the largest one, a vector has no direction.
NO_DIRECTION = 1e-12


def transfer(
    task: TransferTask, *, function: str = "extent", seed: int = 0, progress: Progress = silent
) -> DeformationResult:
    """:func:`transfer_pose` as a method of a task; nothing in it is random.

    It reads every vertex of M', so it reproduces a shape that was not edited.
    """
    V = transfer_pose(task.rest, task.mesh.V, posed=task.posed, function=function)
    return DeformationResult(vertices=V, iterations=0, converged=None)


def transfer_pose(
    mesh: Mesh, edited: np.ndarray, *, posed: np.ndarray, function: str | np.ndarray = "extent"
) -> np.ndarray:
    """Carry an edit of a rest mesh over to another pose of it: ``s'_i = m'_i + F'_i F_i^T (s_i - m_i)``.

    Every vertex turns its own displacement, whatever its neighbours do. A pose
    scaled as a whole keeps the length of displacements: frames only rotate.

    Parameters
    ----------
    mesh : Mesh
        M, with positions m_i; orientation matters, boundary and several components do not.
    edited : (n, 3) float64
        s_i, in the numbering of `mesh`.
    posed : (n, 3) float64
        m'_i.
    function : {"extent", "x", "y", "z"} or (n,) float64
        f: the rest coordinate of largest extent, one by name, or a value for each
        vertex, which is divided by its range over the diagonal first. Where the
        tangential gradient of f in the rest mesh is under
        :data:`sshade.carry.triangle.FLAT`, the rest coordinate of largest one replaces it,
        in both poses.

    Returns
    -------
    (n, 3) float64
        s'_i.

    Raises
    ------
    InputError
        On positions of another shape, or not finite, or an unknown or constant function.
    """
    edited, posed = (_positions(mesh, V, name) for V, name in ((edited, "edited"), (posed, "posed")))
    values = _candidates(mesh, function)
    rest = _Pose(mesh, mesh.V, values)
    chosen = _choose(np.linalg.norm(rest.gradient, axis=2))
    F, missing = rest.frames(chosen)
    F_posed, missing_posed = _Pose(mesh, posed, values).frames(chosen)
    R = F_posed @ F.transpose(0, 2, 1)
    missing |= missing_posed
    if missing.any():
        log.warning("%d vertices have no frame and turn as their neighbours do", int(missing.sum()))
        R = fill_from_neighbours(R, ~missing, pairs=mesh.edges, onto=nearest_rotations)
    return posed + np.einsum("nab,nb->na", R, edited - mesh.V)


def vertex_frames(mesh: Mesh, V: np.ndarray, *, function: str | np.ndarray = "extent") -> np.ndarray:
    """Frames of a pose of a mesh, columns x, y and z, det 1.

    Parameters
    ----------
    mesh : Mesh
        The rest mesh, in which f is chosen at each vertex; see :func:`transfer_pose`.
    V : (n, 3) float64
        Vertices of the pose.
    function : {"extent", "x", "y", "z"} or (n,) float64

    Returns
    -------
    (n, 3, 3) float64
        NaN where a vertex has no normal, or f no gradient.
    """
    values = _candidates(mesh, function)
    chosen = _choose(np.linalg.norm(_Pose(mesh, mesh.V, values).gradient, axis=2))
    F, missing = _Pose(mesh, _positions(mesh, V, "posed"), values).frames(chosen)
    F[missing] = np.nan
    return F


def _positions(mesh: Mesh, V: np.ndarray, name: str) -> np.ndarray:
    V = np.asarray(V, dtype=np.float64)
    if V.shape != mesh.V.shape:
        raise InputError(f"the {name} vertices have shape {V.shape}, those of the mesh {mesh.V.shape}")
    if not np.isfinite(V).all():
        raise InputError(f"the {name} vertices have NaN or infinite coordinates")
    return V


def _candidates(mesh: Mesh, function: str | np.ndarray) -> np.ndarray:
    """(n, 4): f, then the three rest coordinates that may replace it."""
    if isinstance(function, str):
        axes = {"extent": int(np.argmax(np.ptp(mesh.V, axis=0))), "x": 0, "y": 1, "z": 2}
        if function not in axes:
            raise InputError(f"unknown frame function {function!r}; use extent, x, y or z")
        f = mesh.V[:, axes[function]]
    else:
        f = np.asarray(function, dtype=np.float64)
        if f.shape != (mesh.n,) or not np.isfinite(f).all():
            raise InputError(f"a frame function needs {mesh.n} finite values, one a vertex, not {f.shape}")
        if np.ptp(f) == 0:
            raise InputError("the frame function is constant; it needs a gradient")
        f = f * (mesh.diagonal / np.ptp(f))
    return np.column_stack([f, mesh.V])


def _choose(length: np.ndarray) -> np.ndarray:
    """(n,) column of the function at each vertex, for the (n, 4) lengths of their gradients at rest."""
    return np.where(length[:, 0] < FLAT, 1 + np.argmax(length[:, 1:], axis=1), 0)


class _Pose:
    """Normals of a pose, and mean gradients in the planes across them.

    Attributes
    ----------
    normal : (n, 3) float64
        Unit, weighted by area; zero where the faces at a vertex cancel.
    gradient : (n, c, 3) float64
        Of each function, the mean over the 1-ring without its part along the normal.
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
        # Faces that cancel leave rounding, which is no normal.
        usable = size > NO_DIRECTION * total[:, 3:4]
        self.normal = np.divide(total[:, :3], size, out=np.zeros((mesh.n, 3)), where=usable)
        area = total[:, 3:4]
        mean = np.divide(total[:, 4:], area, out=np.zeros_like(total[:, 4:]), where=area > 0)
        mean = mean.reshape(mesh.n, -1, 3)
        along = np.einsum("nfx,nx->nf", mean, self.normal)
        self.gradient = mean - along[:, :, None] * self.normal[:, None]

    def frames(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n, 3, 3) frames [x y z] for a choice of functions, and where there is none (identity there)."""
        x = self.gradient[np.arange(len(chosen)), chosen]
        length = np.linalg.norm(x, axis=1)
        missing = (length <= NO_DIRECTION * length.max()) | ~self.normal.any(axis=1)
        x = x / np.where(missing, 1.0, length)[:, None]
        F = np.stack([x, np.cross(self.normal, x), self.normal], axis=2)
        F[missing] = np.eye(3)
        return F, missing
