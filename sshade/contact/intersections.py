"""Which faces of a mesh intersect others: a box tree over them, searched by :mod:`sshade.contact.triangles`.

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
does the same with intervals on the common line of the two planes). Faces at a
common corner are mostly told apart by a plane between them first.

pymeshlab's filter agrees on faces in general position, and differs on these: it
does not count faces that only touch, that overlap within one plane, that are
folded flat, or that are there twice; it does count faces without a plane.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numba import njit

from sshade.contact.triangles import mark_intersecting, set_planes
from sshade.errors import InputError
from sshade.mesh.boxes import bounds, box_tree, curve_order
from sshade.mesh.mesh import Mesh
from sshade.threads import ThreadTeam

#: Relative to the bounding-box diagonal: a point nearer to a plane than this lies on it.
PLANE_TOLERANCE = 1e-12

#: Faces in a leaf of the box tree; 2 to 8 differ by less than 20 % in time.
LEAF_SIZE = 4
#: Parts of the tree, a power of two, that threads share: each with itself and those after it.
PARTS = 64
#: Faces whose planes a thread computes at a time.
PIECE = 32768


def intersecting_faces(
    V: np.ndarray,
    F: np.ndarray,
    *,
    among: np.ndarray | None = None,
    order: np.ndarray | None = None,
    workers: int = 1,
) -> np.ndarray:
    """Mark the faces that intersect another face of the same mesh.

    Parameters
    ----------
    V : (n, 3) float64
    F : (m, 3) int64
    among : (m,) bool, optional
        Pairs without one of these faces are left out.
    order : (m,) int64, optional
        Of the faces for the tree, which is faster the nearer neighbours are in it; by default
        :func:`sshade.mesh.boxes.curve_order`.
    workers : int
        Threads; no influence on the result.

    Returns
    -------
    (m,) bool

    Raises
    ------
    InputError
        On positions that are not finite, or faces of other vertices.
    """
    V = np.ascontiguousarray(V, dtype=np.float64)
    F = np.ascontiguousarray(F, dtype=np.int64)
    if not np.isfinite(V).all() or F.min() < 0 or F.max() >= len(V):
        raise InputError(f"the positions must be finite, and the faces' corners among the {len(V)} vertices")
    low, high = bounds(V)
    tolerance = PLANE_TOLERANCE * float(np.linalg.norm(high - low))
    order = curve_order(V, F) if order is None else order
    if among is not None:
        order = order[_in_reach(V, F, among, tolerance)[order]]
    result = np.zeros(len(F), dtype=np.bool_)
    if len(order) == 0:
        return result
    # In the tree's order the faces of a leaf, and nearby leaves, lie together in memory.
    F = F.take(order, axis=0)
    planes, marked = np.empty((len(F), 4)), np.zeros(len(F), dtype=np.bool_)
    asked = np.ones(len(F), dtype=np.bool_) if among is None else among[order]

    def planes_of(piece: int) -> None:
        set_planes(V, F, tolerance, piece * PIECE, min(len(F), (piece + 1) * PIECE), planes)

    with ThreadTeam(workers) as team:
        face_boxes, boxes = box_tree(V, F, leaf_size=LEAF_SIZE, team=team)
        team(planes_of, -(-len(F) // PIECE))
        nodes = _asked_nodes(asked, LEAF_SIZE, len(boxes) // 2)
        parts = min(PARTS, len(boxes) // 2)

        def part(number: int) -> None:
            mark_intersecting(
                V, F, planes, face_boxes, boxes, LEAF_SIZE, tolerance, asked, nodes, parts, number, marked
            )

        team(part, parts)
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

    Raises
    ------
    InputError
        On positions that :meth:`sshade.mesh.mesh.Mesh.checked` refuses.
    """
    find = partial(intersecting_faces, F=mesh.F, order=mesh.curve_order, workers=workers)
    now = find(mesh.checked(positions), among=among)
    if now.any():
        now &= ~find(mesh.V, among=now)
    return now


@njit(cache=True, nogil=True)
def _in_reach(V, F, among, tolerance):
    """(m,) bool: faces whose box overlaps the box around all those among these."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for f in range(len(F)):
        if among[f]:
            for corner in range(3):
                for c in range(3):
                    low[c], high[c] = min(low[c], V[F[f, corner], c]), max(high[c], V[F[f, corner], c])
    found = np.empty(len(F), dtype=np.bool_)
    for f in range(len(F)):
        found[f] = True
        for c in range(3):
            x, y, z = V[F[f, 0], c], V[F[f, 1], c], V[F[f, 2], c]
            apart = (min(x, y, z) > high[c] + tolerance) | (max(x, y, z) < low[c] - tolerance)
            found[f] = found[f] & (not apart)
    return found


@njit(cache=True, nogil=True)
def _asked_nodes(asked, leaf_size, leaves):
    """(2 * leaves,) bool: the nodes of the tree with an asked face below them."""
    nodes = np.zeros(2 * leaves, dtype=np.bool_)
    for f in range(len(asked)):
        nodes[leaves + f // leaf_size] |= asked[f]
    for node in range(leaves - 1, 0, -1):
        nodes[node] = nodes[2 * node] | nodes[2 * node + 1]
    return nodes
