"""Points that go with a mesh: bound once, placed for each pose of the mesh.

Each triangle has an affine map from rest to pose. It takes the sides to the posed sides, and the normal n
to s n'. The square of s is the area of the posed surface over the area at rest, so that rigid motions and
uniform scales are exact. A sample of the surface has the mean of the maps around it. A point x moves to

    x' = sum_k w_k (A_k x + t_k) ,

with triangles and samples k near x, and weights that are continuous in x (:mod:`sshade.carry.trees`). Its
linear map is the mean A = sum_k w_k A_k, and its rotation is the rotation nearest to A.

Properties:

- A point on a triangle keeps its place on it.
- x' is continuous in x, also halfway between two limbs. Where the limbs are a gap g apart and their motions
  differ by d, the blend between them stretches space by 4 d / g at most, or by up to 6.3 d / g where g is as
  large as the radii of curvature.
- A is continuous off the surface. Across an edge on the surface it jumps as the affine maps of triangles do.

Weights are those of a partition of unity as in H. Whitney, "Analytic extensions of differentiable functions
defined in closed sets", 1934, where the detail of the map also grows with the distance from the set.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from sshade.carry.blended import nearest_rotations
from sshade.carry.frames import checked_out
from sshade.carry.surface_samples import SurfaceSamples, sample_surface
from sshade.carry.trees import LEAF, box_tree, curve_order, squared_distances, triangles_of_leaves, weigh
from sshade.errors import InputError
from sshade.kernels import kernel, subroutine
from sshade.mesh.mesh import Mesh, bounds, require_mesh
from sshade.task import DeformationResult
from sshade.threads import ThreadTeam, available_cpus, in_ranges

#: Largest distance of a point from the surface, as a fraction of the bounding-box diagonal. No point
#: inside of a closed surface is farther away.
FARTHEST = 0.5
#: Number of points or elements that a thread treats at a time.
ROWS = 8192


class PosedPoints(NamedTuple):
    """Points in a pose.

    Attributes
    ----------
    positions : (m, 3) float64
    rotations : (m, 3, 3) float64
        Rotation of the surface around each point.
    maps : (m, 3, 3) float64
        Linear map around each point: rotation and stretch.
    """

    positions: np.ndarray
    rotations: np.ndarray
    maps: np.ndarray


class HasMesh(Protocol):
    """A :class:`sshade.Deformer`, or another object with the mesh at rest."""

    mesh: Mesh


def bind_points(mesh: HasMesh | Mesh, points: np.ndarray) -> BoundPoints:
    """Bind points to a mesh, to be carried to any pose of it.

    Parameters
    ----------
    mesh : Deformer or Mesh
        The mesh at rest. It may have several components, boundaries and edges of many faces.
    points : (m, 3) float64
        On the surface, inside of it, or near it: at most :data:`FARTHEST` of the bounding-box diagonal away.

    Raises
    ------
    InputError
        On another shape, a NaN or infinite coordinate, a point that is too far away, or a mesh without area.

    Examples
    --------
    >>> import numpy as np
    >>> from sshade import Mesh, bind_points
    >>> V = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    >>> bound = bind_points(Mesh(V, np.array([[0, 1, 2], [0, 2, 3]])), [[0.5, 0.2, 0.1]])
    >>> bound(V + [0, 0, 2]).round(6).tolist()
    [[0.5, 0.2, 2.1]]
    >>> turned = V @ [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]
    >>> (bound.with_maps(turned).rotations[0].round(6) + 0.0).tolist()
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    rest: Any = getattr(mesh, "mesh", mesh)
    return PointBinder(rest).bind(points)


