"""Errors and times of points and splats that go with a mesh, ``sshade-eval carried``.

Smooth maps of space (:mod:`eval.timing.warps`) move the vertices of a mesh. Random splats go with it: their
distances from the surface have a standard deviation of one percent of the diagonal. The map and its
derivative are the ground truth. Two baselines get the same vertices: the rigid motion of the nearest of 200
handles, and a linear blend of the displacements of the four nearest vertices of a proxy, which keeps
covariances.

With ``--posed``, true poses of a mesh replace the maps of space. The ground truth then keeps the place of a
splat on the surface and its distance along the interpolated normal.

example:
  sshade-eval carried --points 0 --mesh data/defaust_20k/subject_00/rest_low.ply \\
    --posed data/defaust_20k/subject_00/pose_1_low.ply
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from pathlib import Path
from time import perf_counter, process_time
from typing import NamedTuple

import igl
import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from eval.publish.markdown import markdown_table
from eval.timing.warps import MAPS, QUICK_LEVEL, ellipsoid
from sshade.carry.blended import nearest_rotations
from sshade.carry.points import PointBinder, PosedPoints, bind_points
from sshade.errors import InputError
from sshade.io.meshes import read_mesh
from sshade.io.splats import moved_shapes, turned_harmonics
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import rigid_motion
from sshade.sampling.proxy import proxy_mesh, sample_proxy

#: Standard deviation of the distance of splats from the surface, as a fraction of the diagonal. Their number.
OFF, SPLATS = 0.01, 20_000
#: The same distance on bodies, whose fingers are thin: about 4 mm of 2 m.
OFF_BODY = 0.002
#: Number of handles of the first baseline with the neighbours of each, and of vertices of the proxy.
HANDLES, NEIGHBOURS, PROXY = 200, 30, 2000
#: Step of the derivative of a map.
STEP = 1e-6


class Place(NamedTuple):
    """Faces (k,), barycentric coordinates (k, 3), and heights (k,) above the surface."""

    face: np.ndarray
    barycentric: np.ndarray
    height: np.ndarray


def places(mesh: Mesh, count: int, off: float, seed: int) -> Place:
    """Return random places near a surface."""
    rng = np.random.default_rng(seed)
    face = rng.choice(mesh.m, count, p=mesh.face_areas / mesh.area)
    return Place(face, rng.dirichlet([1, 1, 1], count), rng.normal(0, off * mesh.diagonal, count))


def cloud(mesh: Mesh, count: int, off: float, seed: int) -> np.ndarray:
    """Return random points (count, 3) near a surface."""
    face, barycentric, height = places(mesh, count, off, seed)
    on = np.einsum("ij,ijk->ik", barycentric, mesh.V[mesh.F[face]])
    return on + mesh.face_normals[face] * height[:, None]


def truth(function: Callable[[np.ndarray], np.ndarray], X: np.ndarray) -> PosedPoints:
    """Return the points in the pose of a map, with rotations and derivatives of the map."""
    sides = [(function(X + e) - function(X - e)) / (2 * STEP) for e in STEP * np.eye(3)]
    J = np.stack(sides, axis=2)
    return PosedPoints(function(X), nearest_rotations(J), J)


def truth_along_normals(mesh: Mesh, posed: np.ndarray, place: Place) -> PosedPoints:
    """Return points at their places in a pose, with the derivative of the map from their places at rest."""
    rest, other = (_along_normals(V, mesh.F, place) for V in (mesh.V, posed))
    J = other[1] @ np.linalg.inv(rest[1])
    return PosedPoints(other[0], nearest_rotations(J), J)


def _along_normals(V: np.ndarray, F: np.ndarray, place: Place) -> tuple[np.ndarray, np.ndarray]:
    """Return points (k, 3), and their derivatives (k, 3, 3) by two barycentric coordinates and the height."""
    corners, normals = V[F[place.face]], igl.per_vertex_normals(V, np.array(F))[F[place.face]]
    on, N = (np.einsum("ni,nij->nj", place.barycentric, own) for own in (corners, normals))
    length, height = np.linalg.norm(N, axis=1)[:, None], place.height[:, None]
    n = N / length
    columns = []
    for k in (1, 2):
        turn = (normals[:, k] - normals[:, 0]) / length
        turn -= (turn * n).sum(axis=1, keepdims=True) * n
        columns.append(corners[:, k] - corners[:, 0] + height * turn)
    X = on + height * n
    return X, np.stack([*columns, n], axis=2)


def nearest_handle(mesh: Mesh, posed: np.ndarray, X: np.ndarray) -> PosedPoints:
    """Move each point with the rigid motion of the vertices around the nearest of some handles."""
    handles = np.random.default_rng(1).choice(mesh.n, HANDLES, replace=False)
    _, around = cKDTree(mesh.V).query(mesh.V[handles], NEIGHBOURS)
    motions = [rigid_motion(mesh.V[ids], posed[ids]) for ids in around]
    _, own = cKDTree(mesh.V[handles]).query(X)
    R, t = (np.stack(parts)[own] for parts in zip(*motions, strict=True))
    return PosedPoints(np.einsum("nij,nj->ni", R, X) + t, R, R)


def linear_blend(mesh: Mesh, posed: np.ndarray, X: np.ndarray) -> PosedPoints:
    """Move each point by the displacements of the four nearest vertices of a proxy, in inverse distance."""
    sampling = sample_proxy(mesh, PROXY, seed=0)
    proxy, moved = proxy_mesh(mesh, sampling), posed[sampling.samples]
    distance, near = cKDTree(proxy.V).query(X, 4)
    weight = 1 / np.maximum(distance, 1e-12)
    weight /= weight.sum(axis=1, keepdims=True)
    shift = np.einsum("nk,nkj->nj", weight, moved[near] - proxy.V[near])
    still = np.tile(np.eye(3), (len(X), 1, 1))
    return PosedPoints(X + shift, still, still)


def errors(found: PosedPoints, true: PosedPoints, shapes: np.ndarray, diagonal: float) -> list[str]:
    """Return mean errors: position (% of the diagonal), rotation (degrees), covariance (%), as texts."""
    off = np.linalg.norm(found.positions - true.positions, axis=1)
    cosine = 0.5 * (np.einsum("nij,nij->n", found.rotations, true.rotations) - 1)
    angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    one, other = (covariances(moved_shapes(shapes, p.maps)) for p in (found, true))
    relative = np.linalg.norm(one - other, axis=(1, 2)) / np.linalg.norm(other, axis=(1, 2))
    return [f"{100 * off.mean() / diagonal:.4f}", f"{angle.mean():.3f}", f"{100 * relative.mean():.2f}"]


def covariances(shapes: np.ndarray) -> np.ndarray:
    """Return the covariances (n, 3, 3) of splats of shapes (n, 7)."""
    R = Rotation.from_quat(shapes[:, [1, 2, 3, 0]]).as_matrix()
    return np.einsum("nij,nj,nkj->nik", R, np.exp(2 * shapes[:, 4:]), R)


def compare(mesh: Mesh, maps: list[str]) -> str:
    """Return the table of errors on maps of space, in Markdown."""
    X = cloud(mesh, SPLATS, OFF, seed=0)
    return _compared("map", mesh, X, ((name, MAPS[name](mesh.V), truth(MAPS[name], X)) for name in maps))


def compare_poses(mesh: Mesh, poses: dict[str, np.ndarray]) -> str:
    """Return the table of errors on true poses, vertices (n, 3), in Markdown."""
    place = places(mesh, SPLATS, OFF_BODY, seed=0)
    X, _ = _along_normals(mesh.V, mesh.F, place)
    of_pose = ((name, V, truth_along_normals(mesh, V, place)) for name, V in poses.items())
    return _compared("pose", mesh, X, of_pose)


def _compared(
    kind: str, mesh: Mesh, X: np.ndarray, cases: Iterable[tuple[str, np.ndarray, PosedPoints]]
) -> str:
    """Return the table of errors of splats X, for the name, posed vertices and true points of each case."""
    shapes, bound = np.random.default_rng(2).normal(size=(len(X), 7)), bind_points(mesh, X)
    body = []
    for name, posed, true in cases:
        found = {
            "sshade": bound.with_maps(posed),
            "nearest handle": nearest_handle(mesh, posed, X),
            "linear blend": linear_blend(mesh, posed, X),
        }
        size = mesh.diagonal
        body += [[name, label, *errors(points, true, shapes, size)] for label, points in found.items()]
    labels = [kind, "method", "position (%)", "rotation (deg)", "covariance (%)"]
    return markdown_table(labels, body, left=(kind, "method"))


def times(mesh: Mesh, points: int) -> str:
    """Return the table of times in Markdown."""
    posed, body = MAPS["bend"](mesh.V), []
    for label, off in (("on the surface", 0.0), ("1 % of the diagonal off", OFF)):
        X = cloud(mesh, points, off, seed=3)
        bound = PointBinder(mesh).bind(X[:1000])
        bound.with_maps(posed)  # compiles
        begin, cpu = perf_counter(), process_time()
        bound = PointBinder(mesh).bind(X)
        row = [perf_counter() - begin, process_time() - cpu]
        out = np.empty_like(X)
        bound(posed, out=out)
        cpu = process_time()
        bound(posed, out=out)
        row.append(process_time() - cpu)
        cpu = process_time()
        found = bound.with_maps(posed)
        row.append(process_time() - cpu)
        begin = perf_counter()
        moved_shapes(np.ones((points, 7)), found.maps)
        turned_harmonics(np.ones((points, 45)), found.rotations)
        row.append(perf_counter() - begin)
        body.append([label, *(f"{value:.3f}" for value in row)])
    labels = ["points", "bind (s)", "bind (CPU s)", "positions (CPU s)", "with maps (CPU s)", "splats (s)"]
    return markdown_table(labels, body, left=("points",))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    text = "rest shape of one component and of 2,000 vertices or more (default: a bumpy ellipsoid)"
    parser.add_argument("--mesh", type=Path, help=text)
    text = f"{', '.join(MAPS)} (default: bend twist shear)"
    maps = {"choices": MAPS, "default": ["bend", "twist", "shear"], "metavar": "MAP"}
    parser.add_argument("--maps", nargs="+", **maps, help=text)
    text = "true poses of the mesh, instead of maps"
    parser.add_argument("--posed", type=Path, nargs="+", metavar="FILE", help=text)
    text = "points whose times are measured (default: 1000000); 0 for none"
    parser.add_argument("--points", type=int, default=1_000_000, metavar="N", help=text)


def command(options: argparse.Namespace) -> int:
    """Print the tables; return the exit code."""
    if options.points < 0:
        raise InputError(f"--points takes a whole number from 0, not {options.points}")
    mesh = read_mesh(options.mesh) if options.mesh else ellipsoid(QUICK_LEVEL)
    middle, diagonal = 0.5 * (mesh.V.min(axis=0) + mesh.V.max(axis=0)), mesh.diagonal
    rest = Mesh((mesh.V - middle) / diagonal, mesh.F)
    if options.posed:
        poses = {}
        for path in options.posed:
            pose = read_mesh(path)
            if not np.array_equal(pose.F, mesh.F):
                raise InputError(f"{path} has other faces than the mesh at rest; give poses of the same mesh")
            if path.stem in poses:
                raise InputError(f"two poses are named {path.stem}, and so would be their lines; rename one")
            poses[path.stem] = (pose.V - middle) / diagonal
        print(compare_poses(rest, poses))  # noqa: T201
    else:
        print(compare(rest, options.maps))  # noqa: T201
    if options.points:
        print(f"\n{times(rest, options.points)}")  # noqa: T201
    return 0
