"""Bent bars and sheets, and local/global iterations straight from the definitions."""

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from sshade import DeformationTask, Handles, Mesh
from tests.shapes import block, jittered, strip


def bend(mesh: Mesh, *, axis: int, pivot: list[float]) -> DeformationTask:
    """Return a task that turns the last layer along an axis by 90 degrees about y and a point."""
    low, high = mesh.V[:, axis].min() + 0.6, mesh.V[:, axis].max() - 0.6
    index = np.flatnonzero((mesh.V[:, axis] < low) | (mesh.V[:, axis] > high))
    R = Rotation.from_rotvec(np.deg2rad(90) * np.eye(3)[1]).as_matrix()
    moved = (mesh.V - pivot) @ R.T + pivot
    target = np.where((high < mesh.V)[:, [axis]], moved, mesh.V)[index]
    return DeformationTask("bend", mesh, Handles(index, target))


TASKS = {
    "bar": bend(jittered(block(np.ones((2, 2, 8)), cells=2), 0.03), axis=2, pivot=[1.0, 1.0, 4.0]),
    "strip": bend(jittered(strip(20, 5), 0.1), axis=0, pivot=[10.0, 2.5, 0.0]),
}


def svd_rotations(S: np.ndarray) -> np.ndarray:
    U, _, Vt = np.linalg.svd(S)
    V, Ut = Vt.transpose(0, 2, 1), U.transpose(0, 2, 1)
    sign = np.ones((len(S), 3))
    sign[:, 2] = np.linalg.det(V @ Ut)
    return (V * sign[:, None]) @ Ut


def vertex_areas(mesh: Mesh) -> np.ndarray:
    """Return a third (n,) of the area of the faces around each vertex."""
    area = np.zeros(mesh.n)
    for face in mesh.F:
        a, b, c = mesh.V[face]
        area[face] += np.linalg.norm(np.cross(b - a, c - a)) / 6
    return area


class Naive:
    """Plain local/global straight from the definitions."""

    def __init__(self, task: DeformationTask, energy: str) -> None:
        self.V, self.index, self.targets = task.mesh.V, task.handles.index, task.handles.target
        F = task.mesh.F
        self.k, self.j, opposite = (np.roll(F, -c, axis=1).ravel() for c in range(3))
        a, b = self.V[self.k] - self.V[opposite], self.V[self.j] - self.V[opposite]
        self.h = 0.5 * (a * b).sum(axis=1) / np.linalg.norm(np.cross(a, b), axis=1)
        self.rest = self.V[self.k] - self.V[self.j]
        # Vertices whose cells contain the term of the edge from j to k with weight h.
        spokes = np.stack([self.k, self.j], axis=1)
        self.cells = spokes if energy == "spokes" else np.repeat(F, 3, axis=0)
        n = len(self.V)
        weights = csc_matrix((self.h, (self.k, self.j)), shape=(n, n)).toarray()
        weights += weights.T
        self.L = np.diag(weights.sum(axis=1)) - weights
        self.free = np.setdiff1d(np.arange(n), self.index)
        self.to_handles = self.L[self.free][:, self.index]
        self.laplacian = self.L[self.free][:, self.free]
        self.lu = splu(csc_matrix(self.laplacian))

    def rotations(self, U: np.ndarray) -> np.ndarray:
        return svd_rotations(self.covariances(U))

    def covariances(self, U: np.ndarray) -> np.ndarray:
        S = np.zeros((len(U), 3, 3))
        terms = self.h[:, None, None] * self.rest[:, :, None] * (U[self.k] - U[self.j])[:, None]
        np.add.at(S, self.cells, terms[:, None])
        return S

    def energy(self, U: np.ndarray, R: np.ndarray) -> float:
        # For spokes, `cells` lists the two end points of every edge, because each edge is in both cells.
        turned = np.einsum("tcxy,ty->tcx", R[self.cells], self.rest)
        squares = ((U[self.k] - U[self.j])[:, None] - turned) ** 2
        return float((self.h * squares.sum(axis=(1, 2))).sum())

    def iterate(self, U: np.ndarray) -> np.ndarray:
        U = U.copy()
        U[self.index] = self.targets
        return self.positions(self.rotations(U))

    def positions(self, R: np.ndarray) -> np.ndarray:
        """Return the positions of least energy for rotations (n, 3, 3)."""
        U = np.empty_like(self.V)
        U[self.index] = self.targets
        b = self.right_hand_side(R)
        U[self.free] = self.lu.solve(b[self.free] - self.to_handles @ self.targets)
        return U

    def right_hand_side(self, R: np.ndarray) -> np.ndarray:
        b = np.zeros_like(self.V)
        force = self.h[:, None] * np.einsum("txy,ty->tx", R[self.cells].mean(axis=1), self.rest)
        np.add.at(b, self.k, force)
        np.subtract.at(b, self.j, force)
        return b
