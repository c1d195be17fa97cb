"""Pairs of faces whose boxes overlap, and whether they intersect (see :mod:`sshade.contact.intersections`).

The search and the test are in one file, because a cached kernel does not see edits in other
files. Nearly all pairs that a search comes up with are neighbours, so what decides about those
comes first. Points are tuples: views of the rows of arrays cost more than the arithmetic.
"""

from __future__ import annotations

import numpy as np
from numba import njit

#: From so many tolerances on, corners on either side of a plane decide. Below, what the test lets
#: pass as touching may, or the rounding of positions far from the origin.
CLEAR = 1e6


@njit(cache=True, nogil=True)
def set_planes(V, F, tolerance, first, end, planes):
    """Set the planes (m, 4) of the faces from `first` to `end`.

    A unit normal, and a lower bound of the sines of the face's angles. All zero where the height
    over the longest edge is within the tolerance.
    """
    for f in range(first, end):
        a, b, c = _row(V, F[f, 0]), _row(V, F[f, 1]), _row(V, F[f, 2])
        ab, bc, ca = _minus(b, a), _minus(c, b), _minus(a, c)
        normal = _cross(ab, _minus(c, a))
        length = np.sqrt(_dot(normal, normal))
        longest = max(_dot(ab, ab), _dot(bc, bc), _dot(ca, ca))
        flat = length <= tolerance * np.sqrt(longest)
        for d in range(3):
            planes[f, d] = 0.0 if flat else normal[d] / length
        planes[f, 3] = 0.0 if flat else length / longest


@njit(cache=True, nogil=True)
def mark_intersecting(
    V, F, planes, face_boxes, boxes, leaf_size, tolerance, asked, nodes, parts, part, marked
):
    """Mark faces of one part of the tree, and of those after it, that intersect in a pair of them.

    Pairs of nodes of one level whose boxes overlap are followed down to the leaves. Threads may
    mark the same faces at the same time: they write the same.
    """
    m, leaves = len(F), len(boxes) // 2
    height = 0
    while (parts << height) < leaves:
        height += 1
    stack = np.empty((3 * height + 4, 2), dtype=np.int64)
    for other in range(parts + part, 2 * parts):
        stack[0, 0], stack[0, 1], size = parts + part, other, 1
        while size > 0:
            size -= 1
            a, b = stack[size, 0], stack[size, 1]
            if not ((nodes[a] or nodes[b]) and _boxes_overlap(boxes, a, boxes, b, tolerance)):
                continue
            if a < leaves:
                for i in range(2 * a, 2 * a + 2):
                    for j in range(max(i, 2 * b), 2 * b + 2):
                        stack[size, 0], stack[size, 1] = i, j
                        size += 1
                continue
            begin, end = (b - leaves) * leaf_size, min(m, (b - leaves + 1) * leaf_size)
            for f in range((a - leaves) * leaf_size, min(m, (a - leaves + 1) * leaf_size)):
                if not _boxes_overlap(face_boxes, f, boxes, b, tolerance):
                    continue
                for g in range(max(f + 1, begin), end):
                    if not _boxes_overlap(face_boxes, f, face_boxes, g, tolerance):
                        continue
                    if not (asked[f] or asked[g]) or (marked[f] and marked[g]):
                        continue
                    if _faces_intersect(V, F, planes, f, g, tolerance):
                        marked[f] = True
                        marked[g] = True


@njit(cache=True, nogil=True)
def _boxes_overlap(a, i, b, j, tolerance):
    """Whether box i of a and box j of b overlap."""
    # |, since `or` would branch, in no pattern that a processor could foresee.
    apart = False
    for c in range(3):
        apart = apart | (a[i, c] > b[j, c + 3] + tolerance) | (b[j, c] > a[i, c + 3] + tolerance)
    return not apart


