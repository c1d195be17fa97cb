"""Cut a triangle mesh into an oriented manifold by copying vertices.

Two faces stay joined at an edge if no third face meets them there, or if they continue each other best
among the faces at that edge. The surface is cut everywhere else.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sshade.errors import InputError
from sshade.kernels import kernel
from sshade.mesh.mesh import Mesh, unit_rows
from sshade.mesh.sides import EdgeSides, sides_by_edge

#: Difference below which two cosines count as equal. Between faces that continue a face equally well, the
#: smaller inside angle decides.
SAME_COSINE = 1e-6


class Cut(NamedTuple):
    """An oriented manifold made from a mesh.

    Attributes
    ----------
    mesh : Mesh
        Faces in the original order. The original vertices come first, copies follow.
    origin : (k,) int64
        Original vertex of each vertex.
    turned : int
        Number of faces whose orientation was reversed.
    """

    mesh: Mesh
    origin: np.ndarray
    turned: int


def cut_to_manifold(mesh: Mesh) -> Cut:
    """Reverse faces to agree with their neighbours, and cut the mesh where it is not manifold.

    At an edge with more than two faces, pairs of faces that run through the edge in opposite directions
    stay joined, the straightest continuation first. If two continuations are equally straight,
    the pair with the smaller inside angle wins, which separates solids that touch along an edge. Fans that
    touch in a vertex are separated. A one-sided surface is cut open.

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
        return Cut(mesh, np.arange(mesh.n), 0)
    edges = sides_by_edge(mesh.F, mesh.n)
    flipped = faces_to_turn(mesh, edges)
    pairs = _joined(mesh, edges, flipped)
    while True:
        F, origin = _fans(mesh, edges, pairs)
        manifold = Mesh(mesh.V[origin], np.where(flipped[:, None], F[:, ::-1], F))
        if manifold.is_manifold and manifold.is_oriented:
            return Cut(manifold, origin, int(flipped.sum()))
        # Two pairs at one edge may still be connected around both of its ends.
        crowded = edges.faces[pairs[2]] > 2
        if not crowded.any():
            raise InputError("the mesh is not manifold, and cutting it there does not make it so; remesh it")
        pairs = pairs[:, ~crowded]


def faces_to_turn(mesh: Mesh, edges: EdgeSides) -> np.ndarray:
    """Find the faces to reverse so that neighbours run through their common edge in opposite directions.

    Neighbours are two faces at an edge without a third face. In each connected sheet of neighbours, the
    part of larger area keeps its orientation. On a one-sided surface some neighbours still disagree.

    Parameters
    ----------
    mesh : Mesh
    edges : EdgeSides
        Sides of the mesh's faces.

    Returns
    -------
    (m,) bool
    """
    tail, twin = mesh.F.ravel(), edges.twin
    # Two sides of an edge that begin at the same vertex belong to faces of opposite orientation.
    same = (twin >= 0) & (tail == tail[twin])
    flipped, sheet = _turn_to_agree(twin.reshape(-1, 3), same.reshape(-1, 3))
    area = np.bincount(sheet, np.where(flipped, -1.0, 1.0) * mesh.face_areas)
    return flipped ^ (area < 0)[sheet]


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


def _joined(mesh: Mesh, edges: EdgeSides, flipped: np.ndarray) -> np.ndarray:
    """Find the pairs of faces that stay joined once the `flipped` faces (m,) are reversed.

    The rows of the result (3, p) are the first faces, the second faces, and their edges.
    """
    face = edges.side // 3
    low = np.repeat(edges.ends[:, 0], edges.faces)
    forward = (mesh.F.ravel()[edges.side] == low) ^ flipped[face]  # from the smaller end to the larger
    two = np.flatnonzero(edges.faces == 2)
    first = edges.start[two]
    two, first = (a[forward[first] != forward[first + 1]] for a in (two, first))
    found = [np.stack([face[first], face[first + 1], two])]
    for e in np.flatnonzero(edges.faces > 2):
        here = slice(edges.start[e], edges.start[e + 1])
        pairs = _best_pairs(mesh, edges.ends[e], face[here], forward[here])
        found.append(np.array([(*pair, e) for pair in pairs], dtype=np.int64).reshape(-1, 3).T)
    return np.concatenate(found, axis=1)


def _best_pairs(
    mesh: Mesh, ends: np.ndarray, faces: np.ndarray, forward: np.ndarray
) -> list[tuple[int, int]]:
    """Pair faces (k,) at an edge with more than two faces, the straightest continuation first."""
    i, j = ends
    third = mesh.F[faces].sum(axis=1) - i - j
    along = mesh.V[j] - mesh.V[i]
    along = along / (np.linalg.norm(along) or 1.0)
    away = mesh.V[third] - mesh.V[i]
    away = unit_rows(away - np.outer(away @ along, along))
    cosine = np.round(away @ away.T / SAME_COSINE)
    sine = np.einsum("ijk,k->ij", np.cross(away[:, None], away[None]), along)
    angle = np.arctan2(sine, away @ away.T) % (2 * np.pi)  # from one face to another, about the edge
    ahead, back = np.flatnonzero(forward).tolist(), np.flatnonzero(~forward).tolist()
    choices = sorted((cosine[f, b], angle[b, f], f, b) for f in ahead for b in back)
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
    corners = 3 * mesh.m
    graph = coo_array((np.ones(len(one), dtype=bool), (one, other)), shape=(corners, corners))
    _, fan = connected_components(graph, directed=False)
    _, first, fan = np.unique(fan, return_index=True, return_inverse=True)
    vertex = mesh.F.ravel()[first]
    order = np.lexsort([first, vertex])
    further = np.append(False, np.diff(vertex[order]) == 0)
    place = np.empty(len(first), dtype=np.int64)
    place[order] = np.where(further, mesh.n - 1 + np.cumsum(further), vertex[order])
    origin = np.empty(len(first), dtype=np.int64)
    origin[place] = vertex
    return place[fan].reshape(-1, 3), origin
