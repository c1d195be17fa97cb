"""Arrays of ids: the sides of faces by edge, the faces by vertex, and positions by id or by label.

Counting sort makes every table of sides and faces in linear time and memory, however many faces meet at one
vertex. A list of lists is stored as two arrays: the entries of row i stand from ``start[i]`` to
``start[i + 1]`` in the second array.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sshade.core.kernels import kernel


class EdgeSides(NamedTuple):
    """The undirected edges of faces, and the sides of faces at each edge.

    Side ``3 f + c`` of face f goes from corner c to the next corner: sides 0, 1 and 2 of a face go from
    corner 0 to 1, from 1 to 2, and from 2 to 0.

    Attributes
    ----------
    ends : (e, 2) int32
        Vertices of each edge, the smaller id first, in lexicographic order.
    start : (e + 1,) int32
        Where the sides of each edge begin in `side`.
    side : (3m,) int32
        Sides by edge; in ascending order within an edge.
    """

    ends: np.ndarray
    start: np.ndarray
    side: np.ndarray

    @property
    def faces(self) -> np.ndarray:
        """(e,) int32 number of faces at each edge."""
        return np.diff(self.start)

    @property
    def edge(self) -> np.ndarray:
        """(m, 3) int64 edge of each side of each face."""
        edge = np.empty(len(self.side), dtype=np.int64)
        edge[self.side] = np.repeat(np.arange(len(self.ends)), self.faces)
        return edge.reshape(-1, 3)

    @property
    def twin(self) -> np.ndarray:
        """(3m,) int32 second side at the edge of each side; -1 unless the edge has two faces."""
        first = self.start[:-1][self.faces == 2]
        one, other = self.side[first], self.side[first + 1]
        twin = np.full(len(self.side), -1, dtype=np.int32)
        twin[one], twin[other] = other, one
        return twin


def sides_by_edge(F: np.ndarray, n: int) -> EdgeSides:
    """Sort the sides of faces by edge.

    Parameters
    ----------
    F : (m, 3) int
        Faces that repeat no vertex; an edge may have any number of faces.
    n : int
        Number of vertices.
    """
    ends = _ends_of_sides(F)
    side, start = _grouped(ends, n)
    first = side[start[:-1]]
    return EdgeSides(np.stack([ends[0, first], ends[1, first]], axis=1), start, side)


def group_rows(rows: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Group equal rows of ids in linear time, without a combined key that could overflow.

    Parameters
    ----------
    rows : (r, c) int
    n : int
        Larger than every id.

    Returns
    -------
    first : (g,) int32
        First row of each group; groups are in the lexicographic order of their rows.
    group : (r,) int64
        Group of each row.
    """
    order, start = _grouped(np.ascontiguousarray(rows.T), n)
    group = np.empty(len(rows), dtype=np.int64)
    group[order] = np.repeat(np.arange(len(start) - 1), np.diff(start))
    return order[start[:-1]], group


def flagged(ids: np.ndarray, n: int) -> np.ndarray:
    """Return (n,) bool: the numbers in [0, n) that are in `ids`, an array of any shape."""
    flags = np.zeros(n, dtype=bool)
    flags[ids] = True
    return flags


def numbered(ids: np.ndarray, n: int) -> np.ndarray:
    """Return (n,) int64: for each number in [0, n) its position in `ids` (k,), or -1 if it is not there."""
    position = np.full(n, -1)
    position[ids] = np.arange(len(ids))
    return position


def members(labels: np.ndarray, count: int) -> list[np.ndarray]:
    """For each label in [0, count), return the positions (p,) int64 that have it, in ascending order."""
    order = np.argsort(labels, kind="stable")
    return np.split(order, np.cumsum(np.bincount(labels, minlength=count)))[:count]


def at_means(vertex: np.ndarray, V: np.ndarray) -> np.ndarray:
    """Replace each of the positions V (k, 3) by the mean of all positions of its vertex (k,)."""
    _, inverse, count = np.unique(vertex, return_inverse=True, return_counts=True)
    return np.stack([(np.bincount(inverse, x) / count)[inverse] for x in V.T], axis=1)


@kernel
def sort_by_id(ids, n):
    """Sort entries by their ids, stably, by counting.

    Parameters
    ----------
    ids : (r,) int
        In [0, n).
    n : int

    Returns
    -------
    start : (n + 1,) int64
        Where the entries of each id begin in `order`.
    order : (r,) int32
    """
    start = np.zeros(n + 1, dtype=np.int64)
    for i in ids:
        start[i + 1] += 1
    for i in range(n):
        start[i + 1] += start[i]
    place, order = start[:-1].copy(), np.empty(len(ids), dtype=np.int32)
    for p in range(len(ids)):
        order[place[ids[p]]] = p
        place[ids[p]] += 1
    return start, order


@kernel
def _grouped(columns, n):
    """Sort rows of ids lexicographically, given their columns (c, r).

    Returns the order (r,) of the rows, and where each group of equal rows begins in it (g + 1,).
    """
    count = columns.shape[1]
    order = sort_by_id(columns[-1], n)[1]
    for c in range(len(columns) - 2, -1, -1):
        order = order[sort_by_id(columns[c][order], n)[1]]
    start, groups = np.empty(count + 1, dtype=np.int32), 0
    for p in range(count):
        differs = p == 0
        for c in range(len(columns)):
            differs = differs or columns[c, order[p]] != columns[c, order[p - 1]]
        if differs:
            start[groups] = p
            groups += 1
    start[groups] = count
    return order, start[: groups + 1].copy()


@kernel
def _ends_of_sides(F):
    """Return the smaller and the larger end of each side, (2, 3m) int32."""
    ends = np.empty((2, 3 * len(F)), dtype=np.int32)
    for f in range(len(F)):
        for c in range(3):
            i, j = F[f, c], F[f, (c + 1) % 3]
            ends[0, 3 * f + c], ends[1, 3 * f + c] = min(i, j), max(i, j)
    return ends