class PointBinder:
    """A mesh with search trees, to which several sets of points are bound.

    Parameters
    ----------
    mesh : Mesh

    Raises
    ------
    InputError
        If no face has an area.
    """

    def __init__(self, mesh: Mesh) -> None:
        require_mesh(mesh, "bind_points")
        self.mesh = mesh
        faces = np.flatnonzero(mesh.face_areas > 0)
        if not len(faces):
            raise InputError("no face of the mesh has an area: there is nothing to bind points to")
        corners = (mesh.V - mesh.origin)[mesh.F[faces]]
        order = curve_order(corners.mean(axis=1))
        faces, corners = faces[order], corners[order]
        self._F, self._areas = np.ascontiguousarray(mesh.F[faces]), mesh.face_areas[faces]
        self._tree = box_tree(corners.min(axis=1), corners.max(axis=1), leaf=LEAF)
        self._triangles, self._corners = triangles_of_leaves(corners), corners.reshape(-1, 9)
        self._inverse = np.empty((len(faces), 9))
        in_ranges(_invert, len(faces), self._corners, self._inverse)
        self._samples: SurfaceSamples = sample_surface(corners, self._areas, mesh.face_normals[faces])

    def bind(self, points: np.ndarray) -> BoundPoints:
        """Bind points (m, 3); see :func:`bind_points`."""
        X = np.asarray(points, dtype=np.float64)
        if X.ndim != 2 or X.shape[1] != 3:
            raise InputError(f"points must be an (m, 3) array, not one of shape {X.shape}")
        if len(bad := np.flatnonzero(~np.isfinite(X).all(axis=1))):
            raise InputError(f"point {bad[0]} has a NaN or infinite coordinate")
        X = X - self.mesh.origin
        self._require_near(X, self._box_distances(X), "box")
        if not len(X):
            none = np.empty(0, dtype=np.int64)
            return BoundPoints(
                self, X, none, np.zeros(1, np.int64), none.astype(np.uint32), np.empty(0, np.float32)
            )
        order = curve_order(X)
        X = X.take(order, axis=0)
        squared, found = np.empty(len(X)), self._samples
        in_ranges(squared_distances, len(X), X, self._triangles, self._tree, squared)
        self._require_near(X, np.sqrt(squared), "surface", order)
        triangles = self._corners, self._triangles, self._tree
        samples = found.spacing, found.levels, found.boxes, found.begin, found.parts
        parts = in_ranges(weigh, len(X), X, squared, *triangles, *samples)
        count, element, weight = (np.concatenate(column) for column in zip(*parts, strict=True))
        start = np.concatenate([[0], np.cumsum(count)])
        return BoundPoints(self, X, order, start, element, weight)

    def _box_distances(self, X: np.ndarray) -> np.ndarray:
        low, high = self._tree[1, :3], self._tree[1, 3:]
        return np.linalg.norm(np.maximum(np.maximum(low - X, X - high), 0.0), axis=1)

    def _require_near(
        self, X: np.ndarray, distance: np.ndarray, what: str, order: np.ndarray | None = None
    ) -> None:
        """Raise InputError if a point is too far from the box or the surface of the mesh."""
        far = distance > FARTHEST * self.mesh.diagonal
        if far.any():
            worst = int(np.argmax(distance))
            number = worst if order is None else int(order[worst])
            allowed = FARTHEST * self.mesh.diagonal
            raise InputError(
                f"{int(far.sum())} of {len(X)} points are too far from the {what} of the mesh: point "
                f"{number} by {distance[worst]:.3g}, where {allowed:.3g} is allowed, {100 * FARTHEST:.0f} % "
                "of the diagonal; leave them out, or check the units"
            )

    def maps(self, V: np.ndarray, team: ThreadTeam) -> np.ndarray:
        """Return the rows A and t (e, 12) of the maps of triangles and samples, for a pose V (n, 3)."""
        triangles, samples = len(self._F), sum(len(means.start) - 1 for means in self._samples.means)
        M = np.empty((triangles + samples, 12))
        areas = team.ranges(_normals, triangles, V, self._F, M, rows=ROWS)
        scale = np.sqrt(sum(areas) / self._areas.sum())
        rest = self._F, self._corners, self._inverse
        team.ranges(_triangle_maps, triangles, V, *rest, scale, M, rows=ROWS)
        before, here = 0, triangles
        for means in self._samples.means:
            rows = len(means.start) - 1
            team.ranges(_mean_maps, rows, *means, M, before, here, rows=ROWS)
            before, here = here, here + rows
        return M


