"""Searches by boxes around points: opposite vertices of a surface, distances from points, crossing faces.

Points that are near each other are enclosed in boxes, and boxes in boxes. They tell where no smaller value
can be.

The opposite vertex of vertex i is where a wall or a limb has its other side. It lies on the largest ball
inside the surface that touches it at vertex i: the ball that no vertex is inside of. The ball through
vertices i and j has the radius ``|v_j - v_i|^2 / (2 n_i . (v_j - v_i))`` for the inward normal n_i, so that
the search is for the least radius. In a round limb the ball may end at a vertex beside i, whose normal is
nearly the same. Then the ray along the inward normal goes on from the far side of the ball, in steps of the
distance to the nearest vertex, until this vertex has an opposite normal. A ray that leaves the surface finds
nothing.

J. Ma, S. W. Bae, S. Choi, "3D medial axis point approximation using nearest neighbors and the normal field",
2012 (shrinking balls).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sshade.core.kernels import kernel, subroutine
from sshade.core.threads import SMALL, ThreadTeam, available_cpus
from sshade.mesh.mesh import Mesh, unit_rows

#: Largest number of steps of a ray; its step is at least `LEAST_STEP` times the mean edge.
STEPS, LEAST_STEP = 60, 0.5
#: Largest cosine between the normals of opposite vertices.
OPPOSITE = -0.5
#: Least thickness, as a fraction of the mean edge.
LEAST = 0.05
#: Number of boxes or vertices in a box.
EACH = 8
#: Cells along the longest side of the grid that orders the vertices.
CELLS = 1 << 20
#: Number of vertices, and of boxes of faces, that a thread works on at a time.
ROWS, LEAVES = 1024, 256


def opposite_vertices(mesh: Mesh, asked: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (s,) int64, ascending, and the opposite vertex (s,) int64 of each.

    Parameters
    ----------
    mesh : Mesh
        Consistently oriented; faces counter-clockwise seen from outside, if it has a boundary.
    asked : (n,) bool, optional
        Vertices whose opposite vertices are wanted; by default all.
    """
    V, found = mesh.V, np.full(mesh.n, -1)
    boxes, lengths = Boxes.of(V), (mesh.diagonal, mesh.mean_edge)
    order = boxes.order
    own = np.arange(mesh.n) if asked is None else np.flatnonzero(asked[order])
    inward = _inward(mesh)[order]
    with ThreadTeam(available_cpus() if len(own) >= SMALL else 1) as team:
        arrays = own, boxes.start, boxes.low, boxes.high, V[order], inward
        team.ranges(_opposite, len(own), *arrays, order, *lengths, found, rows=ROWS)
    first = np.flatnonzero(found >= 0)
    second = found[first]
    apart = np.linalg.norm(V[first] - V[second], axis=1) > LEAST * mesh.mean_edge
    return first[apart], second[apart]


