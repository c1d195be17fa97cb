"""OFF files: lines are kept as they are but for positions and normals."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sshade.errors import InputError
from sshade.io.decimals import edited, numbers_edited, numbers_of
from sshade.io.document import MeshFile, fanned, present
from sshade.io.normals import vertex_turns
from sshade.io.words import Lines, array_of, columns_of, integers_of, lines_of

#: The first word: texture coordinates, colours, normals at the vertices. A small n is another thing:
#: the number of coordinates.
_KEYWORD = re.compile(rb"(ST|st)?([Cc])?(N)?(?:OFF|off)$")


class _Numbers(NamedTuple):
    """Three numbers of each vertex, and where they stand: (n, 3)."""

    begin: np.ndarray
    end: np.ndarray
    value: np.ndarray


def read_off(path: Path) -> MeshFile:
    """Read an OFF file.

    Raises
    ------
    ValueError
        When it is no OFF, or holds fewer or more lines than it announces.
    InputError
        When there are no triangles.
    """
    data = path.read_bytes()
    text = array_of(data)
    lines = lines_of(text, comment=b"#")
    rows = lines.of(lines.key != 0)
    head = [data[begin:end].split() for begin, end in zip(rows.begin[:2], rows.end[:2], strict=True)]
    keyword = _KEYWORD.match(head[0][0]) if head else None
    if keyword is None:
        raise ValueError("it does not begin with OFF, or holds other than three coordinates a vertex")
    if len(head) < 2:
        raise ValueError("it ends after its first line")
    counts, begun = (head[0][1:], 1) if len(head[0]) > 1 else (head[1], 2)
    if len(counts) < 2:
        raise ValueError("it does not say how many vertices and faces it holds")
    n, m = int(counts[0]), int(counts[1])
    body = rows.of(slice(begun, None))
    if n < 0 or m < 0 or len(body.begin) != n + m:
        raise ValueError(f"{n} vertices and {m} faces are announced, {len(body.begin)} lines follow")
    vertices = body.of(slice(n))
    F, polygons, coloured = _faces(text, body.of(slice(n, None)))
    if not n or not len(F):
        raise InputError(f"{path}: the file holds no triangles")
    positions, words = _numbers(text, vertices, 0)
    normals = _numbers(text, vertices, 3)[0] if keyword[3] else None
    holds = present(
        texture_coordinates=keyword[1],
        normals=keyword[3],
        vertex_colours=keyword[2] or not keyword[1] and (words > (6 if normals else 3)).any(),
        face_colours=coloured,
        polygons=polygons,
        comments=b"#" in data,
    )
    return MeshFile(positions.value, F, holds, (".off",), partial(_content, text, positions, F, normals))


def _numbers(text: np.ndarray, lines: Lines, first: int) -> tuple[_Numbers, np.ndarray]:
    """Three numbers of each line, from word `first` on, and how many words it has."""
    begin, end, words = columns_of(text, lines, first, 3)
    short = np.flatnonzero(words < first + 3)
    if len(short):
        raise ValueError(f"vertex {short[0]} needs three coordinates{' and a normal' if first else ''}")
    return _Numbers(begin, end, numbers_of(text, begin, end)), words


def _faces(text: np.ndarray, lines: Lines) -> tuple[np.ndarray, bool, bool]:
    """(m, 3) triangles of the lines of polygons, whether some have more corners, and more words."""
    begin, end, words = columns_of(text, lines, 0, 1)
    size = integers_of(text, begin, end)[:, 0]
    short = np.flatnonzero((size < 3) | (words < size + 1))
    if len(short):
        raise ValueError(f"face {short[0]} is not complete")
    of_size = [(size == k).nonzero()[0] for k in np.unique(size).tolist()]
    polygons = [
        integers_of(text, *columns_of(text, lines.of(which), 1, int(size[which[0]]))[:2]) for which in of_size
    ]
    F = fanned(polygons, of_size)[0]
    return F, bool((size > 3).any()), bool((words > size + 1).any())


def _content(
    text: np.ndarray, positions: _Numbers, F: np.ndarray, normals: _Numbers | None, V: np.ndarray, path: Path
) -> bytes:
    edits = [numbers_edited(*positions, V)]
    if normals is not None:
        N = normals.value
        turned = np.einsum("kij,kj->ki", vertex_turns(N, F, positions.value, V), N)
        edits.append(numbers_edited(*normals, turned))
    return edited(text, edits)
