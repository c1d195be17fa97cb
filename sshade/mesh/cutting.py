"""Cutting a triangle mesh into an oriented manifold: copies of vertices where faces do not hang together.

Two faces stay joined at an edge that is theirs alone, or that they share with
others but continue each other best; everywhere else the surface is cut. Only
a copy is changed, and :attr:`Cut.origin` leads back.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sshade.errors import InputError
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


class _Edges(NamedTuple):
    """Sides of faces, gathered by edge.

    Attributes
    ----------
    ends : (e, 2) int
        Vertices of each edge, the smaller one first.
    start : (e + 1,) int
        Where its sides begin.
    face : (3m,) int
        Face of each side.
    forward : (3m,) bool
        Whether it runs from the smaller vertex to the larger one.
    """

    ends: np.ndarray
    start: np.ndarray
    face: np.ndarray
    forward: np.ndarray


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
    edges = _edges(mesh)
    flipped = _orientation(mesh, edges)
    forward = edges.forward ^ flipped[edges.face]
    pairs = _joined(mesh, edges, forward)
    while True:
        F, origin = _fans(mesh, edges, pairs)
        made = Mesh(mesh.V[origin], np.where(flipped[:, None], F[:, ::-1], F))
        if made.is_manifold and made.is_oriented:
            return Cut(made, origin, int(flipped.sum()))
        # Two pairs of an edge whose fans hang together around both of its ends.
        crowded = np.diff(edges.start)[pairs.edge] > 2
        if not crowded.any():
            raise InputError("the mesh is not manifold, and cutting it there does not make it so; remesh it")
        pairs = _Pairs(*(column[~crowded] for column in pairs))


def _edges(mesh: Mesh) -> _Edges:
    tail, head = mesh.F.ravel(), mesh.F[:, [1, 2, 0]].ravel()
    low, high = np.minimum(tail, head), np.maximum(tail, head)
    side = np.argsort(low * mesh.n + high, kind="stable")
    low, high = low[side], high[side]
    new = np.ones(len(side), dtype=bool)
    new[1:] = (low[1:] != low[:-1]) | (high[1:] != high[:-1])
    first = np.flatnonzero(new)
    return _Edges(
        ends=np.stack([low[first], high[first]], axis=1),
        start=np.append(first, len(side)),
        face=side // 3,
        forward=(tail < head)[side],
    )


def _orientation(mesh: Mesh, edges: _Edges) -> np.ndarray:
    """(m,) bool: faces to turn so that neighbours agree at edges of two; the larger part of a sheet stays."""
    first = edges.start[:-1][np.diff(edges.start) == 2]
    f, g = edges.face[first], edges.face[first + 1]
    same = edges.forward[first] == edges.forward[first + 1]
    tail, head = np.concatenate([f, g]), np.concatenate([g, f])
    order = np.argsort(tail, kind="stable")
    start = np.searchsorted(tail[order], np.arange(mesh.m + 1))
    flipped, sheet = _turn_to_agree(start, head[order], np.tile(same, 2)[order])
    area = np.bincount(sheet, np.where(flipped, -1.0, 1.0) * mesh.face_areas)
    return flipped ^ (area < 0)[sheet]


@njit(cache=True, nogil=True)
def _turn_to_agree(start, neighbour, same):
    """Face by face from the first of each sheet; `same`: two neighbours run through their edge alike."""
    m = len(start) - 1
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
            for p in range(start[f], start[f + 1]):
                g = neighbour[p]
                if sheet[g] == -1:
                    sheet[g], flipped[g] = sheets, flipped[f] ^ same[p]
                    queue[known] = g
                    known += 1
        sheets += 1
    return flipped, sheet


def _joined(mesh: Mesh, edges: _Edges, forward: np.ndarray) -> _Pairs:
    """The faces that stay together, for sides that run `forward` or not."""
    count = np.diff(edges.start)
    two = np.flatnonzero(count == 2)
    first = edges.start[two]
    two, first = (a[forward[first] != forward[first + 1]] for a in (two, first))
    found = [(edges.face[first], edges.face[first + 1], two)]
    for e in np.flatnonzero(count > 2):
        own = slice(edges.start[e], edges.start[e + 1])
        pairs = _best_pairs(mesh, edges.ends[e], edges.face[own], forward[own])
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


def _fans(mesh: Mesh, edges: _Edges, pairs: _Pairs) -> tuple[np.ndarray, np.ndarray]:
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