def distances(V: np.ndarray, points: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Return ``min_j |V_i - points_j| + offsets_j`` for each position of V (n, 3).

    Parameters
    ----------
    V : (n, 3) float64
    points : (k, 3) float64
        At least one.
    offsets : (k,) float64
        Not negative.
    """
    boxes, found = Boxes.of(points), np.empty(len(V))
    order = boxes.order
    _distances(boxes.start, boxes.low, boxes.high, points[order], offsets[order], V, found)
    return found


def crossing_faces(V: np.ndarray, F: np.ndarray) -> np.ndarray:
    """Return a mask (m,) of the faces that a side of another face pierces, or whose side pierces another.

    Faces with a common edge do not count, and faces that only touch may count or not: the decision uses
    floating point. The evaluator counts by exact predicates.

    Parameters
    ----------
    V : (n, 3) float64
    F : (m, 3) int64
    """
    corners = V[F]
    lowest, highest = corners.min(axis=1), corners.max(axis=1)
    boxes = Boxes.of(0.5 * (lowest + highest))
    order, low, high = boxes.order, boxes.low, boxes.high
    spare = np.empty_like(low)
    enclose(lowest, order, boxes.start, low, spare)
    enclose(highest, order, boxes.start, spare, high)
    found, leaves = np.zeros(len(F), dtype=bool), int(boxes.start[1])
    with ThreadTeam(available_cpus() if len(F) >= SMALL else 1) as team:
        arrays = boxes.start, low, high, lowest[order], highest[order], V, F[order], order, found
        team.ranges(_cross, leaves, *arrays, rows=LEAVES)
    return found


def _inward(mesh: Mesh) -> np.ndarray:
    """(n, 3) the inward normals; 0 where there is none."""
    inward = np.zeros((mesh.n, 3))
    a, b, c = (mesh.V[mesh.F[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)
    for k in range(3):
        for axis in range(3):
            inward[:, axis] -= np.bincount(mesh.F[:, k], area[:, axis], mesh.n)
    inside_out = mesh.is_closed and mesh.volume < 0
    return unit_rows(-inward if inside_out else inward)


class Boxes(NamedTuple):
    """Vertices in an order where neighbours are near, and the boxes of :data:`EACH` of them, level by level.

    Box k of level 0 has the vertices ``order[EACH * k]`` and following, box k of another level the boxes
    ``EACH * k`` and following of the level before.

    Attributes
    ----------
    order : (n,) int64
    start : (levels + 1,) int64
        Number of the first box of each level, and the number of all boxes. The last level has one.
    low, high : (b, 3) float64
    """

    order: np.ndarray
    start: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @classmethod
    def of(cls, V: np.ndarray) -> Boxes:
        low = V.min(axis=0)
        size = float((V.max(axis=0) - low).max()) or 1.0
        order = np.argsort(_curve(V, low, (CELLS - 1) / size), kind="stable")
        start, count = [0], len(V)
        while len(start) == 1 or count > 1:
            count = -(-count // EACH)
            start.append(start[-1] + count)
        starts = np.array(start)
        boxes = np.empty((2, start[-1], 3))
        enclose(V, order, starts, *boxes)
        return cls(order, starts, *boxes)


@kernel
def _curve(V, low, per_length):
    """(n,) int64 place of each vertex along a curve of Morton through a grid of cells."""
    key = np.zeros(len(V), dtype=np.int64)
    for i in range(len(V)):
        for axis in range(3):
            cell = int(per_length * (V[i, axis] - low[axis]))
            for bit in range(20):
                key[i] |= ((cell >> bit) & 1) << (3 * bit + axis)
    return key


@kernel
def enclose(V, order, start, low, high):
    """Write the corners of all boxes."""
    low[:] = np.inf
    high[:] = -np.inf
    for p in range(len(order)):
        for axis in range(3):
            x = V[order[p], axis]
            low[p // EACH, axis] = min(low[p // EACH, axis], x)
            high[p // EACH, axis] = max(high[p // EACH, axis], x)
    for level in range(1, len(start) - 1):
        for b in range(start[level - 1], start[level]):
            k = start[level] + (b - start[level - 1]) // EACH
            for axis in range(3):
                low[k, axis] = min(low[k, axis], low[b, axis])
                high[k, axis] = max(high[k, axis], high[b, axis])


@subroutine
def _square(low, high, b, x, y, z):
    """Squared distance of a point from a box."""
    dx = max(low[b, 0] - x, 0.0, x - high[b, 0])
    dy = max(low[b, 1] - y, 0.0, y - high[b, 1])
    dz = max(low[b, 2] - z, 0.0, z - high[b, 2])
    return dx * dx + dy * dy + dz * dz


@subroutine
def _least_radius(low, high, b, x, y, z, nx, ny, nz):
    """Lower bound of the radius of balls at a point with an inward normal through the points of a box."""
    along = nx * ((high[b, 0] if nx > 0 else low[b, 0]) - x)
    along += ny * ((high[b, 1] if ny > 0 else low[b, 1]) - y)
    along += nz * ((high[b, 2] if nz > 0 else low[b, 2]) - z)
    return _square(low, high, b, x, y, z) / (2.0 * along) if along > 0.0 else np.inf


@subroutine
def _push(stack, value, depth, top, first, box, level, bound):
    """Push a box and its level onto the stack; entries from `first` on stay sorted by descending bounds."""
    k = top
    while k > first and value[k - 1] < bound:
        stack[k], depth[k], value[k] = stack[k - 1], depth[k - 1], value[k - 1]
        k -= 1
    stack[k], depth[k], value[k] = box, level, bound
    return top + 1


@subroutine
def _children(start, level, b):
    """The first child of a box of a level above 0, and the end of its children."""
    first = start[level - 1] + EACH * (b - start[level])
    return first, min(first + EACH, start[level])


@subroutine
def _radius(V, i, j, nx, ny, nz):
    """The radius of the ball through vertices i and j, infinite behind the surface."""
    dx, dy, dz = V[j, 0] - V[i, 0], V[j, 1] - V[i, 1], V[j, 2] - V[i, 2]
    along = dx * nx + dy * ny + dz * nz
    return (dx * dx + dy * dy + dz * dz) / (2.0 * along) if along > 0.0 else np.inf


@subroutine
def _ball(start, low, high, V, i, nx, ny, nz, radius, touched, stack, value, depth):
    """The vertex with the smallest ball at vertex i, and its radius, where `touched` has a `radius`."""
    x, y, z = V[i, 0], V[i, 1], V[i, 2]
    top = _push(stack, value, depth, 0, 0, start[-1] - 1, len(start) - 2, 0.0)
    while top > 0:
        top -= 1
        b, level, r = stack[top], depth[top], radius
        if value[top] >= radius or _square(low, high, b, x + r * nx, y + r * ny, z + r * nz) >= r * r:
            continue
        if level > 0:
            first, end = _children(start, level, b)
            bottom = top
            for child in range(first, end):
                bound = _least_radius(low, high, child, x, y, z, nx, ny, nz)
                if bound < radius:
                    top = _push(stack, value, depth, top, bottom, child, level - 1, bound)
            continue
        for j in range(EACH * b, min(EACH * b + EACH, len(V))):
            r = _radius(V, i, j, nx, ny, nz)
            if r < radius:
                radius, touched = r, j
    return touched, radius


@subroutine
def _nearest(start, low, high, V, x, y, z, near, stack, value, depth):
    """The vertex nearest to a point, and its squared distance, where the vertex `near` is not far."""
    best = (V[near, 0] - x) ** 2 + (V[near, 1] - y) ** 2 + (V[near, 2] - z) ** 2
    top = _push(stack, value, depth, 0, 0, start[-1] - 1, len(start) - 2, 0.0)
    while top > 0:
        top -= 1
        b, level = stack[top], depth[top]
        if value[top] >= best:
            continue
        if level > 0:
            first, end = _children(start, level, b)
            bottom = top
            for child in range(first, end):
                bound = _square(low, high, child, x, y, z)
                if bound < best:
                    top = _push(stack, value, depth, top, bottom, child, level - 1, bound)
            continue
        for j in range(EACH * b, min(EACH * b + EACH, len(V))):
            square = (V[j, 0] - x) ** 2 + (V[j, 1] - y) ** 2 + (V[j, 2] - z) ** 2
            if square < best:
                best, near = square, j
    return near, best


@kernel
def _opposite(begin, end, own, start, low, high, V, inward, order, diagonal, edge, found):
    """Write the opposite vertex of each vertex of a range of `own`. V and `inward` have the boxes' order."""
    size = EACH * len(start)
    stack, value, depth = np.empty(size, dtype=np.int64), np.empty(size), np.empty(size, dtype=np.int64)
    last = 0
    for i in own[begin:end]:
        nx, ny, nz = inward[i, 0], inward[i, 1], inward[i, 2]
        if nx == 0.0 and ny == 0.0 and nz == 0.0:
            continue
        # The vertex before is near, and its opposite vertex is a good guess.
        j, radius = -1, diagonal
        r = _radius(V, i, last, nx, ny, nz)
        if r < radius:
            j, radius = last, r
        j, radius = _ball(start, low, high, V, i, nx, ny, nz, radius, j, stack, value, depth)
        if j < 0:
            continue
        last = j
        if nx * inward[j, 0] + ny * inward[j, 1] + nz * inward[j, 2] <= OPPOSITE:
            found[order[i]] = order[j]
            continue
        t = 2.0 * radius
        for _ in range(STEPS):
            if not t < diagonal:
                break
            x, y, z = V[i, 0] + t * nx, V[i, 1] + t * ny, V[i, 2] + t * nz
            j, square = _nearest(start, low, high, V, x, y, z, j, stack, value, depth)
            distance = np.sqrt(square)
            if distance <= edge and nx * inward[j, 0] + ny * inward[j, 1] + nz * inward[j, 2] <= OPPOSITE:
                found[order[i]] = order[j]
                break
            t += max(distance - LEAST_STEP * edge, LEAST_STEP * edge)


@kernel
def _distances(start, low, high, points, offsets, V, found):
    """Write the least sum of distance and offset for each position; see :func:`distances`."""
    size = EACH * len(start)
    stack, value, depth = np.empty(size, dtype=np.int64), np.empty(size), np.empty(size, dtype=np.int64)
    last = 0
    for i in range(len(V)):
        x, y, z = V[i, 0], V[i, 1], V[i, 2]
        square = (points[last, 0] - x) ** 2 + (points[last, 1] - y) ** 2 + (points[last, 2] - z) ** 2
        best = np.sqrt(square) + offsets[last]
        top = _push(stack, value, depth, 0, 0, start[-1] - 1, len(start) - 2, 0.0)
        while top > 0:
            top -= 1
            b, level = stack[top], depth[top]
            if value[top] >= best:
                continue
            if level > 0:
                first, end = _children(start, level, b)
                bottom = top
                for child in range(first, end):
                    bound = np.sqrt(_square(low, high, child, x, y, z))
                    if bound < best:
                        top = _push(stack, value, depth, top, bottom, child, level - 1, bound)
                continue
            for j in range(EACH * b, min(EACH * b + EACH, len(points))):
                square = (points[j, 0] - x) ** 2 + (points[j, 1] - y) ** 2 + (points[j, 2] - z) ** 2
                total = np.sqrt(square) + offsets[j]
                if total < best:
                    best, last = total, j
        found[i] = best


@subroutine
def _overlap(low, high, a, others_low, others_high, b):
    for axis in range(3):
        if low[a, axis] > others_high[b, axis] or others_low[b, axis] > high[a, axis]:
            return False
    return True


@subroutine
def _height(V, a, b, c, d):
    """Six times the signed volume of a tetrahedron."""
    ux, uy, uz = V[b, 0] - V[a, 0], V[b, 1] - V[a, 1], V[b, 2] - V[a, 2]
    vx, vy, vz = V[c, 0] - V[a, 0], V[c, 1] - V[a, 1], V[c, 2] - V[a, 2]
    wx, wy, wz = V[d, 0] - V[a, 0], V[d, 1] - V[a, 1], V[d, 2] - V[a, 2]
    return ux * (vy * wz - vz * wy) + uy * (vz * wx - vx * wz) + uz * (vx * wy - vy * wx)


@subroutine
def _pierces(V, face, other):
    """Whether a side of a face pierces another face. Sides with a common corner do not count."""
    a, b, c = other[0], other[1], other[2]
    for k in range(3):
        p, q = face[k], face[(k + 1) % 3]
        if p in (a, b, c) or q in (a, b, c):
            continue
        if _height(V, a, b, c, p) * _height(V, a, b, c, q) >= 0.0:
            continue
        one, two, three = _height(V, p, q, a, b), _height(V, p, q, b, c), _height(V, p, q, c, a)
        if (one > 0.0) == (two > 0.0) == (three > 0.0):
            return True
    return False


@kernel
def _cross(begin, end, start, low, high, lowest, highest, V, F, order, found):
    """Mark faces in a range of leaves that cross faces of these or later leaves. F has the boxes' order."""
    stack, depth = np.empty(EACH * len(start), dtype=np.int64), np.empty(EACH * len(start), dtype=np.int64)
    for leaf in range(begin, end):
        top = 1
        stack[0], depth[0] = start[-1] - 1, len(start) - 2
        while top > 0:
            top -= 1
            b, level = stack[top], depth[top]
            if not _overlap(low, high, leaf, low, high, b):
                continue
            if level > 0:
                first, last = _children(start, level, b)
                for child in range(first, last):
                    stack[top], depth[top] = child, level - 1
                    top += 1
                continue
            if b < leaf:
                continue
            for i in range(EACH * leaf, min(EACH * leaf + EACH, len(F))):
                if not _overlap(lowest, highest, i, low, high, b):
                    continue
                for j in range(max(EACH * b, i + 1), min(EACH * b + EACH, len(F))):
                    if found[order[i]] and found[order[j]]:
                        continue
                    if not _overlap(lowest, highest, i, lowest, highest, j):
                        continue
                    if _pierces(V, F[i], F[j]) or _pierces(V, F[j], F[i]):
                        found[order[i]] = found[order[j]] = True