@dataclass(frozen=True, eq=False)
class BoundPoints:
    """Points bound to a mesh by :func:`bind_points`; call it with a pose to get their positions.

    Attributes
    ----------
    binder : PointBinder
    points : (m, 3) float64
        Rest positions relative to the mesh's origin, in an order that keeps neighbours together.
    order : (m,) int64
        Number of each of them as it was bound.
    start : (m + 1,) int64
        The elements of point i are the entries from ``start[i]`` to ``start[i + 1]``.
    element : (k,) uint32
    weight : (k,) float32
        In proportion to w; divided by their sum at each call.
    """

    binder: PointBinder
    points: np.ndarray
    order: np.ndarray
    start: np.ndarray
    element: np.ndarray
    weight: np.ndarray

    def __len__(self) -> int:
        return len(self.points)

    def __call__(self, pose: DeformationResult | np.ndarray, *, out: np.ndarray | None = None) -> np.ndarray:
        """Return the positions (m, 3) of the points in a pose of the mesh.

        Parameters
        ----------
        pose : DeformationResult or (n, 3) float64
            Posed vertices of the mesh.
        out : (m, 3) float64, C-contiguous, optional
            Array for the positions; by default a new one.

        Raises
        ------
        InputError
            When the pose has another number of vertices, a position is not finite, or `out` is another array.
        """
        positions = checked_out(out, (len(self), 3))
        self._place(pose, positions, np.empty((0, 9)))
        return positions

    def with_maps(self, pose: DeformationResult | np.ndarray) -> PosedPoints:
        """Return positions, rotations and linear maps of the points in a pose; see :meth:`__call__`."""
        positions, rows = np.empty((len(self), 3)), np.empty((len(self), 9))
        self._place(pose, positions, rows)
        maps = rows.reshape(-1, 3, 3)
        return PosedPoints(positions, nearest_rotations_in_threads(maps), maps)

    def _place(self, pose: DeformationResult | np.ndarray, positions: np.ndarray, maps: np.ndarray) -> None:
        mesh = self.binder.mesh
        V = mesh.checked(pose.vertices if isinstance(pose, DeformationResult) else pose, "pose")
        low, high = bounds(V)
        near = 0.5 * (low + high)
        with ThreadTeam(available_cpus() if len(self) > ROWS else 1) as team:
            M = self.binder.maps(V - near, team)
            weights = self.start, self.element, self.weight
            posed = M, near, positions, maps
            team.ranges(_blend, len(self), self.points, self.order, *weights, *posed, rows=ROWS)


def nearest_rotations_in_threads(A: np.ndarray) -> np.ndarray:
    """Return the rotations R (k, 3, 3) nearest to matrices A (k, 3, 3), computed in several threads."""
    with ThreadTeam(available_cpus() if len(A) > ROWS else 1) as team:
        parts = team.ranges(lambda first, end: nearest_rotations(A[first:end]), len(A), rows=ROWS)
    return np.concatenate([A[:0], *parts])


@subroutine(inline="always")
def _cross(u, v):
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


@kernel
def _invert(first, end, corners, inverse):
    """Write the rows of the inverse of the matrix with the columns e1, e2 and n of each triangle."""
    for i in range(first, end):
        c = corners[i]
        u = c[3] - c[0], c[4] - c[1], c[5] - c[2]
        v = c[6] - c[0], c[7] - c[1], c[8] - c[2]
        n = _cross(u, v)
        squared = n[0] * n[0] + n[1] * n[1] + n[2] * n[2]
        one, other = _cross(v, n), _cross(n, u)
        length = np.sqrt(squared)
        for a in range(3):
            inverse[i, a], inverse[i, 3 + a] = one[a] / squared, other[a] / squared
            inverse[i, 6 + a] = n[a] / length


