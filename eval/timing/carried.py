"""Errors and times of points and splats that go with a mesh, ``sshade-eval carried``.

Smooth maps of space (:mod:`eval.timing.warps`) move the vertices of a mesh. Random splats on its surface and
within two percent of the diagonal go with it. The map and its derivative are the ground truth. Two baselines
get the same vertices: the rigid motion of the nearest of 200 handles, and a linear blend of the displacements
of the four nearest vertices of a proxy, which keeps covariances.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
from scipy.spatial import cKDTree

from eval.publish.markdown import markdown_lines
from eval.timing.warps import MAPS, QUICK_LEVEL, ellipsoid
from sshade.carry.points import PointBinder, PosedPoints, bind_points
from sshade.io.meshes import read_mesh
from sshade.io.splats import moved_shapes, turned_harmonics
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import rigid_motion
from sshade.sampling.proxy import proxy_mesh, sample_proxy

#: Standard deviation of the distance of splats from the surface, as a fraction of the diagonal. Their number.
OFF, SPLATS = 0.01, 20_000
#: Number of handles of the first baseline with the neighbours of each, and of vertices of the proxy.
HANDLES, NEIGHBOURS, PROXY = 200, 30, 2000
#: Step of the derivative of a map.
STEP = 1e-6


def cloud(mesh: Mesh, count: int, off: float, seed: int) -> np.ndarray:
    """Return random points (count, 3) near a surface."""
    rng = np.random.default_rng(seed)
    face = rng.choice(mesh.m, count, p=mesh.face_areas / mesh.area)
    on = np.einsum("ij,ijk->ik", rng.dirichlet([1, 1, 1], count), mesh.V[mesh.F[face]])
    return on + mesh.face_normals[face] * rng.normal(0, off * mesh.diagonal, (count, 1))


def truth(function: Callable[[np.ndarray], np.ndarray], X: np.ndarray) -> PosedPoints:
    """Return the points in the pose of a map, with rotations and derivatives of the map."""
    sides = [(function(X + e) - function(X - e)) / (2 * STEP) for e in STEP * np.eye(3)]
    J = np.stack(sides, axis=2)
    return PosedPoints(function(X), _rotations(J), J)


def _rotations(J: np.ndarray) -> np.ndarray:
    U, _, W = np.linalg.svd(J)
    return U @ W


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
    one, other = (_covariances(moved_shapes(shapes, p.maps)) for p in (found, true))
    relative = np.linalg.norm(one - other, axis=(1, 2)) / np.linalg.norm(other, axis=(1, 2))
    return [f"{100 * off.mean() / diagonal:.4f}", f"{angle.mean():.3f}", f"{100 * relative.mean():.2f}"]


def _covariances(shapes: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    R = Rotation.from_quat(shapes[:, [1, 2, 3, 0]]).as_matrix()
    return np.einsum("nij,nj,nkj->nik", R, np.exp(2 * shapes[:, 4:]), R)


def compare(mesh: Mesh, maps: list[str]) -> str:
    """Return the table of errors in Markdown."""
    X = cloud(mesh, SPLATS, OFF, seed=0)
    shapes = np.random.default_rng(2).normal(size=(SPLATS, 7))
    body = []
    for name in maps:
        posed, true = MAPS[name](mesh.V), truth(MAPS[name], X)
        found = {
            "sshade": bind_points(mesh, X).with_maps(posed),
            "nearest handle": nearest_handle(mesh, posed, X),
            "linear blend": linear_blend(mesh, posed, X),
        }
        body += [
            [name, label, *errors(points, true, shapes, mesh.diagonal)] for label, points in found.items()
        ]
    labels = ["map", "method", "position (%)", "rotation (deg)", "covariance (%)"]
    return "\n".join(markdown_lines(labels, body, left=("map", "method")))


def times(mesh: Mesh, points: int) -> str:
    """Return the table of times in Markdown."""
    posed, body = MAPS["bend"](mesh.V), []
    for label, off in (("on the surface", 0.0), ("1 % of the diagonal off", OFF)):
        X = cloud(mesh, points, off, seed=3)
        bound = PointBinder(mesh).bind(X[:1000])
        bound.with_maps(posed)  # compiles
        begin, cpu = perf_counter(), process_time()
        bound = PointBinder(mesh).bind(X)
        seconds, used = perf_counter() - begin, process_time() - cpu
        out = np.empty_like(X)
        bound(posed, out=out)
        cpu = process_time()
        bound(posed, out=out)
        positions, cpu = process_time() - cpu, process_time()
        found = bound.with_maps(posed)
        maps, begin = process_time() - cpu, perf_counter()
        moved_shapes(np.ones((points, 7)), found.maps)
        turned_harmonics(np.ones((points, 45)), found.rotations)
        splats = perf_counter() - begin
        row = [seconds, used, positions, maps, splats]
        body.append([label, *(f"{value:.3f}" for value in row)])
    labels = ["points", "bind (s)", "bind (CPU s)", "positions (CPU s)", "with maps (CPU s)", "splats (s)"]
    return "\n".join(markdown_lines(labels, body, left=("points",)))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("--mesh", type=Path, help="rest shape (default: a bumpy ellipsoid)")
    parser.add_argument("--maps", nargs="+", choices=MAPS, default=["bend", "twist", "shear"], metavar="MAP")
    parser.add_argument("--points", type=int, default=1_000_000, metavar="N", help="of the times; 0 for none")


def command(options: argparse.Namespace) -> int:
    """Print the tables; return the exit code."""
    mesh = read_mesh(options.mesh) if options.mesh else ellipsoid(QUICK_LEVEL)
    low, high = mesh.V.min(axis=0), mesh.V.max(axis=0)
    mesh = Mesh((mesh.V - 0.5 * (low + high)) / np.linalg.norm(high - low), mesh.F)
    print(compare(mesh, options.maps))  # noqa: T201
    if options.points:
        print(f"\n{times(mesh, options.points)}")  # noqa: T201
    return 0
