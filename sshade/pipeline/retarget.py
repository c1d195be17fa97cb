"""Retargeting: a mesh in many poses drives another mesh, which has other vertices, through marks on both.

A mark is a vertex of the source and the vertex of the target at the same place of the body. First, a smooth
map through the marks brings the source at rest into the shape of the target. This fitted source has the faces
of the source and the proportions of the target. For a pose, each of its faces then deforms as the same face
of the source does (deformation transfer): a sparse system, factorised once, gives the positions with the
nearest gradients. The marks there are the targets of handles of the target mesh, which
:func:`sshade.deform_sequence` deforms.

R. W. Sumner, J. Popovic, "Deformation transfer for triangle meshes", 2004.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csc_array, csr_array
from scipy.sparse.linalg import splu

from sshade.errors import InputError
from sshade.handles import Handles
from sshade.mesh.mesh import Mesh, require_mesh
from sshade.options import accepted, takes_options
from sshade.pipeline.deform import deform_task
from sshade.pipeline.sequence import deform_sequence
from sshade.progress import Progress, silent
from sshade.task import DeformationResult, DeformationTask

#: Least number of marks: a smooth map needs four.
LEAST_MARKS = 4
#: Least doubled area of a face of the fitted source, as a fraction of the squared diagonal. Smaller faces
#: count as faces of this area.
LEAST_AREA = 1e-14


class Retargeting:
    """Moves marks on a target mesh as a source mesh moves.

    Parameters
    ----------
    source, target : Mesh
        Rest shapes, in similar poses, with the same axes. Sizes and proportions may differ. The target may be
        of any kind; all marks lie on one component of the source, and its other components are ignored.
    marks : (k, 2) int
        Vertices of the source and of the target, at least four, each once. Limbs need marks on all sides.

    Raises
    ------
    InputError
        On fewer marks, ids that are out of range or twice, and marks on several components of the source.
    """

    def __init__(self, source: Mesh, target: Mesh, marks: np.ndarray) -> None:
        for mesh in (source, target):
            require_mesh(mesh, "Retargeting")
        marks = _checked(marks, source, target)
        component = source.component[marks[:, 0]]
        if (component != component[0]).any():
            raise InputError("the marks lie on several components of the source, and must lie on one")
        self.source, self.target, self.marks = source, target, marks
        used = np.flatnonzero(source.component == component[0])
        F = np.searchsorted(used, source.F[source.component[source.F[:, 0]] == component[0]])
        self._used, self._at = used, np.searchsorted(used, marks[:, 0])
        self._rest = Mesh(source.V[used], F)
        places = Handles(self._at, target.V[marks[:, 1]])
        fit = DeformationTask("fit", self._rest, places)
        #: The source at rest in the shape of the target.
        self.fitted = Mesh(deform_task(fit, method="fast", warp="always").vertices, F)
        self._size = float(np.sqrt(self.fitted.area / self._rest.area))

    def __call__(self, posed: np.ndarray) -> np.ndarray:
        """Return the positions (k, 3) of the marks on the target for a pose (n, 3) of the source.

        Raises
        ------
        InputError
            When the pose has other vertices than the source, or a position is not finite.
        """
        V = self.source.checked(posed, "pose of the source")[self._used]
        rest, fitted = self._rest, self.fitted
        maps = _edges(V, rest.F) @ self._inverse
        maps[rest.face_areas == 0] = np.eye(3)
        gradients = np.einsum("fab,fib->fia", maps, self._gradients)
        B = self._operator.T @ (self._weight[:, None] * gradients.reshape(-1, 3))
        moved = np.zeros_like(V)
        moved[1:] = self._factorised.solve(B[1:])
        weight = rest.vertex_areas / rest.vertex_areas.sum()
        step = self._size * (weight @ (V - rest.V))
        return moved[self._at] + weight @ (fitted.V - moved) + step

    @cached_property
    def _operator(self) -> csr_array:
        """(3 m, n): the gradients of functions on the fitted source, three rows for each face."""
        V, F, m = self.fitted.V, self.fitted.F, self.fitted.m
        normal, _ = _normals(V, F)
        double = 2 * self._weight[::3]
        sides = [V[F[:, (i + 2) % 3]] - V[F[:, (i + 1) % 3]] for i in range(3)]
        values = np.cross(normal, sides) / double[:, None]
        places = np.tile(np.arange(3 * m), 3), np.repeat(F.T.ravel(), 3)
        return csr_array((values.ravel(), places), shape=(3 * m, len(V)))

    @cached_property
    def _weight(self) -> np.ndarray:
        """(3 m,): areas of the faces of the fitted source."""
        double = _normals(self.fitted.V, self.fitted.F)[1]
        return np.repeat(0.5 * np.maximum(double, LEAST_AREA * self.fitted.diagonal**2), 3)

    @cached_property
    def _inverse(self) -> np.ndarray:
        """(m, 3, 3): inverse matrices of the edges of the source at rest; zero where a face has no area."""
        edges, flat = _edges(self._rest.V, self._rest.F), self._rest.face_areas == 0
        edges[flat] = np.eye(3)
        found = np.linalg.inv(edges)
        found[flat] = 0.0
        return found

    @cached_property
    def _gradients(self) -> np.ndarray:
        """(m, 3, 3): the gradients of the coordinates of the fitted source."""
        return (self._operator @ self.fitted.V).reshape(-1, 3, 3)

    @cached_property
    def _factorised(self) -> Any:
        """The Laplacian of the fitted source without its first vertex, which stays at the origin."""
        weighted = self._operator.multiply(self._weight[:, None])
        return splu(csc_array(self._operator.T @ weighted)[1:, 1:])

    def task(self) -> DeformationTask:
        """Return the target with handles at its marks, each in a group of its own, at rest."""
        index = self.marks[:, 1]
        handles = Handles(index, self.target.V[index], group=np.arange(len(index)))
        return DeformationTask("retarget", self.target, handles, carry_unconstrained=True)


@takes_options(lambda given: (*accepted(given.get("method", "fast")), "progress"))
def retarget(
    source: Mesh,
    poses: Iterable[np.ndarray],
    target: Mesh,
    *,
    marks: np.ndarray,
    method: str = "fast",
    progress: Progress = silent,
    **options: Any,
) -> Iterator[DeformationResult]:
    """Drive a mesh by the poses of another mesh; yield the target for each pose.

    Parameters
    ----------
    source : Mesh
        Rest shape of the driving mesh.
    poses : iterable of (n, 3) float64
        Its vertices in each pose.
    target : Mesh
        Rest shape of the mesh to move, in a similar pose, with the same axes.
    marks : (k, 2) int
        Vertices of the source and of the target at the same places; see :class:`Retargeting`. Forty to a
        hundred, on all sides of each limb, serve animals and people.
    method, **options
        See :func:`sshade.deform`.
    progress : Progress
        See :func:`sshade.deform_sequence`.

    Yields
    ------
    DeformationResult
        See :func:`sshade.deform_sequence`.

    Raises
    ------
    InputError
        See :class:`Retargeting` and :func:`sshade.deform_sequence`.
    """
    driver = Retargeting(source, target, marks)
    targets = (driver(posed) for posed in poses)
    return deform_sequence(driver.task(), targets, method=method, progress=progress, **options)


def _checked(marks: np.ndarray, source: Mesh, target: Mesh) -> np.ndarray:
    """Return marks as (k, 2) int64, and raise InputError unless they are vertices of both meshes."""
    marks = np.asarray(marks)
    if marks.ndim != 2 or marks.shape[1] != 2 or not np.issubdtype(marks.dtype, np.integer):
        raise InputError("marks are pairs of vertex ids, of the source and of the target")
    if len(marks) < LEAST_MARKS:
        raise InputError(f"{len(marks)} marks are given, and at least {LEAST_MARKS} are needed")
    for name, mesh, ids in (("source", source, marks[:, 0]), ("target", target, marks[:, 1])):
        outside = ids[(ids < 0) | (ids >= mesh.n)]
        if len(outside):
            raise InputError(f"a mark is at vertex {outside[0]} of the {name}, which has {mesh.n} vertices")
        unique, count = np.unique(ids, return_counts=True)
        if (count > 1).any():
            raise InputError(f"two marks are at vertex {unique[count.argmax()]} of the {name}")
    return marks.astype(np.int64)


def _normals(V: np.ndarray, F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return unit normals (m, 3), zero where a face has no area, and doubled areas (m,)."""
    normal = np.cross(V[F[:, 1]] - V[F[:, 0]], V[F[:, 2]] - V[F[:, 0]])
    double = np.linalg.norm(normal, axis=1)
    return normal / np.where(double > 0, double, 1.0)[:, None], double


def _edges(V: np.ndarray, F: np.ndarray) -> np.ndarray:
    """Return the matrices (m, 3, 3) of two edges and a normal of a length between theirs."""
    a, b = V[F[:, 1]] - V[F[:, 0]], V[F[:, 2]] - V[F[:, 0]]
    normal, double = _normals(V, F)
    return np.stack([a, b, np.sqrt(double)[:, None] * normal], axis=2)
