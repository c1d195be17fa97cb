"""Facts from the faces of a mesh: neighbours of vertices, components, loops, orientation, and areas.

All take linear time. For the neighbours, the faces are first sorted by vertex. Threads then treat ranges of
vertices: each vertex gets its list of neighbours, and its faces are checked to form one oriented fan. The
number of threads changes no bit of the result.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sshade.core.kernels import kernel, subroutine
from sshade.core.threads import available_cpus, in_ranges, in_threads

#: Least number of faces for a thread that sorts faces by vertex, and largest number of such threads. Each
#: thread needs a counter for every vertex.
FACES, SORTERS = 100_000, 4
#: Longest row that is sorted by insertion.
SHORT = 32


class Neighbours(NamedTuple):
    """The neighbours of each vertex, in compressed sparse rows.

    Attributes
    ----------
    indptr, indices : (n + 1,) int32 and (2e,) int32
        The neighbours of vertex i are ``indices[indptr[i]:indptr[i + 1]]``, in ascending order.
    boundary : (2e,) bool
        True where the edge to the neighbour has a single face.
    """

    indptr: np.ndarray
    indices: np.ndarray
    boundary: np.ndarray


class Connectivity(NamedTuple):
    """Facts about the faces of a mesh.

    Attributes
    ----------
    edges, boundary_edges : int
        Numbers of undirected edges, and of edges with a single face.
    component : (n,) int32
        Connected component of each vertex. Components are numbered by their first vertices.
    components, boundary_loops : int
        Numbers of connected components, and of connected sets of boundary edges.
    crowded_edge : (3,) int64
        Ends and number of faces of the first edge that has the most faces, where it has more than two;
        otherwise -1.
    oriented : bool
        No two faces run through an edge in the same direction.
    split_vertex : int
        First vertex whose faces form more than one fan; -1 if there is none.
    neighbours : Neighbours
    """

    edges: int
    boundary_edges: int
    component: np.ndarray
    components: int
    boundary_loops: int
    crowded_edge: np.ndarray
    oriented: bool
    split_vertex: int
    neighbours: Neighbours


def connectivity(F: np.ndarray, n: int) -> Connectivity:
    """Find neighbours, components and boundary loops, and check that faces form an oriented manifold.

    Parameters
    ----------
    F : (m, 3) int
        Faces that repeat no vertex and use every vertex; otherwise any.
    n : int
        Number of vertices.
    """
    # NumPy asks for huge pages for large arrays. Arrays made by numba take six times as long to touch.
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
    checks = in_ranges(_rows, n, start, around, indptr)
    np.cumsum(indptr, out=indptr)
    indices, boundary = np.empty(indptr[-1], dtype=np.int32), np.empty(indptr[-1], dtype=np.bool_)
    in_ranges(_pack, n, start, around, indptr, indices, boundary)
    near = Neighbours(indptr, indices, boundary)

    component, components = _components(*near, False)
    loops = 0
    if boundary.any():
        inside = n - int(np.count_nonzero(np.bincount(indices[boundary], minlength=n)))
        loops = _components(*near, True)[1] - inside
    crowded, oriented, split = zip(*checks, strict=True)
    return Connectivity(
        len(indices) // 2,
        int(np.count_nonzero(boundary)) // 2,
        component,
        components,
        loops,
        max(crowded, key=lambda edge: edge[2]),  # the first of several
        all(oriented),
        next((vertex for vertex in split if vertex >= 0), -1),
        near,
    )


@kernel
def _count(F, first, end, count):
    for f in range(first, end):
        for c in range(3):
            count[F[f, c]] += 1


@kernel
def _places(place, start):
    """Turn the number of faces that each part has at each vertex into the place of its first face there."""
    p = 0
    for i in range(place.shape[1]):
        start[i] = p
        for part in range(place.shape[0]):
            count = place[part, i]
            place[part, i] = p
            p += count
    start[-1] = p


@kernel
def _sort(F, first, end, place, around):
    """Write the next and the previous corner of each face at a vertex, face by face."""
    for f in range(first, end):
        for c in range(3):
            p = 2 * place[F[f, c]]
            around[p], around[p + 1] = F[f, (c + 1) % 3], F[f, (c + 2) % 3]
            place[F[f, c]] += 1


@kernel
def _rows(first, end, start, around, size):
    """Replace the corners around vertices by their neighbours: j inside, ~j on the boundary.

    The number of neighbours of vertex i goes to ``size[i + 1]``; entries beyond it keep their values.
    Returns `crowded_edge`, `oriented` and `split_vertex` of :class:`Connectivity` for these vertices.
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
        for f in range(faces):  # high bits: a corner; low bits: the number of its face
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
        for f in range(faces):  # the two neighbours in a face are in one fan
            a, b = _root(link, one[f]), _root(link, other[f])
            if a != b:
                link[max(a, b)] = min(a, b)
                fans -= 1
        if fans > 1 and split == -1:
            split = i
    return crowded, oriented, split


