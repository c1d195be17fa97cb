"""Regular triangulations of a square, a closed cylinder and a closed bar, at any resolution."""

from __future__ import annotations

import numpy as np


def square(vertices: int) -> tuple[np.ndarray, np.ndarray]:
    """Triangulate [-1, 1] x [-1, 1] at z = 0, counter-clockwise seen from +z.

    Parameters
    ----------
    vertices : int
        Approximate number of vertices; rounded to a square number.

    Returns
    -------
    (n, 3) float64, (m, 3) int64
    """
    side = round(vertices**0.5)
    x, y = np.meshgrid(*2 * [np.linspace(-1.0, 1.0, side)], indexing="ij")
    V = np.stack([x, y, np.zeros_like(x)], axis=2).reshape(-1, 3)
    return V, _quads(np.arange(side * side).reshape(side, side))


def cylinder(vertices: int, *, radius: float, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Triangulate a closed cylinder about the z axis, from z = 0 up. Its ends are concentric rings.

    Parameters
    ----------
    vertices : int
        Approximate number of vertices.
    radius, length : float

    Returns
    -------
    (n, 3) float64, (m, 3) int64
    """
    # Cells of the wall are about square: 6k vertices around. Each end has 1 + 6 + 12 + ... + 6k vertices.
    k = max(2, round((vertices / (36.0 * length / (2.0 * np.pi * radius) + 6.0)) ** 0.5))
    of_ring = np.repeat(np.arange(1, k + 1), 6 * np.arange(1, k + 1))
    start = 3 * of_ring * (of_ring - 1)
    angle = (np.arange(len(of_ring)) - start) * np.pi / (3.0 * of_ring)
    disc = (of_ring / k * np.stack([np.cos(angle), np.sin(angle)])).T
    disc = radius * np.concatenate([np.zeros((1, 2)), disc])
    return _capped(disc, _disc_faces(k), around=6 * k, length=length, vertices=vertices)


def bar(vertices: int, *, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Triangulate a closed bar about the z axis, from z = 0 up. Its sections are unit squares.

    Every edge of the bar runs along edges of the mesh.

    Parameters
    ----------
    vertices : int
        Approximate number of vertices.
    length : float

    Returns
    -------
    (n, 3) float64, (m, 3) int64
    """
    k = max(2, round((vertices / (4.0 * length + 2.0)) ** 0.5))
    go, back = np.arange(k), np.arange(k, 0, -1)
    low, high = np.zeros(k, dtype=np.int64), np.full(k, k)
    rim = np.concatenate([go, high, back, low]), np.concatenate([low, go, high, back])
    inside = np.stack(np.meshgrid(go[1:], go[1:], indexing="ij"), axis=2).reshape(-1, 2)
    cells = np.concatenate([inside, np.stack(rim, axis=1)])
    ids = np.empty((k + 1, k + 1), dtype=np.int64)
    ids[cells[:, 0], cells[:, 1]] = np.arange(len(cells))
    return _capped(cells / k - 0.5, _quads(ids), around=4 * k, length=length, vertices=vertices)


def _capped(
    end: np.ndarray, faces: np.ndarray, *, around: int, length: float, vertices: int
) -> tuple[np.ndarray, np.ndarray]:
    """Close a tube with two copies of a flat end. The number of rings follows from the number of vertices.

    Parameters
    ----------
    end : (e, 2) float64
        x and y of the end's vertices; the last `around` vertices are its rim, counter-clockwise.
    faces : (f, 3) int64
        Faces of the end, counter-clockwise.
    """
    inside = len(end) - around
    rings = max(2, round((vertices - 2 * inside) / around))
    height = np.repeat(np.linspace(0.0, length, rings), around)
    wall = np.column_stack([np.tile(end[inside:], (rings, 1)), height])
    lids = [np.column_stack([end[:inside], np.full(inside, z)]) for z in (0.0, length)]
    n = rings * around
    ids = np.arange(n).reshape(rings, around)
    bottom = np.concatenate([n + np.arange(inside), ids[0]])
    top = np.concatenate([n + inside + np.arange(inside), ids[-1]])
    sides = _quads(np.column_stack([ids, ids[:, 0]]).T)
    return np.concatenate([wall, *lids]), np.concatenate([sides, bottom[faces[:, ::-1]], top[faces]])


def _quads(ids: np.ndarray) -> np.ndarray:
    """Faces of a grid of vertices (a, b). Diagonals alternate, so that no direction is preferred."""
    corners = ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]
    row, column = np.indices(corners[0].shape)
    return split_quads(
        np.stack([corner.ravel() for corner in corners], axis=1), (row + column).ravel() % 2 == 0
    )


def split_quads(quads: np.ndarray, first_diagonal: np.ndarray) -> np.ndarray:
    """Split quads (k, 4) into triangles (2k, 3): the first of all quads, then the second.

    Parameters
    ----------
    quads : (k, 4) int64
    first_diagonal : (k,) bool
        Split along the diagonal from corner 0 to 2, not from 1 to 3.
    """
    a, b, c, d = quads.T
    chosen = first_diagonal[:, None]
    first = np.where(chosen, np.stack([a, b, c], axis=1), np.stack([a, b, d], axis=1))
    second = np.where(chosen, np.stack([a, c, d], axis=1), np.stack([b, c, d], axis=1))
    return np.concatenate([first, second])


def _disc_faces(k: int) -> np.ndarray:
    """Faces between rings of 1, 6, 12, ..., 6k vertices, numbered from the inside out."""

    def vertex(ring: int, step: np.ndarray) -> np.ndarray:
        return 1 + 3 * ring * (ring - 1) + step % (6 * ring) if ring else np.zeros_like(step)

    faces = []
    for ring in range(k):
        sector, a = np.divmod(np.arange(6 * (ring + 1)), ring + 1)
        here, there = sector * ring + a, sector * (ring + 1) + a
        inner, outer = vertex(ring, here), vertex(ring + 1, there + 1)
        faces.append(np.stack([inner, vertex(ring + 1, there), outer], axis=1))
        faces.append(np.stack([inner, outer, vertex(ring, here + 1)], axis=1)[a < ring])
    return np.concatenate(faces)
