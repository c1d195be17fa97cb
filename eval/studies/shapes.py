"""Meshes of known topology, for checks that need more than bodies."""

from __future__ import annotations

import numpy as np

from sshade.mesh.mesh import Mesh


def strip(width: int, length: int, *, seed: int = 0) -> Mesh:
    """A flat strip of `width` x `length` unit cells, two triangles each, slightly jittered."""
    x, y = np.meshgrid(np.arange(length + 1.0), np.arange(width + 1.0), indexing="ij")
    V = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    V += np.random.default_rng(seed).normal(0, 0.02, V.shape)
    return Mesh(V, _grid_faces(length, width, width + 1))


def tube(around: int, along: int) -> Mesh:
    """An open cylinder of radius 1 and length 6: two boundary loops."""
    angle = 2 * np.pi * np.arange(around) / around
    z = np.linspace(-3, 3, along + 1)
    V = np.stack([np.tile(np.cos(angle), along + 1), np.tile(np.sin(angle), along + 1), z.repeat(around)], 1)
    return Mesh(V, _wrapped_faces(along, around, (along + 1) * around))


def torus(major: int, minor: int) -> Mesh:
    """A torus of radii 1 and 0.35: Euler characteristic 0."""
    u, v = np.meshgrid(
        2 * np.pi * np.arange(major) / major, 2 * np.pi * np.arange(minor) / minor, indexing="ij"
    )
    r = 1 + 0.35 * np.cos(v)
    V = np.stack([r * np.cos(u), r * np.sin(u), 0.35 * np.sin(v)], axis=2).reshape(-1, 3)
    return Mesh(V, _wrapped_faces(major, minor, major * minor)[:, ::-1])


def double_torus(refinements: int = 2) -> Mesh:
    """A smooth slab with two holes: Euler characteristic -2.

    The surface of a block of voxels, Loop-subdivided `refinements` times.
    """
    import igl

    solid = np.zeros((13, 8, 5), dtype=bool)
    solid[1:12, 1:7, 1:4] = True
    solid[3:5, 3:5, :] = solid[8:10, 3:5, :] = False
    V, F = _voxel_surface(solid)
    for _ in range(refinements):
        V, F = igl.loop(V, F)
    return Mesh(V, F)


def _grid_faces(rows: int, columns: int, stride: int) -> np.ndarray:
    i = (np.arange(rows)[:, None] * stride + np.arange(columns)).ravel()
    lower = np.stack([i, i + stride, i + stride + 1], axis=1)
    return np.concatenate([lower, np.stack([i, i + stride + 1, i + 1], axis=1)])


def _wrapped_faces(rows: int, columns: int, n: int) -> np.ndarray:
    """Faces of a grid that closes on itself along its columns, and along its rows if n says so."""
    r, c = (a.ravel() for a in np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"))
    here, right = r * columns + c, r * columns + (c + 1) % columns
    up, diagonal = (here + columns) % n, (right + columns) % n
    return np.concatenate([np.stack([here, right, diagonal], 1), np.stack([here, diagonal, up], 1)])


def _voxel_surface(solid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The boundary squares of a block of voxels as outward triangles."""
    squares = []
    for axis in range(3):
        for side in (0, 1):
            beside = np.roll(solid, 1 - 2 * side, axis=axis)
            corner = np.argwhere(solid & ~beside)
            corner[:, axis] += side
            u, w = np.eye(3, dtype=int)[(axis + 1) % 3], np.eye(3, dtype=int)[(axis + 2) % 3]
            ring = [corner, corner + u, corner + u + w, corner + w]
            squares.append(np.stack(ring if side else ring[::-1], axis=1))
    corners, index = np.unique(np.concatenate(squares).reshape(-1, 3), axis=0, return_inverse=True)
    quads = index.reshape(-1, 4)
    return corners.astype(np.float64), np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