@njit(cache=True, nogil=True)
def _faces_intersect(V, F, planes, f, g, tolerance):
    """Whether the faces f and g, whose boxes overlap, intersect."""
    f0, f1, f2, g0, g1, g2 = F[f, 0], F[f, 1], F[f, 2], F[g, 0], F[g, 1], F[g, 2]
    # |, since `or` would branch, in no pattern that a processor could foresee.
    f0_shared, f1_shared = (f0 == g0) | (f0 == g1) | (f0 == g2), (f1 == g0) | (f1 == g1) | (f1 == g2)
    f2_shared = (f2 == g0) | (f2 == g1) | (f2 == g2)
    shared = int(f0_shared) + int(f1_shared) + int(f2_shared)
    if shared == 3:
        return True
    f_normal, g_normal = _row(planes, f), _row(planes, g)
    if _is_zero(f_normal) or _is_zero(g_normal):
        return False
    # The common corner, or the one opposite to the common edge, to the front.
    corner = shared == 1
    a, b, c = _turned(f0_shared == corner, f1_shared == corner, f0, f1, f2)
    g0_shared, g1_shared = (g0 == f0) | (g0 == f1) | (g0 == f2), (g1 == f0) | (g1 == f1) | (g1 == f2)
    d, e, h = _turned(g0_shared == corner, g1_shared == corner, g0, g1, g2)
    p, q, r = _row(V, a), _row(V, b), _row(V, c)
    if shared == 2:
        return _folded_flat(p, q, r, _row(V, d), f_normal, tolerance)
    u, v = _row(V, e), _row(V, h)
    if shared == 1:
        # Where an angle is small, a point that touches both its sides can be far beyond the corner.
        clear = CLEAR * tolerance / min(planes[f, 3], planes[g, 3])
        if _apart_at_corner(p, q, r, u, v, clear):
            return False
        return _meet_beyond_corner(p, q, r, u, v, f_normal, g_normal, tolerance)
    return _meet(p, q, r, _row(V, d), u, v, f_normal, g_normal, tolerance)


@njit(cache=True, nogil=True)
def _turned(x_first, y_first, x, y, z):
    """The corners x, y, z of a triangle, from x, from y or from z on."""
    if x_first:
        return x, y, z
    if y_first:
        return y, z, x
    return z, x, y


@njit(cache=True, nogil=True)
def _folded_flat(p, q, r, other, normal, tolerance):
    """Triangle pqr and one at its edge qr: coplanar, with p and the other's corner on one side of it."""
    if _height(other, q, normal, tolerance) != 0:
        return False
    inward = _cross(normal, _minus(r, q))
    return _dot(_minus(p, q), inward) * _dot(_minus(other, q), inward) > 0


@njit(cache=True, nogil=True)
def _apart_at_corner(p, q, r, u, v, clear):
    """Whether a plane through p, the likeliest, has q and r on one side and u and v on the other."""
    across = u[0] + v[0] - q[0] - r[0], u[1] + v[1] - q[1] - r[1], u[2] + v[2] - q[2] - r[2]
    f_side = max(_dot(_minus(q, p), across), _dot(_minus(r, p), across))
    g_side = min(_dot(_minus(u, p), across), _dot(_minus(v, p), across))
    least = min(-f_side, g_side)
    return least > 0 and least * least > clear * clear * _dot(across, across)


@njit(cache=True, nogil=True)
def _meet_beyond_corner(p, q, r, u, v, f_normal, g_normal, tolerance):
    """Whether the triangles pqr and puv have more in common than p."""
    q_side, r_side = _height(q, p, g_normal, tolerance), _height(r, p, g_normal, tolerance)
    u_side, v_side = _height(u, p, f_normal, tolerance), _height(v, p, f_normal, tolerance)
    if (q_side == 0 and r_side == 0) or (u_side == 0 and v_side == 0):
        return _sectors_overlap(p, q, r, u, v, f_normal)
    return _edge_meets(q, r, q_side, r_side, p, u, v, g_normal, tolerance) or _edge_meets(
        u, v, u_side, v_side, p, q, r, f_normal, tolerance
    )


@njit(cache=True, nogil=True)
def _meet(p, q, r, t, u, v, f_normal, g_normal, tolerance):
    """Whether the triangles pqr and tuv, without a common corner, meet."""
    p_side, q_side = _height(p, t, g_normal, tolerance), _height(q, t, g_normal, tolerance)
    t_side, u_side = _height(t, p, f_normal, tolerance), _height(u, p, f_normal, tolerance)
    r_side, v_side = _height(r, t, g_normal, tolerance), _height(v, p, f_normal, tolerance)
    if _is_zero((p_side, q_side, r_side)) or _is_zero((t_side, u_side, v_side)):
        return not (
            _separated(p, q, r, t, u, v, f_normal, tolerance)
            or _separated(t, u, v, p, q, r, f_normal, tolerance)
        )
    return (
        _edge_meets(p, q, p_side, q_side, t, u, v, g_normal, tolerance)
        or _edge_meets(q, r, q_side, r_side, t, u, v, g_normal, tolerance)
        or _edge_meets(r, p, r_side, p_side, t, u, v, g_normal, tolerance)
        or _edge_meets(t, u, t_side, u_side, p, q, r, f_normal, tolerance)
        or _edge_meets(u, v, u_side, v_side, p, q, r, f_normal, tolerance)
        or _edge_meets(v, t, v_side, t_side, p, q, r, f_normal, tolerance)
    )


