"""Small deformation tasks with known answers, for the tests of `eval` and of the methods' contract."""

from __future__ import annotations

import os
from time import sleep

import numpy as np

from eval.run.warmup import icosphere
from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.task import DeformationResult, DeformationTask, Handles, silent


def box(nx: int = 2, ny: int = 2, nz: int = 2, *, size=(1.0, 1.0, 1.0)) -> Mesh:
    """Closed box surface of nx x ny x nz cells, each square split in two, faces outwards."""
    counts = (nx, ny, nz)
    points: dict[tuple[int, int, int], int] = {}
    faces = []

    def vertex(point: tuple[int, int, int]) -> int:
        return points.setdefault(point, len(points))

    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for level, outward in ((0, False), (counts[axis], True)):
            for i in range(counts[u]):
                for j in range(counts[v]):
                    corners = []
                    for di, dj in ((0, 0), (1, 0), (1, 1), (0, 1)):
                        point = [0, 0, 0]
                        point[axis], point[u], point[v] = level, i + di, j + dj
                        corners.append(vertex(tuple(point)))
                    a, b, c, d = corners
                    both = [(a, b, c), (a, c, d)]
                    faces += both if outward else [face[::-1] for face in both]
    V = np.array(list(points), dtype=float) / counts * size
    return Mesh(V, np.array(faces))


def bumpy_sphere(level: int = 3) -> Mesh:
    """Closed surface without symmetry: no two of its edges tie in length."""
    mesh = icosphere(level)
    x, y, z = mesh.V.T
    radius = 1 + 0.2 * np.sin(3 * x) + 0.1 * np.cos(5 * y + z) + 0.05 * np.sin(4 * z + x + 1)
    return Mesh(mesh.V * radius[:, None] * [1.0, 1.3, 2.0], mesh.F)


def ends_task(mesh: Mesh, *, angle: float = 30.0, lift: float = 0.1, name: str = "ends") -> DeformationTask:
    """Hold the lowest tenth along z, turn the highest tenth about z by `angle` degrees and lift it."""
    z = mesh.V[:, 2]
    low, high = z.min() + 0.1 * np.ptp(z), z.max() - 0.1 * np.ptp(z)
    static, dynamic = np.flatnonzero(z <= low), np.flatnonzero(z >= high)
    cos, sin = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    handles = Handles(
        index=np.concatenate([static, dynamic]),
        target=np.concatenate([mesh.V[static], mesh.V[dynamic] @ turn.T + [0, 0, lift]]),
        dynamic=np.repeat([False, True], [len(static), len(dynamic)]),
        group=np.repeat([0, 1], [len(static), len(dynamic)]),
    )
    return DeformationTask(name=name, mesh=mesh, handles=handles, meta={"angle": angle})


def bumpy_task(*, level: int = 3, angle: float = 30.0) -> DeformationTask:
    """What ``dataset=bumpy`` loads."""
    return ends_task(bumpy_sphere(level), angle=angle, name=f"bumpy_{angle:g}")


def list_cases(root: str, *, subjects=None, poses=None) -> list[tuple[int, int]]:
    """What ``dataset=listed`` has: two poses of subject 0, one of subject 1."""
    there = [(0, 1), (0, 2), (1, 1)]
    for pose in poses or ():
        if pose not in {p for _, p in there}:
            raise InputError(f"there is no pose {pose}")
    return [(s, p) for s, p in there if s in (subjects or (0, 1)) and p in (poses or (1, 2))]


def listed_task(root: str, *, subject: int, pose: int) -> DeformationTask:
    """What ``dataset=listed`` loads: the turn tells the case."""
    return bumpy_task(level=2, angle=10 * subject + pose)


def failing(task, *, seed: int, progress=silent) -> DeformationResult:
    """A method that raises."""
    raise ArithmeticError("this method\nalways fails")


def missing_extra(task, *, seed: int, progress=silent) -> DeformationResult:
    """A method whose extra is not installed."""
    raise ImportError("torch is not installed; pip install sshade[torch]")


def stretching(task, *, factor: float = 2.0, seed: int, progress=silent) -> DeformationResult:
    """A method that scales; it never converges."""
    return DeformationResult(
        vertices=task.mesh.V * factor,
        iterations=7,
        converged=False,
        seconds={"solve": 0.5},
        extra={"residual": np.float64(np.inf), "rotations": np.zeros((2, 3, 3))},
    )


def endless(task, *, seed: int, progress=silent) -> DeformationResult:
    """A method that does not return, except on the mesh of the warm-up."""
    while task.mesh.n != 642:
        sleep(0.01)
    return DeformationResult(vertices=task.mesh.V, iterations=0, converged=None)


def endless_warm_up(task, *, seed: int, progress=silent) -> DeformationResult:
    """A method that does not return on the mesh of the warm-up."""
    while task.mesh.n == 642:
        sleep(0.01)
    return DeformationResult(vertices=task.mesh.V, iterations=0, converged=None)


def dying(task, *, seed: int, progress=silent) -> DeformationResult:
    """A method that takes its process down."""
    os._exit(3)


def with_losses(task, *, seed, progress=silent):
    """A method that records a loss a step."""
    curve = np.array([[3.0, 1.0], [0.5, 0.25]], dtype=np.float32)
    return DeformationResult(
        task.mesh.V, iterations=2, converged=None, extra={"loss_curve": curve, "rotations": np.eye(3)}
    )
