"""Edits of a rest shape: what pose transfer is tried on.

Each displaces the vertices of a region smoothly; faces and numbering stay. A
place is given as fractions of the mesh's bounding box and means the vertex
nearest to it; lengths are multiples of the box's diagonal. So an edit fits any
oriented manifold mesh, whatever its unit and its number of vertices. A mesh or a
place that an edit does not fit is an InputError.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from scipy.sparse import diags_array
from scipy.sparse.csgraph import connected_components, dijkstra

from sshade import InputError, Mesh
from sshade.mesh.adjacency import vertex_graph
from sshade.solver.factorisation import Factorisation

#: Shorter edges count as so long (x diagonal) where normals are smoothed.
SHORTEST = 1e-9


class Edit(Protocol):
    """A rest shape's edit, as the configuration names it."""

    @property
    def name(self) -> str:
        """Short identifier, part of a task's name; empty where nothing is changed."""

    def __call__(self, mesh: Mesh) -> np.ndarray:
        """(n, 3) edited vertices."""


@dataclass(frozen=True)
class Unedited:
    """Return the mesh as it is: transferring it reconstructs the pose."""

    name: str = ""

    def __call__(self, mesh: Mesh) -> np.ndarray:
        """The vertices of the mesh, the same array."""
        return mesh.V


@dataclass(frozen=True)
class Inflate:
    """Move a region outwards along its normals, which are smoothed over half of its radius.

    Parameters
    ----------
    at : (3,) float
        Middle of the region, as fractions of the bounding box.
    radius, amount : float
        Distance at which the displacement has fallen to zero, and that of the
        middle, both x diagonal.
    """

    at: Sequence[float]
    radius: float
    amount: float
    name: str = "inflate"

    def __call__(self, mesh: Mesh) -> np.ndarray:
        """(n, 3) edited vertices."""
        region = _around(mesh, self.at, self.radius)
        normals = _smooth_normals(mesh, region.vertices, 0.5 * self.radius * mesh.diagonal)
        V = mesh.V.copy()
        V[region.vertices] += self.amount * mesh.diagonal * region.weight[:, None] * normals
        return V


@dataclass(frozen=True)
class Stretch:
    """Move the tip of a limb, a tail or an ear outwards along its axis.

    The axis runs from the centre of the vertices that move to the tip.

    Parameters
    ----------
    at : (3,) float
        The tip, as fractions of the bounding box.
    radius, amount : float
        Distance from the tip at which the displacement has fallen to zero, and
        that of the tip, both x diagonal.
    """

    at: Sequence[float]
    radius: float
    amount: float
    name: str = "stretch"

    def __call__(self, mesh: Mesh) -> np.ndarray:
        """(n, 3) edited vertices."""
        region = _around(mesh, self.at, self.radius)
        axis = mesh.V[region.seed] - mesh.V[region.vertices].mean(axis=0)
        axis = axis / np.linalg.norm(axis)
        V = mesh.V.copy()
        V[region.vertices] += self.amount * mesh.diagonal * region.weight[:, None] * axis
        return V


@dataclass(frozen=True)
class Horns:
    """Add horns, each straight along the mean normal of the region that it stands on.

    Parameters
    ----------
    at : (k, 3) float
        Their places, as fractions of the bounding box.
    radius, height : float
        Of each, x diagonal.
    """

    at: Sequence[Sequence[float]]
    radius: float
    height: float
    name: str = "horns"

    def __call__(self, mesh: Mesh) -> np.ndarray:
        """(n, 3) edited vertices."""
        V = mesh.V.copy()
        for place in self.at:
            region = _around(mesh, place, self.radius)
            normal = (region.weight[:, None] * _normals(mesh)[region.vertices]).sum(axis=0)
            normal = normal / np.linalg.norm(normal)
            V[region.vertices] += self.height * mesh.diagonal * region.weight[:, None] * normal
        return V


@dataclass(frozen=True)
class Fin:
    """Raise a fin along the shortest path of edges from one place to another.

    Parameters
    ----------
    start, end : (3,) float
        As fractions of the bounding box.
    width, height : float
        Half of its thickness at the surface, and its height in the middle, from
        which it falls to zero at both ends; both x diagonal.
    """

    start: Sequence[float]
    end: Sequence[float]
    width: float
    height: float
    name: str = "fin"

    def __call__(self, mesh: Mesh) -> np.ndarray:
        """(n, 3) edited vertices."""
        import igl

        _require_length(self.width, "width")
        path = _path(mesh, _place(mesh, self.start), _place(mesh, self.end))
        width = self.width * mesh.diagonal
        ridge = _smoothed(mesh.V[path], width)
        pieces = np.stack([np.arange(len(ridge) - 1), np.arange(1, len(ridge))], axis=1)
        squared, piece, nearest = igl.point_mesh_squared_distance(mesh.V, ridge, pieces)
        inside = _connected(mesh, squared < width**2, path)
        step = np.linalg.norm(np.diff(ridge, axis=0), axis=1)
        before = np.concatenate([[0.0], np.cumsum(step)])
        along = before[piece[inside]] + np.linalg.norm(nearest[inside] - ridge[piece[inside]], axis=1)
        profile = np.sin(np.pi * along / before[-1]) ** 2 * _bump(np.sqrt(squared[inside]) / width)
        normals = _smooth_normals(mesh, inside, width)
        V = mesh.V.copy()
        V[inside] += self.height * mesh.diagonal * profile[:, None] * normals
        return V