@njit(cache=True, nogil=True)
def _edge_meets(p, q, p_side, q_side, a, b, c, normal, tolerance):
    """Whether the segment pq, of known heights over the triangle's plane, meets the triangle abc.

    A segment within the plane is left to the other face's edges, which cross it.
    """
    if p_side * q_side > 0 or (p_side == 0 and q_side == 0):
        return False
    share = p_side / (p_side - q_side)
    x = p[0] + (q[0] - p[0]) * share, p[1] + (q[1] - p[1]) * share, p[2] + (q[2] - p[2]) * share
    return not (
        _is_outside(x, a, b, normal, tolerance)
        or _is_outside(x, b, c, normal, tolerance)
        or _is_outside(x, c, a, normal, tolerance)
    )


@njit(cache=True, nogil=True)
def _is_outside(x, a, b, normal, tolerance):
    """Whether x is beyond the edge ab of a triangle with this normal."""
    edge = _minus(b, a)
    inward = _dot(_cross(edge, _minus(x, a)), normal)
    return inward < 0 and inward < -tolerance * np.sqrt(_dot(edge, edge))


@njit(cache=True, nogil=True)
def _sectors_overlap(p, q, r, u, v, normal):
    """Whether the sectors of two triangles pqr and puv of one plane overlap.

    An edge from p then runs strictly within the other sector, or both coincide.
    """
    a, b = _minus(q, p), _minus(r, p)
    c, d = _minus(u, p), _minus(v, p)
    if _dot(_cross(c, d), normal) < 0:
        c, d = d, c
    return (
        _in_sector(c, a, b, normal)
        or _in_sector(d, a, b, normal)
        or _in_sector(a, c, d, normal)
        or _in_sector(b, c, d, normal)
        or _in_sector((c[0] + d[0], c[1] + d[1], c[2] + d[2]), a, b, normal)
    )


@njit(cache=True, nogil=True)
def _in_sector(x, a, b, normal):
    """Whether direction x is strictly between a and b (counter-clockwise, less than half a turn)."""
    # 1e-9 rad: neighbours in a flat fan have a common edge direction up to rounding.
    size = np.sqrt(_dot(x, x))
    from_a = _dot(_cross(a, x), normal) / (np.sqrt(_dot(a, a)) * size)
    to_b = _dot(_cross(x, b), normal) / (np.sqrt(_dot(b, b)) * size)
    return from_a > 1e-9 and to_b > 1e-9


@njit(cache=True, nogil=True)
def _separated(p, q, r, t, u, v, normal, tolerance):
    """Whether tuv, in the plane of pqr, lies beyond one of its edges' lines."""
    return (
        _beyond(p, q, r, t, u, v, normal, tolerance)
        or _beyond(q, r, p, t, u, v, normal, tolerance)
        or _beyond(r, p, q, t, u, v, normal, tolerance)
    )


@njit(cache=True, nogil=True)
def _beyond(a, b, apex, t, u, v, normal, tolerance):
    """Whether t, u and v are on the other side of the line ab than the apex."""
    out = _cross(_minus(b, a), normal)
    # Either way about the normal.
    length = np.sqrt(_dot(out, out))
    out = out[0] / length, out[1] / length, out[2] / length
    if _dot(_minus(apex, a), out) > 0:
        out = -out[0], -out[1], -out[2]
    return (
        _dot(_minus(t, a), out) > tolerance
        and _dot(_minus(u, a), out) > tolerance
        and _dot(_minus(v, a), out) > tolerance
    )


@njit(cache=True, nogil=True)
def _height(x, origin, normal, tolerance):
    """Height of x over the plane through the origin; exactly zero within the tolerance."""
    height = _dot(_minus(x, origin), normal)
    return 0.0 if abs(height) <= tolerance else height


@njit(cache=True, nogil=True)
def _row(A, i):
    return A[i, 0], A[i, 1], A[i, 2]


@njit(cache=True, nogil=True)
def _minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(cache=True, nogil=True)
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, nogil=True)
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True, nogil=True)
def _is_zero(x):
    return x[0] == 0 and x[1] == 0 and x[2] == 0
