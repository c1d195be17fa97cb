"""The neighbours of every vertex of a mesh, and whether the faces around each form one oriented fan.

Each vertex is looked at by itself, in threads, once the sides of faces are sorted by vertex. Time and
memory are linear in the number of faces, but for the sorting of single rows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from sshade.errors import InputError
from sshade.threads import available_cpus, in_ranges, in_threads

#: Faces that are worth a thread to sort them by vertex, and threads at most: each counts every vertex.
FACES, SORTERS = 100_000, 4
#: Entries of a table at most: where they begin has 32 bits.
MOST = 2**31 - 1
#: Rows of up to so many are sorted by insertion.
SHORT = 32


class Neighbours(NamedTuple):
    """The neighbours of each vertex.

    Attributes
    ----------
    indptr, indices : (n + 1,) int32 and (2e,) int32
        Those of vertex i are ``indices[indptr[i]:indptr[i + 1]]``, in ascending order.
    boundary : (2e,) bool
        True where the edge to that neighbour has a single face.
    """

    indptr: np.ndarray
    indices: np.ndarray
    boundary: np.ndarray


class Fans(NamedTuple):
    """What no oriented manifold has.

    Attributes
    ----------
    crowded_edge : (3,) int64
        Ends of the first edge with the most faces, and their number, if that is above two; else -1.
    oriented : bool
        No two faces run through an edge in the same direction.
    split_vertex : int
        The first vertex whose faces form more than one fan; -1 if none.
    """

    crowded_edge: np.ndarray
    oriented: bool
    split_vertex: int


def neighbours(F: np.ndarray, n: int) -> tuple[Neighbours, Fans]:
    """Find the neighbours of vertices; bits do not depend on the number of threads.

    Parameters
    ----------
    F : (m, 3) int
        No repeated index within a face; otherwise any.
    n : int
        Number of vertices.

    Raises
    ------
    InputError
        On more than :data:`MOST` entries, two for an edge.
    """
    # Large arrays are NumPy's, which asks for huge pages: numba's own take six times as long to touch.
    m, workers = len(F), available_cpus()
    sorters = max(1, min(workers, SORTERS, m // FACES))
    faces = [m * part // sorters for part in range(sorters + 1)]
    place, start = np.zeros((sorters, n), dtype=np.int32), np.empty(n + 1, dtype=np.int32)
    in_threads(lambda part: _count(F, faces[part], faces[part + 1], place[part]), sorters, workers=workers)
    _places(place, start)
    around = np.empty(6 * m, dtype=np.int32)
    in_threads(
        lambda part: _sort(F, faces[part], faces[part + 1], place[part], around), sorters, workers=workers
    )
    indptr = np.zeros(n + 1, dtype=np.int32)
    facts = in_ranges(lambda first, end: _rows(first, end, start, around, indptr), n)
    if (entries := int(indptr.sum(dtype=np.int64))) > MOST:
        raise InputError(
            f"the mesh has {entries // 2:,} edges, and at most {MOST // 2:,} are supported; split it"
        )
    np.cumsum(indptr, out=indptr)
    indices, boundary = np.empty(indptr[-1], dtype=np.int32), np.empty(indptr[-1], dtype=np.bool_)
    in_ranges(lambda first, end: _pack(first, end, start, around, indptr, indices, boundary), n)
    crowded = max((crowded for crowded, _, _ in facts), key=lambda edge: edge[2])  # the first of several
    split = [vertex for _, _, vertex in facts if vertex >= 0]
    oriented = all(oriented for _, oriented, _ in facts)
    fans = Fans(crowded, oriented, split[0] if split else -1)
    return Neighbours(indptr, indices, boundary), fans


@njit(cache=True, nogil=True)
def _count(F, first, end, count):
    for f in range(first, end):
        for c in range(3):
            count[F[f, c]] += 1


@njit(cache=True, nogil=True)
def _places(place, start):
    """Turn the number of faces that each part has at each vertex into the place of the first one."""
    p = 0
    for i in range(place.shape[1]):
        start[i] = p
        for part in range(place.shape[0]):
            count = place[part, i]
            place[part, i] = p
            p += count
    start[-1] = p


@njit(cache=True, nogil=True)
def _sort(F, first, end, place, around):
    """Write the next and the previous corner of each face at a vertex, face by face."""
    for f in range(first, end):
        for c in range(3):
            p = 2 * place[F[f, c]]
            around[p], around[p + 1] = F[f, (c + 1) % 3], F[f, (c + 2) % 3]
            place[F[f, c]] += 1


@njit(cache=True, nogil=True)
def _rows(first, end, start, around, size):
    """Replace what is around vertices by their neighbours j, ~j on the boundary; the rest of a row stays.

    The number of neighbours of vertex i goes to ``size[i + 1]``. Returns the facts of :class:`Fans`.
    """
    crowded, oriented, split = np.full(3, -1, dtype=np.int64), True, -1
    widest = 0
    for i in range(first, end):
        widest = max(widest, start[i + 1] - start[i])
    following, preceding = np.empty(widest, dtype=np.int64), np.empty(widest, dtype=np.int64)
    one, other = np.empty(widest, dtype=np.int32), np.empty(widest, dtype=np.int32)
    link = np.empty(2 * widest, dtype=np.int32)
    for i in range(first, end):
        row, faces = 2 * np.int64(start[i]), start[i + 1] - start[i]
        for f in range(faces):  # a corner and, below it, the number of its face
            following[f] = np.int64(around[row + 2 * f]) << 32 | f
            preceding[f] = np.int64(around[row + 2 * f + 1]) << 32 | f
        _sort_row(following, faces)
        _sort_row(preceding, faces)
        p = q = count = fans = 0
        while p < faces or q < faces:
            j = min(following[p] if p < faces else preceding[q], preceding[q] if q < faces else following[p])
            j >>= 32
            before_p, before_q = p, q
            while p < faces and following[p] >> 32 == j:
                one[following[p] & 0xFFFFFFFF] = count
                p += 1
            while q < faces and preceding[q] >> 32 == j:
                other[preceding[q] & 0xFFFFFFFF] = count
                q += 1
            forward, backward = p - before_p, q - before_q
            oriented = oriented and forward < 2 and backward < 2
            if forward + backward > max(2, crowded[2]) and i < j:
                crowded[0], crowded[1], crowded[2] = i, j, forward + backward
            around[row + count] = j if forward + backward > 1 else ~j
            link[count] = count
            count += 1
        size[i + 1] = fans = count
        for f in range(faces):  # two neighbours in one face are in one fan
            a, b = _root(link, one[f]), _root(link, other[f])
            if a != b:
                link[max(a, b)] = min(a, b)
                fans -= 1
        if fans > 1 and split == -1:
            split = i
    return crowded, oriented, split


@njit(cache=True, nogil=True)
def _sort_row(row, size):
    if size > SHORT:
        row[:size].sort()
        return
    for p in range(1, size):
        key, q = row[p], p
        while q > 0 and row[q - 1] > key:
            row[q] = row[q - 1]
            q -= 1
        row[q] = key


@njit(cache=True, nogil=True)
def _root(link, i):
    while link[i] != i:
        link[i] = link[link[i]]
        i = link[i]
    return i


@njit(cache=True, nogil=True)
def _pack(first, end, start, around, indptr, indices, boundary):
    for i in range(first, end):
        row = 2 * np.int64(start[i])
        for p in range(indptr[i], indptr[i + 1]):
            j = around[row]
            row += 1
            indices[p], boundary[p] = max(j, ~j), j < 0
