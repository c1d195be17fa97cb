"""Edits of a rest shape, for tests of pose transfer.

An edit displaces the vertices of a region smoothly; faces and numbering stay. A place is given as fractions
of the mesh's bounding box and means the nearest vertex. Lengths are fractions of the box's diagonal. An edit
therefore fits any oriented manifold mesh, whatever its unit and number of vertices. It raises InputError on
a mesh or place that it does not fit.
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

#: Minimum length of edges for smoothing normals, and of axes, as a fraction of the diagonal.
SHORTEST = 1e-9


class Edit(Protocol):
    """Interface of the edits."""

    @property
    def name(self) -> str:
        """Short identifier, added to a task's name; empty if the mesh stays."""

    def __call__(self, mesh: Mesh) -> np.ndarray:
        """Edited vertices (n, 3)."""


@dataclass(frozen=True)
class Unedited:
    """Keep the mesh. Transferring a pose to it reconstructs the pose."""

    name: str = ""

    def __call__(self, mesh: Mesh) -> np.ndarray:
        """The mesh's own array of vertices."""
        return mesh.V


@dataclass(frozen=True)
class Inflate:
    """Move a region outwards along its normals, smoothed over half of its radius.

    Parameters
    ----------
    at : (3,) float
        Centre of the region, as fractions of the bounding box.
    radius : float
        Distance from the centre at which the displacement reaches zero, as a fraction of the diagonal.
    amount : float
        Displacement of the centre, as a fraction of the diagonal.
    """

    at: Sequence[float]
    radius: float
    amount: float
    name: str = "inflate"

    def __call__(self, mesh: Mesh) -> np.ndarray:
        """Edited vertices (n, 3)."""
        region = _around(mesh, self.at, self.radius)
        normals = _smooth_normals(mesh, region.vertices, 0.5 * self.radius * mesh.diagonal)
        return _moved(mesh, region, normals, self.amount)


@dataclass(frozen=True)
class Stretch:
    """Move the tip of a limb, a tail or an ear outwards along its axis.

    The axis runs from the mean of the moved vertices to the tip.

    Parameters
    ----------
    at : (3,) float
        The tip, as fractions of the bounding box.
    radius : float
        Distance from the tip at which the displacement reaches zero, as a fraction of the diagonal.
    amount : float
        Displacement of the tip, as a fraction of the diagonal.
    """

    at: Sequence[float]
    radius: float
    amount: float
    name: str = "stretch"

    def __call__(self, mesh: Mesh) -> np.ndarray:
        """Edited vertices (n, 3)."""
        region = _around(mesh, self.at, self.radius)
        axis = mesh.V[region.seed] - mesh.V[region.vertices].mean(axis=0)
        return _moved(mesh, region, _direction(axis, mesh.diagonal), self.amount)


@dataclass(frozen=True)
class Horns:
    """Add straight horns along the mean normal of their region.

    Parameters
    ----------
    at : (k, 3) float
        Places of the horns, as fractions of the bounding box.
    radius, height : float
        Size of each horn, as fractions of the diagonal.
    """

    at: Sequence[Sequence[float]]
    radius: float
    height: float
    name: str = "horns"

    def __call__(self, mesh: Mesh) -> np.ndarray:
        """Edited vertices (n, 3)."""
        V = mesh.V.copy()
        for place in self.at:
            region = _around(mesh, place, self.radius)
            normal = (region.weight[:, None] * _normals(mesh)[region.vertices]).sum(axis=0)
            V += _moved(mesh, region, _direction(normal, 1.0), self.height) - mesh.V
        return V


@dataclass(frozen=True)
class Fin:
    """Raise a fin along the shortest path of edges from one place to another.

    Parameters
    ----------
    start, end : (3,) float
        Ends of the fin, as fractions of the bounding box.
    width : float
        Half the thickness of the fin at the surface, as a fraction of the diagonal.
    height : float
        Height in the middle of the fin, as a fraction of the diagonal. The height falls to zero at both ends.
    """

    start: Sequence[float]
    end: Sequence[float]
    width: float
    height: float
    name: str = "fin"

    def __call__(self, mesh: Mesh) -> np.ndarray:
        """Edited vertices (n, 3)."""
        import igl

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
        return _moved(mesh, _Region(path[0], inside, profile), normals, self.height)


#: Edits of bodies by name. Places are fractions of the bounding box, lengths are fractions of its diagonal.
EDITS: dict[str, Edit] = {
    "unedited": Unedited(),
    "inflate": Inflate(at=(0.5, 0.62, 0.5), radius=0.12, amount=0.05),  # a belly
    "stretch": Stretch(at=(1.0, 0.55, 0.9), radius=0.25, amount=0.1),  # a longer limb
    "horns": Horns(  # two on the head, two on the shoulders
        at=((0.45, 0.99, 0.35), (0.55, 0.99, 0.35), (0.35, 0.84, 0.3), (0.65, 0.84, 0.3)),
        radius=0.02,
        height=0.06,
    ),
    "fin": Fin(start=(0.5, 0.85, 0.0), end=(0.5, 0.55, 0.0), width=0.012, height=0.05),  # along the back
}