class _Region(NamedTuple):
    """Vertices near a seed, with weights that fall smoothly from 1 at the seed to 0."""

    seed: int
    vertices: np.ndarray
    weight: np.ndarray


def _around(mesh: Mesh, at: Sequence[float], radius: float) -> _Region:
    """Vertices within a ball about a place that are connected, inside the ball, to the vertex there."""
    _require_length(radius, "radius")
    seed = _place(mesh, at)
    distance = np.linalg.norm(mesh.V - mesh.V[seed], axis=1) / (radius * mesh.diagonal)
    vertices = _connected(mesh, distance < 1, np.array([seed]))
    if len(vertices) == 1:
        raise InputError(
            f"an edit of radius {radius:g} x the diagonal moves one vertex of this mesh; use a larger one"
        )
    return _Region(seed, vertices, _bump(distance[vertices]))


def _require_length(value: float, name: str) -> None:
    if not 0 < value < np.inf:
        raise InputError(f"the {name} of an edit is {value}; it must be more than 0")


def _bump(t: np.ndarray) -> np.ndarray:
    """1 at t = 0 and 0 from t = 1 on, with two continuous derivatives."""
    return np.maximum(0.0, 1 - t**2) ** 3


def _place(mesh: Mesh, at: Sequence[float]) -> int:
    if np.shape(at) != (3,) or not np.isfinite(at).all():
        raise InputError(f"a place of an edit is {at}; give three fractions of the bounding box")
    low, high = mesh.V.min(axis=0), mesh.V.max(axis=0)
    return int(np.linalg.norm(mesh.V - (low + (high - low) * at), axis=1).argmin())


def _connected(mesh: Mesh, inside: np.ndarray, seeds: np.ndarray) -> np.ndarray:
    """Vertices of a subset that are connected within it to one of the seeds, which are in it."""
    vertices = np.flatnonzero(inside)
    _, label = connected_components(vertex_graph(mesh).matrix[vertices][:, vertices], directed=False)
    wanted = np.unique(label[np.isin(vertices, seeds)])
    return vertices[np.isin(label, wanted)]


def _path(mesh: Mesh, start: int, end: int) -> np.ndarray:
    """Vertices of the shortest path along edges."""
    if start == end:
        raise InputError("a fin needs two places that are not at the same vertex")
    _, before = dijkstra(vertex_graph(mesh).matrix, indices=start, return_predecessors=True)
    path = [end]
    while path[-1] != start:
        if before[path[-1]] < 0:
            raise InputError("a fin needs two places on the same component of the mesh")
        path.append(before[path[-1]])
    return np.array(path[::-1])


def _smoothed(points: np.ndarray, length: float) -> np.ndarray:
    """A polyline averaged over a length, its ends kept."""
    step = np.linalg.norm(np.diff(points, axis=0), axis=1).mean()
    points = points.copy()
    # Each round spreads a point over a variance of half a squared step.
    for _ in range(round(2 * (length / step) ** 2)):
        points[1:-1] = 0.5 * points[1:-1] + 0.25 * (points[:-2] + points[2:])
    return points


def _normals(mesh: Mesh) -> np.ndarray:
    """(n, 3) unit normals at vertices, weighted by area."""
    total = np.zeros((mesh.n, 3))
    for c in range(3):
        for corner in range(3):
            total[:, c] += np.bincount(mesh.F[:, corner], (mesh.face_areas * mesh.face_normals[:, c]), mesh.n)
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), np.finfo(float).tiny)


def _smooth_normals(mesh: Mesh, vertices: np.ndarray, length: float) -> np.ndarray:
    """Unit normals of some vertices, diffused among them over a length."""
    near = vertex_graph(mesh).matrix[vertices][:, vertices].tocoo()
    # Weights 1 / length^2 spread as far over short edges as over long ones.
    near.data = 0.5 * (length / np.maximum(near.data, SHORTEST * mesh.diagonal)) ** 2
    near = near.tocsr()
    system = diags_array(1 + near.sum(axis=1)) - near
    spread = Factorisation(system.tocsc()).solve(_normals(mesh)[vertices])
    return spread / np.linalg.norm(spread, axis=1, keepdims=True)
