"""OFF files: positions and normals change, all other bytes stay."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sshade.core.errors import counted
from sshade.files.mesh_file import MeshFile, fanned, present
from sshade.files.numbers_in_text import Text, edited, without_comments
from sshade.mesh.normals import turned, vertex_turns

#: The first word: letters for texture coordinates, colours and normals of vertices, in any order. A small n
#: means something else: the number of coordinates.
_KEYWORD = re.compile(rb"((?:ST|st|[Cc]|N)*)(?:OFF|off)(\d*)$")


def read_off(path: Path) -> MeshFile:
    """Read an OFF file: a stream of numbers, or a vertex and a face on each line, with colours behind them.

    Raises
    ------
    ValueError
        When the file is no OFF file, or holds fewer or more numbers than it announces.
    """
    data = path.read_bytes()
    text = Text(without_comments(data))
    head = [text.words(line) for line in range(min(2, len(text.first)))]
    if head and b"BINARY" in head[0]:
        raise ValueError("it is a binary OFF file, and only texts are read; save it as text")
    keyword = _KEYWORD.match(head[0][0]) if head else None
    if keyword is None:
        raise ValueError("it does not begin with OFF, or its vertices do not have three coordinates each")
    letters = keyword[1].upper()
    rows = _rows(text, keyword[2], 3 + 3 * (b"N" in letters) + 4 * (b"C" in letters) + 2 * (b"ST" in letters))
    positions = text.numbers(rows.vertices[:, None] + np.arange(3))
    F, polygons, face_colours = _faces(text, rows)
    textured, coloured, at, size = b"ST" in letters, b"C" in letters, 3, rows.vertex_size
    if letters.startswith(b"NC"):  # MeshLab writes the normals behind the colours, Geomview (CN) before them
        width = int(size[0]) if len(size) else 11
        at = width - (5 if textured else 3)
        if at < 6 or (size != width).any():
            raise ValueError("its vertices do not all have a colour and a normal")
    normals = None
    if b"N" in letters:
        if (size < at + 3).any():
            raise ValueError("its vertices do not all have a normal")
        normals = text.numbers(rows.vertices[:, None] + at + np.arange(3))
    holds = present(
        texture_coordinates=textured,
        normals=normals,
        vertex_colours=coloured or not textured and (size > (6 if normals else 3)).any(),
        face_colours=face_colours,
        polygons=polygons,
        comments=b"#" in data,
    )

    def content(V: np.ndarray, path: Path) -> bytes:
        edits = [positions.edits(V)]
        if normals is not None:
            Q = vertex_turns(normals.value, F, positions.value, V)
            edits.append(normals.edits(turned(Q, normals.value)))
        return edited(data, edits)

    return MeshFile(positions.value, F, holds, (".off",), content)


class _Rows(NamedTuple):
    """First words of the vertices (n,) and the faces (m,), and how many words each has."""

    vertices: np.ndarray
    vertex_size: np.ndarray
    faces: np.ndarray
    face_size: np.ndarray


def _rows(text: Text, glued: bytes, width: int) -> _Rows:
    """Find the vertices and the faces behind the first word, to which files of ModelNet glue the first count.

    In a stream, whose rows are no lines, vertices have `width` words and faces no colours.
    """
    words = [glued] * bool(glued) + [text.word(i) for i in range(1, min(4, len(text.begin)))]
    if len(words) < 2 or not (words[0].isdigit() and words[1].isdigit()):
        raise ValueError("it does not say how many vertices and faces it holds")
    n, m, line = int(words[0]), int(words[1]), 1 if glued or text.size[0] > 1 else 2
    if len(text.first) - line == n + m:
        first, size = text.first[line:], text.size[line:]
        if (size[:n] < 3).any():
            short = line + int(np.argmax(size[:n] < 3))
            raise ValueError(f"line {text.line_number(short)}: a vertex needs three coordinates")
        return _Rows(first[:n], size[:n], first[n:], size[n:])
    begin, end = 4 - bool(glued), len(text.begin)
    starts = [begin + width * n]
    while len(starts) <= m and starts[-1] < end and (size := text.word(starts[-1])).isdigit():
        starts.append(starts[-1] + 1 + int(size))
    if starts[-1] != end or len(starts) != m + 1:
        announced = f"{counted(n, 'vertex', 'vertices')} and {counted(m, 'face', 'faces')} are announced"
        on_lines = counted(len(text.first) - line, "line", "lines")
        raise ValueError(f"{announced}, {counted(end - begin, 'number', 'numbers')} on {on_lines} follow")
    faces = np.array(starts)
    return _Rows(begin + width * np.arange(n), np.full(n, width), faces[:-1], np.diff(faces))


def _faces(text: Text, rows: _Rows) -> tuple[np.ndarray, bool, bool]:
    """Return the triangles (m, 3), and whether some faces are larger polygons or have colours."""
    first, words = rows.faces, rows.face_size
    size = text.integers(text.begin[first], text.end[first])
    short = first[(size < 3) | (words < size + 1)]
    if len(short):
        line = int(np.searchsorted(text.first, short[0], side="right")) - 1
        number = text.line_number(line)
        raise ValueError(f"line {number}: a face needs at least three vertices and as many as it announces")
    of_size = [(size == k).nonzero()[0] for k in np.unique(size).tolist()]
    polygons = []
    for faces in of_size:
        corners = first[faces, None] + 1 + np.arange(size[faces[0]])
        polygons.append(text.integers(text.begin[corners], text.end[corners]))
    F = fanned(polygons, of_size)[0]
    return F, bool((size > 3).any()), bool((words > size + 1).any())