@subroutine
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


@kernel
def _pack(first, end, start, around, indptr, indices, boundary):
    for i in range(first, end):
        row = 2 * np.int64(start[i])
        for p in range(indptr[i], indptr[i + 1]):
            j = around[row]
            row += 1
            indices[p], boundary[p] = max(j, ~j), j < 0


@subroutine
def _root(parent, i):
    """Return the smallest member of i's set, and halve the paths on the way."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@kernel
def _components(indptr, indices, boundary, along_boundary):
    """Return the component (n,) of each vertex, numbered by first vertex, and the number of components.

    With `along_boundary`, only boundary edges connect vertices.
    """
    n = indptr.shape[0] - 1
    parent = np.arange(n).astype(np.int32)
    for i in range(n):
        root = i
        for p in range(indptr[i], indptr[i + 1]):
            j = indices[p]
            if j > i:
                break
            if parent[j] == root or (along_boundary and not boundary[p]):
                continue  # true of most neighbours, whose roots need no search
            of_neighbour = _root(parent, j)
            parent[max(root, of_neighbour)] = min(root, of_neighbour)
            root = min(root, of_neighbour)
    number, components = np.empty(n, dtype=np.int32), 0
    for i in range(n):
        if parent[i] == i:
            number[i] = components
            components += 1
        else:
            number[i] = number[parent[i]]  # a smaller vertex, which has its number already
    return number, components


#: Largest doubled area, over the squared longest edge, of a face that counts as one without area. Its
#: cotangents would exceed 10^8, and rounding instead of the shape would determine them.
NO_AREA = 1e-8


def face_areas(V: np.ndarray, F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Measure triangles F (m, 3) with corners at V (n, 3).

    Returns
    -------
    areas : (m,) float64
        In the squared unit of V.
    without_area : (m,) bool
        Triangles that are needles or collapsed; see :data:`NO_AREA`.
    """
    areas, without = np.empty(len(F)), np.empty(len(F), dtype=np.bool_)
    in_ranges(_areas, len(F), V, F, areas, without)
    return areas, without


@kernel
def vertex_areas(F, areas, n):
    """(n,) float64: a third of the areas (m,) of the triangles F (m, 3) around each of n vertices."""
    total = np.zeros(n)
    for t in range(len(F)):
        third = areas[t] / 3.0
        for c in range(3):
            total[F[t, c]] += third
    return total


@kernel
def _areas(first, end, V, F, areas, without):
    for t in range(first, end):
        i, j, k = F[t, 0], F[t, 1], F[t, 2]
        ax, ay, az = V[j, 0] - V[i, 0], V[j, 1] - V[i, 1], V[j, 2] - V[i, 2]
        bx, by, bz = V[k, 0] - V[i, 0], V[k, 1] - V[i, 1], V[k, 2] - V[i, 2]
        cx, cy, cz = bx - ax, by - ay, bz - az
        longest = max(ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz, cx * cx + cy * cy + cz * cz)
        x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        doubled = np.sqrt(x * x + y * y + z * z)
        areas[t], without[t] = 0.5 * doubled, not doubled > NO_AREA * longest
