"""OFF files: positions and normals change, all other bytes stay."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from sshade.core.errors import InputError
from sshade.files.mesh_file import MeshFile, fanned, present
from sshade.files.normals import turned, vertex_turns
from sshade.files.words import Text, edited, without_comments

#: The first word: letters for texture coordinates, colours and normals of vertices, in any order. A small n
#: means something else: the number of coordinates.
_KEYWORD = re.compile(rb"((?:ST|st|[Cc]|N)*)(?:OFF|off)(\d*)$")


def read_off(path: Path) -> MeshFile:
    """Read an OFF file.

    Raises
    ------
    ValueError
        When the file is no OFF file, or the number of lines differs from the announced one.
    InputError
        When the file is binary.
    """
    data = path.read_bytes()
    text = Text(without_comments(data))
    head = [text.words(line) for line in range(min(2, len(text.first)))]
    keyword = _KEYWORD.match(head[0][0]) if head else None
    if keyword is None:
        raise ValueError("it does not begin with OFF, or its vertices do not have three coordinates each")
    if b"BINARY" in head[0]:
        raise InputError(f"{path}: it is a binary OFF file; write it as text, or in another format")
    if len(head) < 2:
        raise ValueError("it ends after its first line")
    first = [keyword[2]] * bool(keyword[2]) + head[0][1:]  # files of ModelNet lack the end of the first line
    counts, begun = (first, 1) if first else (head[1], 2)
    if len(counts) < 2:
        raise ValueError("it does not say how many vertices and faces it holds")
    n, m = int(counts[0]), int(counts[1])
    body = np.arange(begun, len(text.first))
    if n < 0 or m < 0 or len(body) != n + m:
        raise ValueError(f"{n} vertices and {m} faces are announced, {len(body)} lines follow")
    vertices = body[:n]
    F, polygons, face_colours = _faces(text, body[n:])
    positions = text.vectors(vertices, 0, "a vertex")
    letters, size = keyword[1].upper(), text.size[vertices]
    textured, coloured, at = b"ST" in letters, b"C" in letters, 3
    if letters.startswith(b"NC"):  # MeshLab writes the normals behind the colours, Geomview (CN) before them
        width = int(size[0]) if n else 11
        at = width - (5 if textured else 3)
        if at < 6 or (size != width).any():
            raise ValueError("its vertices do not all have a colour and a normal")
    normals = text.vectors(vertices, at, "a normal") if b"N" in letters else None
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


def _faces(text: Text, lines: np.ndarray) -> tuple[np.ndarray, bool, bool]:
    """Return the triangles (m, 3), and whether some faces are larger polygons or have colours."""
    first, words = text.first[lines], text.size[lines]
    size = text.integers(text.begin[first], text.end[first])
    short = lines[(size < 3) | (words < size + 1)]
    if len(short):
        number = text.line_number(short[0])
        raise ValueError(f"line {number}: a face needs at least three vertices and as many as it announces")
    of_size = [(size == k).nonzero()[0] for k in np.unique(size).tolist()]
    polygons = []
    for faces in of_size:
        corners = first[faces, None] + 1 + np.arange(size[faces[0]])
        polygons.append(text.integers(text.begin[corners], text.end[corners]))
    F = fanned(polygons, of_size)[0]
    return F, bool((size > 3).any()), bool((words > size + 1).any())
