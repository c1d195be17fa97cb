"""Normals of OBJ files, which turn with the surface."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sshade.files.numbers_in_text import Edits, Numbers
from sshade.mesh.normals import smooth_groups, turned, turns
from sshade.mesh.places import same_rows

#: Decimal places of written normals.
DECIMALS = 6


class Corners(NamedTuple):
    """Corners of all polygons, (c,) arrays in the order of the file.

    Attributes
    ----------
    vertex, normal : int64
        Ids from 0; -1 for a corner without a normal, or whose normal the file does not declare.
    begin, end : int64
        Places where the number of the corner's normal begins and ends.
    number : int64
        Number of the normal in the file, from 1, or from -1 backwards from the face; 0 for no number.
    """

    vertex: np.ndarray
    normal: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    number: np.ndarray


class Obj(NamedTuple):
    """The parts of an OBJ file that change with its positions.

    Attributes
    ----------
    data : bytes
    positions, normals : Numbers
    corners : Corners
    triangles : (m, 3) int64
        Numbers of corners.
    libraries : (2, l) int64
        Bytes where lines "mtllib" and the lines behind them begin.
    newline : str
    """

    data: bytes
    positions: Numbers
    normals: Numbers
    corners: Corners
    triangles: np.ndarray
    libraries: np.ndarray
    newline: str


def turned_normals(obj: Obj, V: np.ndarray) -> list[Edits]:
    """Turn normals with the surface.

    Programs write equal normals once. Where the vertices that share a normal turn differently, further
    lines follow the line of the normal, and the faces are numbered anew.
    """
    corners, rest, N = obj.corners, obj.positions.value, obj.normals.value
    shaded = np.flatnonzero(corners.normal >= 0)
    if not len(shaded):
        return []
    pair_of, vertex, normal = _pairs(corners.vertex[shaded], corners.normal[shaded], len(rest))
    alike, one = smooth_groups(V[vertex], N[normal])
    group = np.full(len(corners.vertex), -1)
    group[shaded] = alike[pair_of]
    Q = turns(group[obj.triangles], N[normal[one]], corners.vertex[obj.triangles], rest, V)
    new = turned(Q[alike], N[normal])
    unchanged = ((new == N[normal]) | np.isnan(new)).all(axis=1)
    new = np.where(unchanged[:, None], N[normal], np.round(new, DECIMALS) + 0.0)
    variant = same_rows(np.column_stack([normal, new]))
    _, one = np.unique(variant, return_index=True)
    order = np.argsort(normal[one], kind="stable")  # the order in which variants are written
    line_of, value = normal[one][order], new[one][order]
    written = np.bincount(line_of, minlength=len(N))
    edits = [_variants(obj, line_of, value)]
    if (written > 1).any():
        place = np.empty(len(order), dtype=np.int64)
        place[order] = np.arange(len(order)) + (np.cumsum(written == 0) - (written == 0))[line_of]
        # Numbers without a normal stay without one.
        number = corners.number
        new = number + np.sign(number) * np.maximum(written - 1, 0).sum()
        new[shaded] = place[variant[pair_of]] + 1
        numbered = number != 0
        numbers = Numbers(corners.begin[numbered], corners.end[numbered], number[numbered])
        edits.append(numbers.edits(new[numbered]))
    return edits


def _pairs(vertex: np.ndarray, normal: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Collect the distinct pairs of a vertex and a normal.

    Returns
    -------
    pair : (c,) int64
        Pair of each corner.
    vertex, normal : (p,) int64
        Members of each pair.
    """
    last = np.full(n, -1)
    last[vertex] = normal
    if (last[vertex] == normal).all():  # each vertex has one normal, the usual case
        used = last >= 0
        return (np.cumsum(used) - 1)[vertex], np.flatnonzero(used), last[used]
    pair = same_rows(np.column_stack([vertex, normal]))
    _, one = np.unique(pair, return_index=True)
    return pair, vertex[one], normal[one]


def _variants(obj: Obj, line_of: np.ndarray, value: np.ndarray) -> Edits:
    """Write normals (w, 3) to their lines (w,), ascending; further normals of a line get lines behind it."""
    normals, further = obj.normals, f"{obj.newline}vn "
    first = np.flatnonzero(np.diff(line_of, prepend=-1))
    lines, rows = line_of[first], [" ".join(map(repr, row)) for row in value.tolist()]
    end = np.append(first[1:], len(rows))
    old = normals.value[lines]
    changes = (end - first > 1) | ((value[first] != old) & ~np.isnan(old)).any(axis=1)
    texts = [
        further.join(rows[a:b]) for a, b in zip(first[changes].tolist(), end[changes].tolist(), strict=True)
    ]
    return Edits(normals.begin[lines[changes], 0], normals.end[lines[changes], 2], texts)
