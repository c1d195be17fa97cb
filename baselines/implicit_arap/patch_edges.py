"""The edges of a patch in the ARAP energy, and the corners whose cotangents are their weights.

Corners are in the order of ``triangles.T.ravel()``: corner 0 of all m triangles, then corner 1, corner 2.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

#: Weights of the edges of a patch.
Weights = Literal["cotangents", "authors"]


def weighted_edges(triangles: np.ndarray, weights: Weights) -> tuple[np.ndarray, np.ndarray]:
    """List the edges of the energy, and the corners whose cotangents add up to the weight of each edge.

    Parameters
    ----------
    triangles : (m, 3) int
    weights : {"cotangents", "authors"}
        "cotangents" lists every edge in both directions. Its weight is the sum of the cotangents at the
        opposite corners. "authors" does what the code of the authors does (dbaieri/implicit-arap, 30847f8):

        - A triangle lists its edges (0, 1), (1, 2), (0, 2) with the cotangents at its corners 0, 1, 2,
          although 2, 0, 1 lie opposite.
        - If two triangles list an edge in the same direction, the later cotangent overwrites the earlier one.
        - The weight of an edge is the sum of both directions. The energy has an edge once for each triangle
          that lists it: inner edges twice, edges of the patch's boundary once.

    Returns
    -------
    edges : (e, 2) int64
        Directed edges.
    corners : (3 m, e) float64
        Number of times that the cotangent at a corner counts in the weight of an edge.
    """
    return _opposite(triangles) if weights == "cotangents" else _as_the_authors(triangles)


def _opposite(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    # Edge (1, 2) lies opposite corner 0, and so on cyclically.
    opposite = np.concatenate([np.roll(triangles, -k, axis=1)[:, 1:] for k in range(3)])
    edges, number = np.unique(np.sort(opposite, axis=1), axis=0, return_inverse=True)
    once = np.zeros((len(opposite), len(edges)))
    once[np.arange(len(opposite)), number.ravel()] = 1
    return np.concatenate([edges, edges[:, ::-1]]), np.concatenate([once, once], axis=1)


def _as_the_authors(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [0, 2]]])
    number, points = np.arange(len(edges)), triangles.max() + 1
    last = np.full((points, points), -1)
    last[tuple(edges.T)] = number  # of equal edges, NumPy keeps the last
    corners = np.zeros((len(edges), len(edges)))
    for corner in (last[tuple(edges.T)], last[tuple(edges.T[::-1])]):
        listed = corner >= 0
        corners[corner[listed], number[listed]] += 1
    return edges, corners
