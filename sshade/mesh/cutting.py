"""Cutting a triangle mesh into an oriented manifold: vertices are copied where their faces are not joined.

Two faces stay joined at an edge that is theirs alone, or that they share with
others but continue each other best; everywhere else the surface is cut. Only
a copy is changed; :attr:`Cut.origin` says which vertex each of its vertices was.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sshade.errors import InputError
from sshade.mesh.adjacency import EdgeSides, sides_by_edge
from sshade.mesh.mesh import Mesh

#: Cosines that differ less are equal: of faces that continue each other equally, the inside decides.
SAME_COSINE = 1e-6


class Cut(NamedTuple):
    """An oriented manifold made of a mesh.

    Attributes
    ----------
    mesh : Mesh
        With the faces in their order. Its first vertices are the mesh's, further copies follow.
    origin : (k,) int64
        Vertex of the mesh that each one is a copy of.
    turned : int
        Faces that run the other way round than in the mesh.
    """

    mesh: Mesh
    origin: np.ndarray
    turned: int


class _Pairs(NamedTuple):
    """Faces f and g that are joined at an edge, by its number."""

    f: np.ndarray
    g: np.ndarray
    edge: np.ndarray


def cut_to_manifold(mesh: Mesh) -> Cut:
    """Turn faces to agree with their neighbours, and cut where more than two meet or fans touch in a vertex.

    A mesh that is manifold and oriented comes back as it is. Of more than two
    faces at an edge, those two stay together that run through it in opposite
    directions and continue each other most straightly; among equals, those with
    the smaller inside between them, so that solids that touch along an edge come
    apart. A one-sided surface is cut open.

    Raises
    ------
    InputError
        When that leaves no manifold.
    """
    if mesh.is_manifold and mesh.is_oriented:
        return Cut(mesh, np.arange(mesh.n), 0)
    edges = sides_by_edge(mesh.F, mesh.n)
    flipped = faces_to_turn(mesh, edges)
    pairs = _joined(mesh, edges, flipped)
    while True:
        F, origin = _fans(mesh, edges, pairs)
        made = Mesh(mesh.V[origin], np.where(flipped[:, None], F[:, ::-1], F))
        if made.is_manifold and made.is_oriented:
            return Cut(made, origin, int(flipped.sum()))
        # Two pairs of an edge whose fans hang together around both of its ends.
        crowded = edges.faces[pairs.edge] > 2
        if not crowded.any():
            raise InputError("the mesh is not manifold, and cutting it there does not make it so; remesh it")
        pairs = _Pairs(*(column[~crowded] for column in pairs))


def faces_to_turn(mesh: Mesh, edges: EdgeSides) -> np.ndarray:
    """Find faces that, turned over, make neighbours run through their edge in opposite directions.

    Neighbours are two faces at an edge that has no third one. Of each sheet of neighbours the part
    of larger area stays. Neighbours on a surface with one side only go on disagreeing somewhere.

    Parameters
    ----------
    mesh : Mesh
    edges : EdgeSides
        Of its faces.

    Returns
    -------
    (m,) bool
    """
    tail, twin = mesh.F.ravel(), edges.twin
    # Two sides of an edge begin at the same vertex: one of their faces is turned against the other.
    same = (twin >= 0) & (tail == tail[twin])
    flipped, sheet = _turn_to_agree(twin.reshape(-1, 3), same.reshape(-1, 3))
    area = np.bincount(sheet, np.where(flipped, -1.0, 1.0) * mesh.face_areas)
    return flipped ^ (area < 0)[sheet]


@njit(cache=True, nogil=True)
def _turn_to_agree(twin, same):
    """Go from each sheet's first face over `twin` (m, 3) to all others; turn them where `same` says so."""
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


def _joined(mesh: Mesh, edges: EdgeSides, flipped: np.ndarray) -> _Pairs:
    """The faces that stay together once those `flipped` are turned."""
    face = edges.side // 3
    low = np.repeat(edges.ends[:, 0], edges.faces)
    forward = (mesh.F.ravel()[edges.side] == low) ^ flipped[face]  # from the smaller end to the larger
    two = np.flatnonzero(edges.faces == 2)
    first = edges.start[two]
    two, first = (a[forward[first] != forward[first + 1]] for a in (two, first))
    found = [(face[first], face[first + 1], two)]
    for e in np.flatnonzero(edges.faces > 2):
        own = slice(edges.start[e], edges.start[e + 1])
        pairs = _best_pairs(mesh, edges.ends[e], face[own], forward[own])
        found.append((*np.array(pairs, dtype=np.int64).reshape(-1, 2).T, np.full(len(pairs), e)))
    return _Pairs(*(np.concatenate(column) for column in zip(*found, strict=True)))


def _best_pairs(
    mesh: Mesh, ends: np.ndarray, faces: np.ndarray, forward: np.ndarray
) -> list[tuple[int, int]]:
    """Pairs of the faces at a crowded edge, the best first."""
    i, j = ends
    third = mesh.F[faces].sum(axis=1) - i - j
    along = mesh.V[j] - mesh.V[i]
    along = along / (np.linalg.norm(along) or 1.0)
    away = mesh.V[third] - mesh.V[i]
    away = away - np.outer(away @ along, along)
    length = np.linalg.norm(away, axis=1, keepdims=True)
    away = np.divide(away, length, out=np.zeros_like(away), where=length > 0)
    cosine = np.round(away @ away.T / SAME_COSINE)
    sine = np.einsum("ijk,k->ij", np.cross(away[:, None], away[None]), along)
    angle = np.arctan2(sine, away @ away.T) % (2 * np.pi)  # from a face to another one, about the edge
    ahead, back = np.flatnonzero(forward).tolist(), np.flatnonzero(~forward).tolist()
    choices = sorted((cosine[f, b], angle[b, f], f, b) for f in ahead for b in back)
    taken: set[int] = set()
    pairs = []
    for _, _, f, b in choices:
        if not taken & {f, b}:
            taken |= {f, b}
            pairs.append((int(faces[f]), int(faces[b])))
    return pairs


def _fans(mesh: Mesh, edges: EdgeSides, pairs: _Pairs) -> tuple[np.ndarray, np.ndarray]:
    """Faces (m, 3) over copies of the vertices, one a fan of joined faces, and whose copy each is."""
    links = []
    for end in edges.ends[pairs.edge].T:
        links.append([3 * f + (mesh.F[f] == end[:, None]).argmax(axis=1) for f in (pairs.f, pairs.g)])
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
