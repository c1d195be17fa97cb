"""Bent bars and sheets, and local/global iterations straight from the definitions."""

import math

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from sshade import DeformationTask, Handles, Mesh
from tests.shapes import block, jittered, strip


def bent_bar() -> DeformationTask:
    """A jittered 2 x 2 x 8 bar whose last layer is turned by 90 degrees."""
    return bend(jittered(block(np.ones((2, 2, 8)), cells=2), 0.03), axis=2, pivot=[1.0, 1.0, 4.0])


def bent_strip() -> DeformationTask:
    """An open sheet, out of its plane, one end of which is turned by 90 degrees."""
    return bend(jittered(strip(20, 5), 0.1), axis=0, pivot=[10.0, 2.5, 0.0])


def bend(mesh: Mesh, *, axis: int, pivot: list[float]) -> DeformationTask:
    low, high = mesh.V[:, axis].min() + 0.6, mesh.V[:, axis].max() - 0.6
    index = np.flatnonzero((mesh.V[:, axis] < low) | (mesh.V[:, axis] > high))
    R = Rotation.from_rotvec(np.deg2rad(90) * np.eye(3)[1]).as_matrix()
    moved = (mesh.V - pivot) @ R.T + pivot
    return DeformationTask(
        "bend", mesh, Handles(index, np.where((high < mesh.V)[:, [axis]], moved, mesh.V)[index])
    )


TASKS = {"bar": bent_bar(), "strip": bent_strip()}


def svd_rotations(S: np.ndarray) -> np.ndarray:
    U, _, Vt = np.linalg.svd(S)
    V, Ut = Vt.transpose(0, 2, 1), U.transpose(0, 2, 1)
    sign = np.ones((len(S), 3))
    sign[:, 2] = np.linalg.det(V @ Ut)
    return (V * sign[:, None]) @ Ut


def vertex_areas(mesh: Mesh) -> np.ndarray:
    """(n,) a third of the area of the faces at each vertex."""
    area = np.zeros(mesh.n)
    for face in mesh.F:
        a, b, c = mesh.V[face]
        area[face] += np.linalg.norm(np.cross(b - a, c - a)) / 6
    return area


class Naive:
    """Plain local/global straight from the definitions."""

    def __init__(self, task: DeformationTask, energy: str) -> None:
        self.V, self.index, self.targets = task.mesh.V, task.handles.index, task.handles.target
        self.terms = []  # (k, j, h_kj, the vertices whose cells hold this term)
        for face in task.mesh.F.tolist():
            for c in range(3):
                k, j, opposite = face[c], face[(c + 1) % 3], face[(c + 2) % 3]
                a, b = self.V[k] - self.V[opposite], self.V[j] - self.V[opposite]
                angle = math.atan2(np.linalg.norm(np.cross(a, b)), a @ b)
                self.terms.append(
                    (k, j, 0.5 / math.tan(angle), (k, j) if energy == "spokes" else tuple(face))
                )
        n = len(self.V)
        L = np.zeros((n, n))
        for k, j, h, _ in self.terms:
            L[[k, j, k, j], [k, j, j, k]] += h * np.array([1, 1, -1, -1])
        self.free = np.setdiff1d(np.arange(n), self.index)
        self.to_handles = L[self.free][:, self.index]
        self.laplacian = L[self.free][:, self.free]
        self.lu = splu(csc_matrix(self.laplacian))

    def rotations(self, U: np.ndarray) -> np.ndarray:
        return svd_rotations(self.covariances(U))

    def covariances(self, U: np.ndarray) -> np.ndarray:
        S = np.zeros((len(U), 3, 3))
        for k, j, h, cells in self.terms:
            for i in cells:
                S[i] += h * np.outer(self.V[k] - self.V[j], U[k] - U[j])
        return S

    def energy(self, U: np.ndarray, R: np.ndarray) -> float:
        total = 0.0
        for k, j, h, cells in self.terms:
            for i in cells:
                # Spokes: every edge belongs to its two end points' cells, as here.
                total += h * (((U[k] - U[j]) - R[i] @ (self.V[k] - self.V[j])) ** 2).sum()
        return total

    def iterate(self, U: np.ndarray) -> np.ndarray:
        U = U.copy()
        U[self.index] = self.targets
        return self.positions(self.rotations(U))

    def positions(self, R: np.ndarray) -> np.ndarray:
        """Where the energy is least for rotations (n, 3, 3)."""
        U = np.empty_like(self.V)
        U[self.index] = self.targets
        b = self.right_hand_side(R)
        U[self.free] = self.lu.solve(b[self.free] - self.to_handles @ self.targets)
        return U

    def right_hand_side(self, R: np.ndarray) -> np.ndarray:
        b = np.zeros_like(self.V)
        for k, j, h, cells in self.terms:
            force = h * np.mean([R[i] for i in cells], axis=0) @ (self.V[k] - self.V[j])
            b[k] += force
            b[j] -= force
        return b
