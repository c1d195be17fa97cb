"""Convert polygons and strips to triangles."""

from __future__ import annotations

import numpy as np

from sshade.mesh.mesh import repeats_vertex


def fanned(polygons: list[np.ndarray], numbers: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Fan polygons into triangles from their first corners.

    Parameters
    ----------
    polygons : list of (p, k) int64
        Corners of the polygons with k corners, for each k.
    numbers : list of (p,) int64
        Numbers of these polygons in the file.

    Returns
    -------
    F : (m, 3) int64
        Triangles in the order of the file.
    face : (m,) int64
        Number of the polygon of each triangle.
    """
    if len(polygons) == 1 and polygons[0].shape[1] == 3:
        return polygons[0], numbers[0]
    F, face = [np.zeros((0, 3), dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for ids, polygon in zip(polygons, numbers, strict=True):
        k = ids.shape[1]
        first = np.repeat(ids[:, :1], k - 2, axis=1)
        F.append(np.stack([first, ids[:, 1:-1], ids[:, 2:]], axis=2).reshape(-1, 3))
        face.append(np.repeat(polygon, k - 2))
    order = np.argsort(np.concatenate(face), kind="stable")
    return np.concatenate(F)[order], np.concatenate(face)[order]


def strip_triangles(ids: np.ndarray) -> np.ndarray:
    """Convert strips to triangles (m, 3).

    Triangles that repeat a vertex are left out, because exporters use them to join strips.

    Parameters
    ----------
    ids : (k,) int64
        Vertices of the strips. Negative numbers separate strips.
    """
    i = np.arange(len(ids))
    begin = np.maximum.accumulate(np.where(ids < 0, i, -1)) + 1
    F = np.column_stack([ids[:-2], ids[1:-1], ids[2:]])
    odd = (i - begin)[:-2] % 2 == 1
    F[odd] = F[odd, ::-1]
    return F[(F >= 0).all(axis=1) & ~repeats_vertex(F)]