@kernel
def _normals(first, end, V, F, M):
    """Write unit normals to M[:, :3], zero without area; return the area."""
    total = 0.0
    for i in range(first, end):
        a, b, c = F[i, 0], F[i, 1], F[i, 2]
        u = V[b, 0] - V[a, 0], V[b, 1] - V[a, 1], V[b, 2] - V[a, 2]
        v = V[c, 0] - V[a, 0], V[c, 1] - V[a, 1], V[c, 2] - V[a, 2]
        n = _cross(u, v)
        length = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
        total += 0.5 * length
        scale = 1.0 / length if length > 0.0 else 0.0
        M[i, 0], M[i, 1], M[i, 2] = scale * n[0], scale * n[1], scale * n[2]
    return total


@kernel
def _triangle_maps(first, end, V, F, corners, inverse, scale, M):
    for i in range(first, end):
        a, b, c = F[i, 0], F[i, 1], F[i, 2]
        r = inverse[i]
        x, y, z = corners[i, 0], corners[i, 1], corners[i, 2]
        normal = scale * M[i, 0], scale * M[i, 1], scale * M[i, 2]
        for k in range(3):
            u, v, n = V[b, k] - V[a, k], V[c, k] - V[a, k], normal[k]
            p = u * r[0] + v * r[3] + n * r[6]
            q = u * r[1] + v * r[4] + n * r[7]
            s = u * r[2] + v * r[5] + n * r[8]
            M[i, 3 * k], M[i, 3 * k + 1], M[i, 3 * k + 2] = p, q, s
            M[i, 9 + k] = V[a, k] - p * x - q * y - s * z


@kernel
def _mean_maps(first, end, start, row, weight, M, before, here):
    for i in range(first, end):
        for c in range(12):
            M[here + i, c] = 0.0
        for j in range(start[i], start[i + 1]):
            w, k = weight[j], before + row[j]
            for c in range(12):
                M[here + i, c] += w * M[k, c]


# Sums in twelve variables stay in registers; in an array they would not.
@kernel(fastmath={"contract"}, error_model="numpy")
def _blend(first, end, X, order, start, element, weight, M, near, positions, maps):
    for i in range(first, end):
        a0 = a1 = a2 = a3 = a4 = a5 = a6 = a7 = a8 = a9 = a10 = a11 = 0.0
        amount = 0.0
        for j in range(np.uint64(start[i]), np.uint64(start[i + 1])):
            w, k = np.float64(weight[j]), np.uint64(element[j])
            amount += w
            a0, a1, a2 = a0 + w * M[k, 0], a1 + w * M[k, 1], a2 + w * M[k, 2]
            a3, a4, a5 = a3 + w * M[k, 3], a4 + w * M[k, 4], a5 + w * M[k, 5]
            a6, a7, a8 = a6 + w * M[k, 6], a7 + w * M[k, 7], a8 + w * M[k, 8]
            a9, a10, a11 = a9 + w * M[k, 9], a10 + w * M[k, 10], a11 + w * M[k, 11]
        s, p = 1.0 / amount, order[i]
        x, y, z = X[i, 0], X[i, 1], X[i, 2]
        positions[p, 0] = s * (a0 * x + a1 * y + a2 * z + a9) + near[0]
        positions[p, 1] = s * (a3 * x + a4 * y + a5 * z + a10) + near[1]
        positions[p, 2] = s * (a6 * x + a7 * y + a8 * z + a11) + near[2]
        if len(maps):
            maps[p, 0], maps[p, 1], maps[p, 2] = s * a0, s * a1, s * a2
            maps[p, 3], maps[p, 4], maps[p, 5] = s * a3, s * a4, s * a5
            maps[p, 6], maps[p, 7], maps[p, 8] = s * a6, s * a7, s * a8