class _Region(NamedTuple):
    """Vertices near a seed, with weights that fall smoothly from 1 at the seed to 0."""

    seed: int
    vertices: np.ndarray
    weight: np.ndarray


def _around(mesh: Mesh, at: Sequence[float], radius: float) -> _Region:
    """Vertices within a ball about a place, connected inside the ball to the vertex at the place."""
    seed = _place(mesh, at)
    distance = np.linalg.norm(mesh.V - mesh.V[seed], axis=1) / (radius * mesh.diagonal)
    vertices = _connected(mesh, distance < 1, np.array([seed]))
    if len(vertices) == 1:
        raise InputError(
            f"an edit of radius {radius:g} x the diagonal moves one vertex of this mesh; use a larger radius"
        )
    return _Region(seed, vertices, _bump(distance[vertices]))


def _moved(mesh: Mesh, region: _Region, direction: np.ndarray, amount: float) -> np.ndarray:
    """Vertices after the displacement of a region by a fraction of the diagonal."""
    V = mesh.V.copy()
    V[region.vertices] += amount * mesh.diagonal * region.weight[:, None] * direction
    return V


def _direction(vector: np.ndarray, unit: float) -> np.ndarray:
    """Return the unit vector of a vector; raise InputError if it is no longer than rounding errors."""
    length = np.linalg.norm(vector)
    if not length > SHORTEST * unit:
        raise InputError("the region of an edit has no direction there; use another place or radius")
    return vector / length


def _bump(t: np.ndarray) -> np.ndarray:
    """Falls from 1 at t = 0 to 0 at t = 1, with two continuous derivatives."""
    return np.maximum(0.0, 1 - t**2) ** 3


def _place(mesh: Mesh, at: Sequence[float]) -> int:
    low, high = mesh.V.min(axis=0), mesh.V.max(axis=0)
    return int(np.linalg.norm(mesh.V - (low + (high - low) * at), axis=1).argmin())


def _connected(mesh: Mesh, inside: np.ndarray, seeds: np.ndarray) -> np.ndarray:
    """Vertices of a subset that are connected, within the subset, to a seed."""
    vertices = np.flatnonzero(inside)
    _, label = connected_components(vertex_graph(mesh).matrix[vertices][:, vertices], directed=False)
    wanted = np.unique(label[np.isin(vertices, seeds)])
    return vertices[np.isin(label, wanted)]


def _path(mesh: Mesh, start: int, end: int) -> np.ndarray:
    """Vertices of the shortest path along the edges."""
    if start == end:
        raise InputError("both ends of a fin are at the same vertex; move them apart")
    _, before = dijkstra(vertex_graph(mesh).matrix, indices=start, return_predecessors=True)
    path = [end]
    while path[-1] != start:
        if before[path[-1]] < 0:
            raise InputError(
                "the ends of a fin are on two components of the mesh; choose ends on the same component"
            )
        path.append(before[path[-1]])
    return np.array(path[::-1])


def _smoothed(points: np.ndarray, length: float) -> np.ndarray:
    """Smooth a polyline over a length, with fixed ends."""
    step = np.linalg.norm(np.diff(points, axis=0), axis=1).mean()
    points = points.copy()
    # Each round adds half a squared step to the variance of the smoothing kernel.
    for _ in range(round(2 * (length / step) ** 2)):
        points[1:-1] = 0.5 * points[1:-1] + 0.25 * (points[:-2] + points[2:])
    return points


def _normals(mesh: Mesh) -> np.ndarray:
    """Area-weighted unit normals (n, 3) at vertices."""
    total = np.zeros((mesh.n, 3))
    np.add.at(total, mesh.F, (mesh.face_areas[:, None] * mesh.face_normals)[:, None])
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), np.finfo(float).tiny)


def _smooth_normals(mesh: Mesh, vertices: np.ndarray, length: float) -> np.ndarray:
    """Unit normals of a subset of vertices, smoothed by diffusion over a length."""
    near = vertex_graph(mesh).matrix[vertices][:, vertices].tocoo()
    # With weights 1 / length^2 the smoothing does not depend on the lengths of the edges.
    near.data = 0.5 * (length / np.maximum(near.data, SHORTEST * mesh.diagonal)) ** 2
    near = near.tocsr()
    system = diags_array(1 + near.sum(axis=1)) - near
    spread = Factorisation(system.tocsc()).solve(_normals(mesh)[vertices])
    return spread / np.linalg.norm(spread, axis=1, keepdims=True)
