"""Make an oriented manifold of a triangle mesh by copying vertices.

Two faces stay joined at an edge if no third face meets them there, or if they continue each other best
among the faces at that edge. The surface is cut everywhere else. A one-sided surface, such as a Moebius
strip, is not cut: the manifold has both of its sides, as one surface that covers it twice.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sshade.core.errors import InputError
from sshade.core.kernels import kernel
from sshade.mesh.incidence import EdgeSides, sides_by_edge
from sshade.mesh.mesh import Mesh, unit_rows
from sshade.mesh.places import connected

#: Difference below which two cosines count as equal. Between faces that continue a face equally well, the
#: smaller inside angle decides.
SAME_COSINE = 1e-6


class Cut(NamedTuple):
    """An oriented manifold made from a mesh.

    Attributes
    ----------
    mesh : Mesh
        Faces in the original order, followed by the reversed faces of the other side of one-sided surfaces.
        The original vertices come first, copies follow.
    origin : (k,) int64
        Original vertex of each vertex.
    turned : int
        Number of faces whose orientation was reversed.
    one_sided : (m,) bool
        Original faces of one-sided surfaces, which `mesh` has twice.
    """

    mesh: Mesh
    origin: np.ndarray
    turned: int
    one_sided: np.ndarray


def cut_to_manifold(mesh: Mesh) -> Cut:
    """Reverse faces to agree with their neighbours, and cut the mesh where it is not manifold.

    At an edge with more than two faces, pairs of faces that run through the edge in opposite directions
    stay joined, the straightest continuation first. If two continuations are equally straight,
    the pair with the smaller inside angle wins, which separates solids that touch along an edge. Fans that
    touch in a vertex are separated.

    A one-sided surface gets its orientation double cover: each face twice, once reversed, and each face
    joined to the copies of its neighbours that agree with it. The cover of a connected surface is connected.
    Sheets with one side and sheets with two sides are not joined at edges with more than two faces.

    Parameters
    ----------
    mesh : Mesh
        Any mesh; an oriented manifold is returned itself.

    Raises
    ------
    InputError
        If cutting does not make the mesh manifold.
    """
    if mesh.is_manifold and mesh.is_oriented:
        return Cut(mesh, np.arange(mesh.n), 0, np.zeros(mesh.m, dtype=bool))
    edges = sides_by_edge(mesh.F, mesh.n)
    flipped, one_sided = orientation(mesh, edges)
    crowded = edges.faces > 2
    sheets = _Sheets(mesh, np.arange(mesh.m), one_sided)
    if one_sided.any():
        face = np.append(sheets.face, np.flatnonzero(one_sided))
        sheets = _Sheets(Mesh(mesh.V, mesh.F[face]), face, one_sided[face])
        flipped = np.append(flipped & ~one_sided, np.ones(len(face) - mesh.m, dtype=bool))
        edges = sides_by_edge(mesh.F[face], mesh.n)  # the same edges in the same order
    pairs = _joined(sheets, edges, flipped, crowded)
    while True:
        F, origin = _fans(sheets.mesh, edges, pairs)
        manifold = Mesh(mesh.V[origin], np.where(flipped[:, None], F[:, ::-1], F))
        if manifold.is_manifold and manifold.is_oriented:
            return Cut(manifold, origin, int(flipped[: mesh.m].sum()), one_sided)
        # Two pairs at one edge may still be connected around both of its ends.
        if not crowded[pairs[2]].any():
            raise InputError("the mesh is not manifold, and cutting it there does not make it so; remesh it")
        pairs = pairs[:, ~crowded[pairs[2]]]


class _Sheets(NamedTuple):
    """Faces of a mesh, those of one-sided sheets twice.

    Attributes
    ----------
    mesh : Mesh
    face : (m,) int64
        Original face of each face.
    one_sided : (m,) bool
    """

    mesh: Mesh
    face: np.ndarray
    one_sided: np.ndarray


def orientation(mesh: Mesh, edges: EdgeSides) -> tuple[np.ndarray, np.ndarray]:
    """Find the faces to reverse so that neighbours run through their common edge in opposite directions.

    Neighbours are two faces at an edge without a third face. In each connected sheet of neighbours, the
    part of larger area keeps its orientation. On a one-sided sheet some neighbours still disagree.

    Parameters
    ----------
    mesh : Mesh
    edges : EdgeSides
        Sides of the mesh's faces.

    Returns
    -------
    reversed, one_sided : (m,) bool
        The faces to reverse, and the faces of one-sided sheets.
    """
    tail, twin = mesh.F.ravel(), edges.twin
    # Two sides of an edge that begin at the same vertex belong to faces of opposite orientation.
    same = (twin >= 0) & (tail == tail[twin])
    flipped, sheet = _turn_to_agree(twin.reshape(-1, 3), same.reshape(-1, 3))
    side = np.flatnonzero(twin >= 0)
    disagree = same[side] != (flipped[side // 3] ^ flipped[twin[side] // 3])
    one_sided = np.isin(sheet, sheet[side[disagree] // 3])
    area = np.bincount(sheet, np.where(flipped, -1.0, 1.0) * mesh.face_areas)
    return flipped ^ (area < 0)[sheet], one_sided


@kernel
def _turn_to_agree(twin, same):
    """Visit each sheet from its first face over `twin` (m, 3); reverse a face across `same` sides (m, 3)."""
    m = len(twin)
    flipped, sheet = np.zeros(m, dtype=np.bool_), np.full(m, -1, dtype=np.int64)
    queue = np.empty(m, dtype=np.int64)
    sheets = 0
    for root in range(m):
        if sheet[root] != -1:
            continue
        sheet[root], queue[0], taken, known = sheets, root, 0, 1
        while taken < known:
            f = queue[taken]
            taken += 1
            for c in range(3):
                g = twin[f, c] // 3
                if twin[f, c] != -1 and sheet[g] == -1:
                    sheet[g], flipped[g] = sheets, flipped[f] ^ same[f, c]
                    queue[known] = g
                    known += 1
        sheets += 1
    return flipped, sheet


def _joined(sheets: _Sheets, edges: EdgeSides, flipped: np.ndarray, crowded: np.ndarray) -> np.ndarray:
    """Find the pairs of faces that stay joined once the `flipped` faces (m,) are reversed.

    At `crowded` edges (e,), more than two faces of the original mesh meet. The rows of the result (3, p) are
    the first faces, the second faces, and their edges.
    """
    face = edges.side // 3
    low = np.repeat(edges.ends[:, 0], edges.faces)
    forward = (sheets.mesh.F.ravel()[edges.side] == low) ^ flipped[face]  # from the smaller end to the larger
    original = sheets.face[face]
    two = np.flatnonzero(edges.faces == 2)
    first = edges.start[two]
    # A face at the boundary of a one-sided sheet is no neighbour of its own copy.
    agree = (forward[first] != forward[first + 1]) & (original[first] != original[first + 1])
    two, first = two[agree], first[agree]
    found = [np.stack([face[first], face[first + 1], two])]
    # On a one-sided sheet the sides at an edge belong to two faces and then to their reversed copies.
    four = np.flatnonzero((edges.faces == 4) & ~crowded)
    first = edges.start[four].astype(np.int64)
    agree = forward[first] != forward[first + 1]
    found.append(np.stack([face[first], face[first + np.where(agree, 1, 3)], four]))
    found.append(np.stack([face[first + 2], face[first + np.where(agree, 3, 1)], four]))
    for e in np.flatnonzero(crowded):
        here = slice(edges.start[e], edges.start[e + 1])
        pairs = _best_pairs(sheets, edges.ends[e], face[here], forward[here])
        found.append(np.array([(*pair, e) for pair in pairs], dtype=np.int64).reshape(-1, 3).T)
    return np.concatenate(found, axis=1)


def _best_pairs(
    sheets: _Sheets, ends: np.ndarray, faces: np.ndarray, forward: np.ndarray
) -> list[tuple[int, int]]:
    """Pair faces (k,) at an edge with more than two faces, the straightest continuation first."""
    i, j = ends
    mesh, original, one_sided = sheets.mesh, sheets.face[faces], sheets.one_sided[faces]
    third = mesh.F[faces].sum(axis=1) - i - j
    along = mesh.V[j] - mesh.V[i]
    along = along / (np.linalg.norm(along) or 1.0)
    away = mesh.V[third] - mesh.V[i]
    away = unit_rows(away - np.outer(away @ along, along))
    cosine = np.round(away @ away.T / SAME_COSINE)
    sine = np.einsum("ijk,k->ij", np.cross(away[:, None], away[None]), along)
    angle = np.arctan2(sine, away @ away.T) % (2 * np.pi)  # from one face to another, about the edge
    ahead, back = np.flatnonzero(forward).tolist(), np.flatnonzero(~forward).tolist()
    choices = sorted(
        (cosine[f, b], angle[b, f], f, b)
        for f in ahead
        for b in back
        if original[f] != original[b] and one_sided[f] == one_sided[b]
    )
    taken: set[int] = set()
    pairs = []
    for _, _, f, b in choices:
        if not taken & {f, b}:
            taken |= {f, b}
            pairs.append((int(faces[f]), int(faces[b])))
    return pairs


def _fans(mesh: Mesh, edges: EdgeSides, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give each fan of joined faces its own copy of the vertex: faces (m, 3), original vertices (k,)."""
    links = [
        [3 * f + (mesh.F[f] == end[:, None]).argmax(axis=1) for f in pairs[:2]]
        for end in edges.ends[pairs[2]].T
    ]
    one, other = np.concatenate(links, axis=1)
    first, fan = np.unique(connected(3 * mesh.m, one, other), return_inverse=True)
    vertex = mesh.F.ravel()[first]
    order = np.lexsort([first, vertex])
    further = np.append(False, np.diff(vertex[order]) == 0)
    place = np.empty(len(first), dtype=np.int64)
    place[order] = np.where(further, mesh.n - 1 + np.cumsum(further), vertex[order])
    origin = np.empty(len(first), dtype=np.int64)
    origin[place] = vertex
    return place[fan].reshape(-1, 3), origin


def cut_surface(mesh: Mesh) -> Cut:
    """Drop duplicate faces, and cut into an oriented manifold: see :func:`cut_to_manifold`."""
    return cut_to_manifold(without_duplicates(mesh))


def mean_of_copies(cut: Cut, V: np.ndarray) -> np.ndarray:
    """Return the mean (n, 3) of the positions V (k, 3) of all copies of each original vertex."""
    count = np.bincount(cut.origin)
    if len(count) == len(V):
        return V
    return np.stack([np.bincount(cut.origin, x) / count for x in V.T], axis=1)


def without_duplicates(mesh: Mesh) -> Mesh:
    """Drop faces that have the three vertices of an earlier face, in any order.

    A manifold mesh has no duplicates and is returned itself.
    """
    if mesh.is_manifold:
        return mesh
    _, first = np.unique(np.sort(mesh.F, axis=1), axis=0, return_index=True)
    return mesh if len(first) == mesh.m else Mesh(mesh.V, mesh.F[np.sort(first)])
