"""Surfaces of many kinds, as arrays V (n, 3) and F (m, 3); the plain ones come from the tests."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import Delaunay

from sshade.mesh.mesh import Mesh
from tests import shapes

Shape = tuple[np.ndarray, np.ndarray]


def of(mesh: Mesh) -> Shape:
    """Return the arrays of a mesh of the tests."""
    return np.array(mesh.V), np.array(mesh.F)


def body(level: int = 3) -> Shape:
    """Return a closed surface without symmetry."""
    return of(shapes.bumpy(level))


def beside(*parts: Shape) -> Shape:
    """Return one mesh of several parts."""
    first = np.cumsum([0, *(len(V) for V, _ in parts)])
    return np.concatenate([V for V, _ in parts]), np.concatenate(
        [F + k for (_, F), k in zip(parts, first, strict=False)]
    )


def welded(shape: Shape) -> Shape:
    """Merge vertices at one position."""
    V, vertex = np.unique(np.round(shape[0], 9), axis=0, return_inverse=True)
    return V, vertex.ravel()[shape[1]]


def soup(shape: Shape) -> Shape:
    """Give each triangle vertices of its own."""
    V, F = shape
    return V[F].reshape(-1, 3), np.arange(F.size).reshape(-1, 3)


def split(shape: Shape, share: float, random: np.random.Generator) -> Shape:
    """Give some corners a copy of their vertex."""
    V, F = shape
    chosen = random.random(F.shape) < share
    G = F.copy()
    G[chosen] = len(V) + np.arange(chosen.sum())
    W = np.concatenate([V, V[F[chosen]]])
    used = np.unique(G)
    return W[used], np.searchsorted(used, G)


def noisy(shape: Shape, size: float, random: np.random.Generator) -> Shape:
    """Move vertices by up to a fraction of the diagonal."""
    V, F = shape
    direction = random.normal(size=V.shape)
    direction *= random.random((len(V), 1)) / np.linalg.norm(direction, axis=1, keepdims=True)
    return V + size * np.linalg.norm(np.ptp(V, axis=0)) * direction, F


def shuffled(shape: Shape, random: np.random.Generator) -> Shape:
    """Change the order of vertices and faces, and the first corners of faces."""
    V, F = shape
    order = random.permutation(len(V))
    place = np.argsort(order)
    F = place[F[random.permutation(len(F))]]
    turn = (np.arange(3) + random.integers(3, size=(len(F), 1))) % 3
    return V[order], np.take_along_axis(F, turn, axis=1)


def lattice(
    nu: int, nv: int, place: Callable[..., list[np.ndarray]], *, wrap: tuple[bool, bool] = (False, False)
) -> Shape:
    """Return a surface over parameters u, v in [0, 1], or [0, 1) where they wrap."""
    u, v = (np.arange(n) / (n if w else n - 1) for n, w in zip((nu, nv), wrap, strict=True))
    u, v = (a.ravel() for a in np.meshgrid(u, v, indexing="ij"))
    return np.stack(np.broadcast_arrays(*place(u, v)), axis=1), shapes.quads(
        nu, nv, wrap_u=wrap[0], wrap_v=wrap[1]
    )


def twisted(around: int, across: int, half_turns: int, *, width: float = 0.4) -> Shape:
    """Return a band with half turns; with an odd number of them it has one side."""
    u, v = (
        a.ravel()
        for a in np.meshgrid(
            2 * np.pi * np.arange(around) / around, np.linspace(-1, 1, across), indexing="ij"
        )
    )
    r, angle = 2 + width * v * np.cos(half_turns * u / 2), half_turns * u / 2
    V = np.stack([r * np.cos(u), r * np.sin(u), width * v * np.sin(angle)], axis=1)
    end = np.arange(across)
    return V, _closed(shapes.quads(around + 1, across), end[::-1] if half_turns % 2 else end)


def _closed(F: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Put vertices (k,) of the first row of a lattice in place of its last row of k vertices."""
    vertex = np.arange(F.max() + 1)
    vertex[-len(end) :] = end
    return vertex[F]


def klein(nu: int = 40, nv: int = 16) -> Shape:
    """Return a Klein bottle: a figure of eight that turns half around along a circle."""
    u, v = (2 * np.pi * a.ravel() for a in np.meshgrid(np.arange(nu) / nu, np.arange(nv) / nv, indexing="ij"))
    r = 2 + np.cos(u / 2) * np.sin(v) - np.sin(u / 2) * np.sin(2 * v)
    z = np.sin(u / 2) * np.sin(v) + np.cos(u / 2) * np.sin(2 * v)
    F = _closed(shapes.quads(nu + 1, nv, wrap_v=True), -np.arange(nv) % nv)  # after one turn, v becomes -v
    return np.stack([r * np.cos(u), r * np.sin(u), z], axis=1), F


