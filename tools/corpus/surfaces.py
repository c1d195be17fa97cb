"""Cases: surfaces of every kind, whatever their topology, size, place and sampling."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests import shapes
from tools.corpus.plain import Random, Shapes, surface_cases
from tools.corpus.shapes import (
    Shape,
    beside,
    body,
    bored,
    circle,
    cubes,
    fan,
    klein,
    lattice,
    noisy,
    of,
    plate,
    prism,
    projective_plane,
    random_sheet,
    scaled,
    sheet,
    soup,
    twisted,
    welded,
    without,
)


def _holes(random: Random) -> Shape:
    V, F = sheet(40, 16)
    center = V[F].mean(axis=1)
    return without((V, F), ((center[:, 0] * 2) % 1 < 0.4) & (np.abs(center[:, 1] - 0.5) < 0.25))


def _uneven(random: Random) -> Shape:
    return lattice(60, 24, lambda u, v: _ball(u**4, v**2), wrap=(False, False))


def _ball(u: np.ndarray, v: np.ndarray) -> list[np.ndarray]:
    a, b = np.pi * (0.02 + 0.96 * u), 2 * np.pi * 0.98 * v
    return [np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), 2 * np.cos(a)]


def _spiral(random: Random) -> Shape:
    return lattice(120, 8, lambda u, v: [(1 + u) * np.cos(12 * u), (1 + u) * np.sin(12 * u), 0.5 * v + u])


def _gear(random: Random) -> Shape:
    solid = np.zeros((13, 13, 2), dtype=int)
    solid[2:11, 2:11] = 1
    solid[0:13:4, 4:9], solid[4:9, 0:13:4] = 1, 1
    solid[1, 5:8], solid[11, 5:8], solid[5:8, 1], solid[5:8, 11] = 1, 1, 1, 1
    return of(shapes.block(solid))


CLOSED: Shapes = {
    "sphere": lambda r: of(shapes.icosphere(3)),
    "globe of squares": lambda r: welded(
        lattice(24, 24, lambda u, v: _ball_closed(u, v), wrap=(False, True))
    ),
    "body": lambda r: body(),
    "body of many vertices": lambda r: body(5),
    "torus": lambda r: of(shapes.torus(32, 16)),
    "thin torus": lambda r: of(shapes.torus(80, 6, tube=0.03)),
    "double torus": lambda r: of(shapes.double_torus(cells=3)),
    "genus 5": lambda r: plate(5),
    "genus 12": lambda r: plate(12),
    "cube of hard edges": lambda r: cubes((0, 0, 0), cells=8),
    "thin plate": lambda r: scaled(cubes((0, 0, 0), cells=12), (1, 1, 1e-3)),
    "paper-thin plate": lambda r: scaled(cubes((0, 0, 0), cells=12), (1, 1, 1e-6)),
    "prism of slivers": lambda r: prism(circle(64), 3.0),
    "coarse prism": lambda r: prism(circle(7), 2.0),
    "block with a bore": lambda r: bored(),
    "gear": _gear,
    "needle": lambda r: scaled(of(shapes.icosphere(3)), (100, 1, 1)),
    "long needle": lambda r: scaled(of(shapes.icosphere(3)), (3000, 1, 1)),
    "pancake": lambda r: scaled(of(shapes.icosphere(3)), (1, 1, 1e-4)),
    "hairpin": lambda r: of(shapes.folded(60, 8)),
    "coincident double sheet": lambda r: _double(r),
}


def _ball_closed(u: np.ndarray, v: np.ndarray) -> list[np.ndarray]:
    a, b = np.pi * u, 2 * np.pi * v
    return [np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), 1.5 * np.cos(a)]


def _double(random: Random) -> Shape:
    """A closed surface that is flattened onto a plane."""
    return scaled(body(), (0, 1, 1))


OPEN: Shapes = {
    "flat grid": lambda r: of(shapes.strip(30, 10)),
    "wavy sheet": lambda r: sheet(),
    "sheet with holes": _holes,
    "tube": lambda r: of(shapes.tube(24, 40)),
    "half sphere": lambda r: without(body(), body()[0][body()[1]].mean(axis=1)[:, 0] > 0),
    "sphere without a face": lambda r: without(body(), np.arange(len(body()[1])) == 77),
    "random sheet": lambda r: random_sheet(700, r),
    "uneven sampling": _uneven,
    "spiral band": _spiral,
    "cone with a tip": lambda r: welded(lattice(20, 24, lambda u, v: _cone(u, v), wrap=(False, True))),
    "sieve": lambda r: without(body(), r.random(len(body()[1])) < 0.1),
    "ribbon of squares": lambda r: of(shapes.strip(200, 1)),
    "fan of slivers": lambda r: scaled(
        (np.append(np.c_[circle(90), np.zeros(90)], [[0, 0, 0.1]], 0), fan(90)), (1, 5, 1)
    ),
}


def _cone(u: np.ndarray, v: np.ndarray) -> list[np.ndarray]:
    return [u * np.cos(2 * np.pi * v), u * np.sin(2 * np.pi * v), 3 * u]


def _fin(random: Random) -> Shape:
    """Three sheets that meet at an edge."""
    parts = [_turned(lattice(14, 8, lambda u, v: [2 * u, v, 0 * u]), 2 * np.pi * k / 3) for k in range(3)]
    return welded(beside(*parts))


def _turned(shape: Shape, angle: float) -> Shape:
    c, s = np.cos(angle), np.sin(angle)
    return shape[0] @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]]).T, shape[1]


def _wall(random: Random) -> Shape:
    """Two solids with a common inner wall, whose faces are there once."""
    V, F = welded(cubes((0, 0, 0), (0, 0, 1)))
    _, first = np.unique(np.sort(F, axis=1), axis=0, return_index=True)
    return V, F[np.sort(first)]


def _bowtie(random: Random) -> Shape:
    V, F = beside(body(2), scaled(body(2), (0.7, 0.7, 0.7)))
    half = len(body(2)[0])
    top, bottom = V[:half, 2].argmax(), half + V[half:, 2].argmin()
    V[half:] += V[top] - V[bottom]
    F[bottom == F] = top
    used = np.unique(F)
    return V[used], np.searchsorted(used, F)


NOT_MANIFOLD: Shapes = {
    "Moebius strip": lambda r: twisted(60, 8, 1),
    "fine Moebius strip": lambda r: twisted(240, 24, 1),
    "wide Moebius strip": lambda r: twisted(50, 14, 1, width=0.9),
    "Moebius strip of three half turns": lambda r: twisted(90, 8, 3),
    "narrow Moebius strip": lambda r: twisted(40, 2, 1),
    "band of two half turns": lambda r: twisted(60, 8, 2),
    "Moebius strip as a soup": lambda r: soup(twisted(40, 6, 1)),
    "Klein bottle": lambda r: klein(),
    "projective plane": lambda r: projective_plane(),
    "Moebius strip beside a body": lambda r: beside(twisted(60, 8, 1), moved(body(), 6)),
    "three sheets": _fin,
    "solids that share an edge": lambda r: welded(cubes((0, 0, 0), (1, 0, 1))),
    "solids that share a face": lambda r: welded(cubes((0, 0, 0), (0, 0, 1))),
    "solids that share an inner wall": _wall,
    "solids that share a vertex": lambda r: welded(cubes((0, 0, 0), (1, 1, 1))),
    "solids around an edge": lambda r: welded(cubes((0, 0, 0), (1, 1, 0), (0, 0, 1))),
    "bowtie of bodies": _bowtie,
    "bowtie of triangles": lambda r: (
        np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0.0], [-1, 0, 0], [-1, -1, 0]]),
        np.array([[0, 1, 2], [0, 3, 4]]),
    ),
    "every third face turned": lambda r: (
        body()[0],
        np.where(np.arange(1280)[:, None] % 3, *_both_ways(body()[1])),
    ),
    "random faces turned": lambda r: (body()[0], np.where(r.random((1280, 1)) < 0.5, *_both_ways(body()[1]))),
    "inside out": lambda r: (body()[0], body()[1][:, ::-1]),
    "half inside out": lambda r: (
        body()[0],
        np.where(np.arange(1280)[:, None] < 640, *_both_ways(body()[1])),
    ),
    "duplicate faces": lambda r: (body()[0], np.concatenate([body()[1], body()[1][::7]])),
    "duplicate faces turned around": lambda r: (body()[0], np.concatenate([body()[1], body()[1][::7, ::-1]])),
    "random triangles": lambda r: (r.random((40, 3)), _random_faces(r, 40, 90)),
    "T-junctions": lambda r: _junctions(),
}


def _both_ways(F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return F, F[:, ::-1]


def _random_faces(random: Random, n: int, m: int) -> np.ndarray:
    return np.array([random.choice(n, 3, replace=False) for _ in range(m)])


def _junctions() -> Shape:
    """Two grids of different resolution along a common border, without common vertices there."""
    fine = moved(lattice(31, 16, lambda u, v: [2 * u, v, 0 * u]), 2)
    return beside(lattice(16, 9, lambda u, v: [2 * u, v, 0 * u]), fine)


def moved(shape: Shape, *shift: float) -> Shape:
    return shape[0] + np.pad(np.array(shift, dtype=float), (0, 3 - len(shift))), shape[1]


def _ground(random: Random) -> Shape:
    """A figure above a ground plane of four vertices."""
    V, F = body()
    plane = np.array([[-20, -20, 0], [20, -20, 0], [20, 20, 0], [-20, 20, 0.0]]) + [0, 0, V[:, 2].min() - 0.1]
    return beside((V, F), (plane, np.array([[0, 1, 2], [0, 2, 3]])))


def _touching(random: Random) -> Shape:
    """Two closed surfaces with vertices of their own that meet in a point."""
    V, F = body(2)
    return beside((V, F), (V + V[V[:, 2].argmax()] - V[V[:, 2].argmin()], F))


def _close(random: Random) -> Shape:
    V, F = sheet()
    return beside((V, F), (V + [0, 0, 1e-6], F))


COMPONENTS: Shapes = {
    "two bodies": lambda r: beside(body(2), moved(body(2), 4)),
    "large and small": lambda r: beside(body(), moved(scaled(body(1), (0.05,) * 3), 2)),
    "forty spheres": lambda r: beside(*(moved(of(shapes.icosphere(1)), 3.0 * k, k % 5) for k in range(40))),
    "touching in a point": _touching,
    "cubes that touch in a face": lambda r: cubes((0, 0, 0), (0, 0, 1)),
    "cubes that touch in an edge": lambda r: cubes((0, 0, 0), (1, 0, 1)),
    "ground plane": _ground,
    "nested shells": lambda r: beside(body(), scaled(body(2), (0.8,) * 3), scaled(body(2), (-0.5,) * 3)),
    "two sheets 1e-6 apart": _close,
    "interpenetrating": lambda r: beside(body(2), moved(body(2), 0.5)),
    "linked rings": lambda r: beside(
        of(shapes.torus(30, 10, tube=0.2)), moved(_upright(of(shapes.torus(30, 10, tube=0.2))), 1)
    ),
    "closed, open and one-sided": lambda r: beside(body(2), moved(sheet(), 3), moved(twisted(40, 5, 1), 10)),
    "triangles without connection": lambda r: soup(moved((r.random((24, 3)), np.arange(24).reshape(-1, 3)))),
}


def _upright(shape: Shape) -> Shape:
    return shape[0][:, [2, 0, 1]], shape[1]


def _with_faces(shape: Shape, faces: Any) -> Shape:
    return shape[0], np.concatenate([shape[1], np.array(faces)])


def _flat_face(random: Random) -> Shape:
    """Faces whose corners lie on a line: vertices at the midpoints of edges, moved onto the edges."""
    V, F = body()
    a, b, c = F[100]
    W = np.concatenate([V, [(V[a] + V[b]) / 2]])
    n = len(V)
    return W, np.concatenate([np.delete(F, 100, 0), [[a, n, c], [n, b, c], [a, b, n]]])


def _collapsed(random: Random) -> Shape:
    """Edges of length zero: neighbours at the same position."""
    V, F = body()
    edges = F[random.choice(len(F), 15, replace=False)]
    V[edges[:, 0]] = V[edges[:, 1]]
    return V, F


DEGENERATE: Shapes = {
    "faces on a line": _flat_face,
    "edges of length zero": _collapsed,
    "faces that repeat a vertex": lambda r: _with_faces(body(), [[4, 4, 7], [9, 9, 9], [1, 2, 1]]),
    "unused vertices": lambda r: (
        np.concatenate([[[9, 9, 9.0]], body()[0], [[-8, 0, 0], [0, 0, 0]]]),
        body()[1] + 1,
    ),
    "unused vertices far away": lambda r: (np.concatenate([body()[0], [[1e9, 0, 0]]]), body()[1]),
    "slivers": lambda r: scaled(random_sheet(500, r), (1, 1e-4, 1)),
    "caps of nearly 180 degrees": lambda r: _caps(),
    "noise as long as edges": lambda r: noisy(of(shapes.icosphere(3)), 0.03, r),
    "all vertices on a line": lambda r: scaled(body(), (0, 0, 1)),
    "flattened to 1e-12": lambda r: scaled(body(), (1e-12, 1, 1)),
    "slivers of 1e-9": lambda r: scaled(of(shapes.strip(1, 300)), (1e-9, 1, 1)),
    "self-intersecting": lambda r: _pinched(),
}


def _caps() -> Shape:
    V, F = sheet()
    W = np.concatenate([V, (0.4999 * (V[F[:, 0]] + V[F[:, 1]]) + 0.0002 * V[F[:, 2]])])
    n = len(V) + np.arange(len(F))
    a, b, c = F.T
    return W, np.concatenate([np.stack(t, axis=1) for t in ((a, b, n), (b, c, n), (c, a, n))])


def _pinched() -> Shape:
    V, F = body()
    return np.column_stack([V[:, 0] * V[:, 2], V[:, 1], V[:, 2]]), F


def _scan(random: Random) -> Shape:
    """A noisy surface with holes, islands and vertices without a face."""
    V, F = noisy(body(5), 5e-4, random)
    center = V[F].mean(axis=1)
    V, F = without((V, F), (np.abs(np.sin(5 * center[:, 2]) * np.sin(7 * center[:, 0])) > 0.97))
    return np.concatenate([V, random.normal(size=(20, 3))]), F


#: Parts as CAD programs export them: triangles without common vertices, in single precision.
CAD: Shapes = {
    "block with a bore": lambda r: bored(),
    "turned block with a bore": lambda r: _rotated(bored(96), r),
    "gear": _gear,
    "turned gear": lambda r: _rotated(_gear(r), r),
    "prism": lambda r: _rotated(prism(circle(128), 5.0), r),
    "plate with holes": lambda r: _rotated(plate(5), r),
    "assembly": lambda r: beside(
        bored(), moved(prism(circle(40, 0.45), 4.0), 0, 0, -0.5), moved(_gear(r), 9)
    ),
    "thin bracket": lambda r: scaled(plate(3), (20, 20, 0.5)),
}


def _rotated(shape: Shape, random: Random) -> Shape:
    Q, R = np.linalg.qr(random.normal(size=(3, 3)))
    Q = Q * np.sign(np.diag(R))
    return 30 * shape[0] @ (Q * np.linalg.det(Q)) + [100, 50, 20], shape[1]


CASES = [
    *surface_cases("cad", CAD, ".stl"),
    *surface_cases("open", {"scan in single precision": _scan}, "f4.ply"),
    *surface_cases("closed", CLOSED),
    *surface_cases("open", OPEN),
    *surface_cases("not_manifold", NOT_MANIFOLD),
    *surface_cases("components", COMPONENTS),
    *surface_cases("degenerate", DEGENERATE),
]
