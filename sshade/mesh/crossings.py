"""Faces of a mesh that intersect others, found by boxes around neighbouring faces."""

from __future__ import annotations

import numpy as np

from sshade.core.kernels import kernel, subroutine
from sshade.core.threads import SMALL, ThreadTeam, available_cpus
from sshade.mesh.boxes import EACH, Boxes, enclose

#: Number of boxes of faces that a thread works on at a time.
ROWS = 256


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
        arrays = EACH, boxes.start, low, high, lowest[order], highest[order], V, F[order], order, found
        team.ranges(_cross, leaves, *arrays, rows=ROWS)
    return found


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
def _cross(begin, end, each, start, low, high, lowest, highest, V, F, order, found):
    """Mark faces in a range of leaves that cross faces of these or later leaves. F has the boxes' order."""
    stack, depth = np.empty(each * len(start), dtype=np.int64), np.empty(each * len(start), dtype=np.int64)
    for leaf in range(begin, end):
        top = 1
        stack[0], depth[0] = start[-1] - 1, len(start) - 2
        while top > 0:
            top -= 1
            b, level = stack[top], depth[top]
            if not _overlap(low, high, leaf, low, high, b):
                continue
            if level > 0:
                first = start[level - 1] + each * (b - start[level])
                for child in range(first, min(first + each, start[level])):
                    stack[top], depth[top] = child, level - 1
                    top += 1
                continue
            if b < leaf:
                continue
            for i in range(each * leaf, min(each * leaf + each, len(F))):
                if not _overlap(lowest, highest, i, low, high, b):
                    continue
                for j in range(max(each * b, i + 1), min(each * b + each, len(F))):
                    if found[order[i]] and found[order[j]]:
                        continue
                    if not _overlap(lowest, highest, i, lowest, highest, j):
                        continue
                    if _pierces(V, F[i], F[j]) or _pierces(V, F[j], F[i]):
                        found[order[i]] = found[order[j]] = True