def projective_plane(level: int = 3) -> Shape:
    """Return a projective plane: a sphere with opposite points identified, as Steiner's Roman surface."""
    V, F = of(shapes.icosphere(level))
    key = np.where(_leading(V)[:, None] < 0, -V, V)
    _, first, vertex = np.unique(np.round(key, 9), axis=0, return_index=True, return_inverse=True)
    F = np.unique(np.sort(vertex.ravel()[F], axis=1), axis=0)
    x, y, z = key[first].T
    return np.stack([y * z, x * z, x * y], axis=1) + 0.1 * np.stack([x * x, y * y, z * z], axis=1), F


def _leading(V: np.ndarray) -> np.ndarray:
    """Return the first coordinate that is not zero."""
    V = np.where(np.abs(V) < 1e-9, 0, V)
    return V[np.arange(len(V)), (V != 0).argmax(axis=1)]


def plate(holes: int, *, cells: int = 2) -> Shape:
    """Return a plate with square holes, whose genus is their number."""
    solid = np.ones((2 * holes + 1, 3, 1))
    solid[1::2, 1] = 0
    return of(shapes.block(solid, cells=cells))


def prism(outline: np.ndarray, height: float) -> Shape:
    """Return an extruded convex outline (k, 2): caps are fans of slivers, and edges are hard."""
    k = len(outline)
    V = np.concatenate([np.column_stack([outline, np.full(k, z)]) for z in (0.0, height)])
    i = np.arange(1, k - 1)
    a, b = np.arange(k), (np.arange(k) + 1) % k
    caps = [np.stack([0 * i, i + 1, i], 1), k + np.stack([0 * i, i, i + 1], 1)]
    sides = [np.stack([a, b, b + k], 1), np.stack([a, b + k, a + k], 1)]
    return V, np.concatenate(caps + sides)


def circle(k: int, radius: float = 1.0) -> np.ndarray:
    """Return the corners (k, 2) of a regular polygon."""
    angle = 2 * np.pi * np.arange(k) / k
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def bored(k: int = 48) -> Shape:
    """Return a block with a round hole, as CAD programs export it: long slivers, no inner vertices."""
    inner = circle(k, 0.5)
    outer = inner / np.abs(inner).max(axis=1, keepdims=True)  # on a square
    rings = [np.column_stack([ring, np.full(k, z)]) for z in (0.0, 3.0) for ring in (outer, inner)]
    a, b = np.arange(k), (np.arange(k) + 1) % k
    walls = []
    for p, q in ((0, 2), (3, 1), (2, 3), (1, 0)):  # outside, hole, top, bottom
        walls += [
            np.stack([p * k + a, p * k + b, q * k + b], 1),
            np.stack([p * k + a, q * k + b, q * k + a], 1),
        ]
    return np.concatenate(rings), np.concatenate(walls)


def random_sheet(n: int, random: np.random.Generator) -> Shape:
    """Return a triangulation of random points, over a wavy surface."""
    P = random.random((n, 2)) * [3, 1]
    return np.column_stack([P, 0.1 * np.sin(4 * P[:, 0])]), Delaunay(P).simplices.astype(np.int64)


def without(shape: Shape, drop: np.ndarray) -> Shape:
    """Leave out faces (m,), and the vertices that no other face uses."""
    V, F = shape[0], shape[1][~drop]
    used = np.unique(F)
    return V[used], np.searchsorted(used, F)


def cubes(*corners: tuple[int, int, int], cells: int = 3) -> Shape:
    """Return cubes at integer corners, each a closed surface with vertices of its own."""
    cube = of(shapes.block(np.ones((1, 1, 1)), cells=cells))
    return beside(*((cube[0] + corner, cube[1]) for corner in corners))


def sheet(nu: int = 30, nv: int = 12) -> Shape:
    """Return an open, wavy sheet."""
    return lattice(nu, nv, lambda u, v: [3 * u, v, 0.3 * np.sin(3 * u)])


def scaled(shape: Shape, factors: tuple[float, float, float]) -> Shape:
    """Stretch a shape along the axes."""
    return shape[0] * factors, shape[1]


def fan(k: int) -> np.ndarray:
    """Return triangles (k, 3) around vertex k."""
    i = np.arange(k)
    return np.stack([np.full(k, k), i, (i + 1) % k], axis=1)
