"""Which faces of a mesh intersect others: a box tree and a triangle-triangle test in numba.

What counts as an intersection of two faces:

* no common vertex: they meet at all, touching included;
* one common vertex: the edge opposite to it in one face meets the other face;
* a common edge: only if the two are folded flat onto each other (coplanar, and
  both third corners on the same side of the edge);
* three common vertices: always, the face is there twice.

Distances below ``PLANE_TOLERANCE`` x the bounding-box diagonal are zero. A face
whose height is below that has no plane, and is left out.

Two triangles that are not coplanar meet if and only if an edge of one meets the
other (T. Moeller, "A fast triangle-triangle intersection test", 1997, section 2,
does the same with intervals on the common line of the two planes).

pymeshlab's filter agrees on faces in general position, and differs on these: it
does not count faces that only touch, that overlap within one plane, that are
folded flat, or that are there twice; it does count faces without a plane.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from sshade.boxes import box_tree
from sshade.mesh import Mesh
from sshade.parallel import Crew

#: Relative to the bounding-box diagonal: a point nearer to a plane than this lies on it.
PLANE_TOLERANCE = 1e-12

#: Faces in a leaf of the box tree; 2 to 8 differ by less than 20 % in time.
LEAF_SIZE = 4
#: Leaves that a thread takes at a time.
PIECE = 1024


def intersecting_faces(
    V: np.ndarray, F: np.ndarray, *, among: np.ndarray | None = None, workers: int = 1
) -> np.ndarray:
    """Mark the faces that intersect another face of the same mesh.

    Parameters
    ----------
    V : (n, 3) float64
    F : (m, 3) int64
    among : (m,) bool, optional
        Pairs without one of these faces are left out.
    workers : int
        Threads; no influence on the result.

    Returns
    -------
    (m,) bool
    """
    V = np.ascontiguousarray(V, dtype=np.float64)
    F = np.ascontiguousarray(F, dtype=np.int64)
    order, face_boxes, boxes = box_tree(V, F, LEAF_SIZE)
    tolerance = PLANE_TOLERANCE * float(np.linalg.norm(np.ptp(V, axis=0)))
    # In the tree's order the faces of a leaf, and nearby leaves, lie together in memory.
    F = F[order]
    normals = _unit_normals(V, F, tolerance)
    marked, asked = np.zeros((2, len(F)), dtype=np.bool_)
    asked[:] = True if among is None else among[order]
    leaves = -(-len(F) // LEAF_SIZE)
    pieces = -(-leaves // PIECE)

    def piece(number: int) -> None:
        first = number * PIECE
        leaf_range = first, min(leaves, first + PIECE)
        _mark_intersecting(V, F, normals, face_boxes, boxes, LEAF_SIZE, tolerance, asked, *leaf_range, marked)

    with Crew(workers) as crew:
        crew(piece, pieces)
    result = np.empty_like(marked)
    result[order] = marked
    return result


def new_crossings(
    mesh: Mesh, positions: np.ndarray, *, among: np.ndarray | None = None, workers: int = 1
) -> np.ndarray:
    """Mark the faces that intersect others in a deformed mesh and did not at rest.

    Parameters
    ----------
    mesh : Mesh
        Rest shape.
    positions : (n, 3) float64
    among, workers
        See :func:`intersecting_faces`.

    Returns
    -------
    (m,) bool
    """
    now = intersecting_faces(positions, mesh.F, among=among, workers=workers)
    if now.any():
        now &= ~intersecting_faces(mesh.V, mesh.F, among=now, workers=workers)
    return now


def _unit_normals(V: np.ndarray, F: np.ndarray, tolerance: float) -> np.ndarray:
    """(m, 3) unit normals; zero where the height over the longest edge is within the tolerance."""
    a, b, c = V[F[:, 0]], V[F[:, 1]], V[F[:, 2]]
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    longest = np.sqrt(np.max([((q - p) ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0))
    flat = length <= tolerance * longest
    return np.where(flat[:, None], 0.0, normals / np.where(flat, 1.0, length)[:, None])


@njit(cache=True, nogil=True)
def _mark_intersecting(
    V, F, normals, face_boxes, boxes, leaf_size, tolerance, asked, first_leaf, end_leaf, marked
):
    """Test the asked faces of these leaves against those of every leaf whose box they overlap.

    Threads may mark the same faces at the same time: they write the same.
    """
    m, leaves, whole = len(F), len(boxes) // 2, asked.all()
    height = 0
    while (1 << height) < leaves:
        height += 1
    node_stack = np.empty(2 * height + 4, dtype=np.int64)
    height_stack = np.empty(2 * height + 4, dtype=np.int64)
    sides = np.empty((2, 3))  # scratch: allocating it for every pair takes half of the time
    for leaf in range(first_leaf, end_leaf):
        begin, end = leaf * leaf_size, min(m, (leaf + 1) * leaf_size)
        if not asked[begin:end].any():
            continue
        node_stack[0], height_stack[0], size = 1, height, 1
        while size > 0:
            size -= 1
            node, h = node_stack[size], height_stack[size]
            # Earlier leaves have met this one already, if they were asked.
            if whole and ((node + 1) << h) - 1 - leaves < leaf:
                continue
            if not _boxes_overlap(boxes, leaves + leaf, boxes, node, tolerance):
                continue
            if h > 0:
                for child in (2 * node, 2 * node + 1):
                    node_stack[size], height_stack[size] = child, h - 1
                    size += 1
                continue
            other = node - leaves
            for f in range(begin, end):
                if not (asked[f] and _boxes_overlap(face_boxes, f, boxes, node, tolerance)):
                    continue
                first = f + 1 if whole and other == leaf else other * leaf_size
                for g in range(first, min(m, (other + 1) * leaf_size)):
                    if f == g or (marked[f] and marked[g]):
                        continue
                    if not _boxes_overlap(face_boxes, f, face_boxes, g, tolerance):
                        continue
                    if _faces_intersect(V, F, normals, f, g, sides, tolerance):
                        marked[f] = True
                        marked[g] = True


@njit(cache=True, nogil=True)
def _boxes_overlap(a, i, b, j, tolerance):
    """Whether box i of a and box j of b overlap."""
    apart = False
    for c in range(3):
        apart = apart or a[i, c] > b[j, c + 3] + tolerance or b[j, c] > a[i, c + 3] + tolerance
    return not apart


@njit(cache=True, nogil=True)
def _faces_intersect(V, F, normals, face_f, face_g, sides, tolerance):
    """Whether two faces whose boxes overlap intersect, by the definition of the module."""
    f, g = F[face_f], F[face_g]
    shared, fi, gi = 0, 0, 0
    f_rest, g_rest = 3, 3  # sums of the corners 0, 1, 2 that are not shared
    for i in range(3):
        for j in range(3):
            if f[i] == g[j]:
                shared += 1
                fi, gi = i, j
                f_rest -= i
                g_rest -= j
    if shared == 3:
        return True
    f_normal, g_normal = normals[face_f], normals[face_g]
    if _is_zero(f_normal) or _is_zero(g_normal):
        return False
    if shared == 2:
        return _folded_flat(V, f, g, f_rest, g_rest, f_normal, tolerance)
    f_side, g_side = sides[0], sides[1]  # heights over the other face's plane
    for i in range(3):
        f_side[i] = _height(V, f[i], g[gi], g_normal, tolerance)
        g_side[i] = _height(V, g[i], f[fi], f_normal, tolerance)
    if _is_zero(f_side) or _is_zero(g_side):
        return _coplanar_overlap(V, f, g, f_normal, shared, fi, gi, tolerance)
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3  # the edge opposite to corner i
        if (shared == 0 or i == fi) and _edge_meets(
            V, f[a], f[b], f_side[a], f_side[b], g, g_normal, tolerance
        ):
            return True
        if (shared == 0 or i == gi) and _edge_meets(
            V, g[a], g[b], g_side[a], g_side[b], f, f_normal, tolerance
        ):
            return True
    return False


@njit(cache=True, nogil=True)
def _is_zero(x):
    return x[0] == 0 and x[1] == 0 and x[2] == 0


@njit(cache=True, nogil=True)
def _height(V, point, origin, normal, tolerance):
    """Height of vertex `point` over the plane through vertex `origin`; exactly zero within the tolerance."""
    height = 0.0
    for c in range(3):
        height += (V[point, c] - V[origin, c]) * normal[c]
    return 0.0 if abs(height) <= tolerance else height


@njit(cache=True, nogil=True)
def _edge_meets(V, p, q, p_side, q_side, triangle, normal, tolerance):
    """Whether the segment pq, of known heights over the triangle's plane, meets the triangle.

    A segment within the plane is left to the other face's edges, which cross it.
    """
    if p_side * q_side > 0 or (p_side == 0 and q_side == 0):
        return False
    # Written out: arrays of three numbers take five times as long.
    share = p_side / (p_side - q_side)
    x = V[p, 0] + (V[q, 0] - V[p, 0]) * share
    y = V[p, 1] + (V[q, 1] - V[p, 1]) * share
    z = V[p, 2] + (V[q, 2] - V[p, 2]) * share
    for i in range(3):
        a, b = triangle[i], triangle[(i + 1) % 3]
        ex, ey, ez = V[b, 0] - V[a, 0], V[b, 1] - V[a, 1], V[b, 2] - V[a, 2]
        rx, ry, rz = x - V[a, 0], y - V[a, 1], z - V[a, 2]
        inward = (ey * rz - ez * ry) * normal[0]
        inward += (ez * rx - ex * rz) * normal[1]
        inward += (ex * ry - ey * rx) * normal[2]
        if inward < -tolerance * np.sqrt(ex * ex + ey * ey + ez * ez):
            return False
    return True


@njit(cache=True, nogil=True)
def _folded_flat(V, f, g, f_rest, g_rest, f_normal, tolerance):
    """Two faces at a common edge: coplanar, with both third corners on one side of the edge."""
    if _height(V, g[g_rest], f[(f_rest + 1) % 3], f_normal, tolerance) != 0:
        return False
    apex, other = V[f[f_rest]], V[g[g_rest]]
    a, b = V[f[(f_rest + 1) % 3]], V[f[(f_rest + 2) % 3]]
    inward = np.cross(f_normal, b - a)
    return ((apex - a) * inward).sum() * ((other - a) * inward).sum() > 0


@njit(cache=True, nogil=True)
def _coplanar_overlap(V, f, g, normal, shared, fi, gi, tolerance):
    """Whether two triangles of one plane overlap.

    Without a common corner: they are disjoint if and only if an edge's line
    separates them. At a common corner: the sectors overlap, that is an edge
    from the corner runs strictly within the other sector, or both coincide.
    """
    if shared == 0:
        return not (_separated(V, f, g, normal, tolerance) or _separated(V, g, f, normal, tolerance))
    p = V[f[fi]]
    a, b = V[f[(fi + 1) % 3]] - p, V[f[(fi + 2) % 3]] - p
    c, d = V[g[(gi + 1) % 3]] - p, V[g[(gi + 2) % 3]] - p
    if (np.cross(c, d) * normal).sum() < 0:
        c, d = d, c
    return (
        _in_sector(c, a, b, normal)
        or _in_sector(d, a, b, normal)
        or _in_sector(a, c, d, normal)
        or _in_sector(b, c, d, normal)
        or _in_sector(c + d, a, b, normal)
    )


@njit(cache=True, nogil=True)
def _separated(V, f, g, normal, tolerance):
    """Whether all of g lies beyond an edge of f (f counter-clockwise about the normal or not)."""
    for i in range(3):
        a, b, apex = V[f[i]], V[f[(i + 1) % 3]], V[f[(i + 2) % 3]]
        out = np.cross(b - a, normal)
        out = out / np.sqrt((out * out).sum())
        if ((apex - a) * out).sum() > 0:
            out = -out
        beyond = True
        for j in range(3):
            beyond = beyond and ((V[g[j]] - a) * out).sum() > tolerance
        if beyond:
            return True
    return False


@njit(cache=True, nogil=True)
def _in_sector(x, a, b, normal):
    """Whether direction x is strictly between a and b (counter-clockwise, less than half a turn)."""
    # 1e-9 rad: neighbours in a flat fan have a common edge direction up to rounding.
    size = np.sqrt((x * x).sum())
    from_a = (np.cross(a, x) * normal).sum() / (np.sqrt((a * a).sum()) * size)
    to_b = (np.cross(x, b) * normal).sum() / (np.sqrt((b * b).sum()) * size)
    return from_a > 1e-9 and to_b > 1e-9
