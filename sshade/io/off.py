"""OFF files: positions and normals change, all other bytes stay."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import numpy as np

from sshade.errors import InputError
from sshade.io.decimals import Numbers, edited, vectors_of
from sshade.io.document import MeshFile, fanned, present
from sshade.io.normals import vertex_turns
from sshade.io.words import Lines, array_of, columns_of, integers_of, line_number, lines_of

#: The first word: letters for texture coordinates, colours and normals of vertices. A small n means
#: something else: the number of coordinates.
_KEYWORD = re.compile(rb"(ST|st)?([Cc])?(N)?(?:OFF|off)$")


def read_off(path: Path) -> MeshFile:
    """Read an OFF file.

    Raises
    ------
    ValueError
        When the file is no OFF file, or the number of lines differs from the announced one.
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
    F, polygons, face_colours = _faces(text, body.of(slice(n, None)))
    if not n or not len(F):
        raise InputError(f"{path}: the file holds no triangles")
    positions, words = vectors_of(text, vertices, 0, "a vertex")
    normals = vectors_of(text, vertices, 3, "a normal")[0] if keyword[3] else None
    holds = present(
        texture_coordinates=keyword[1],
        normals=keyword[3],
        vertex_colours=keyword[2] or not keyword[1] and (words > (6 if normals else 3)).any(),
        face_colours=face_colours,
        polygons=polygons,
        comments=b"#" in data,
    )
    return MeshFile(positions.value, F, holds, (".off",), partial(_content, text, positions, F, normals))


def _faces(text: np.ndarray, lines: Lines) -> tuple[np.ndarray, bool, bool]:
    """Return the triangles (m, 3), and whether some faces are larger polygons or have colours."""
    begin, end, words = columns_of(text, lines.begin, lines.end, 0, 1)
    size = integers_of(text, begin, end)[:, 0]
    short = np.flatnonzero((size < 3) | (words < size + 1))
    if len(short):
        number = line_number(text, lines.begin[short[0]])
        raise ValueError(f"line {number}: a face needs at least three vertices and as many as it announces")
    of_size = [(size == k).nonzero()[0] for k in np.unique(size).tolist()]
    polygons = []
    for faces in of_size:
        begin, end, _ = columns_of(text, lines.begin[faces], lines.end[faces], 1, size[faces[0]])
        polygons.append(integers_of(text, begin, end))
    F = fanned(polygons, of_size)[0]
    return F, bool((size > 3).any()), bool((words > size + 1).any())


def _content(
    text: np.ndarray, positions: Numbers, F: np.ndarray, normals: Numbers | None, V: np.ndarray, path: Path
) -> bytes:
    edits = [positions.edits(V)]
    if normals is not None:
        N = normals.value
        turned = np.einsum("kij,kj->ki", vertex_turns(N, F, positions.value, V), N)
        edits.append(normals.edits(turned))
    return edited(text, edits)
