"""OFF files: lines are kept as they are but for positions and normals."""

from __future__ import annotations

import re
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from sshade.errors import InputError
from sshade.io.document import MeshFile, present, with_numbers
from sshade.io.normals import vertex_turns

#: The first word: texture coordinates, colours, normals at the vertices. A small n is another thing:
#: the number of coordinates.
_KEYWORD = re.compile(rb"(ST|st)?([Cc])?(N)?(?:OFF|off)$")


def read_off(path: Path) -> MeshFile:
    """Read an OFF file.

    Raises
    ------
    ValueError
        When it is no OFF, or holds fewer or more lines than it announces.
    InputError
        When there are no triangles.
    """
    lines = path.read_bytes().splitlines(keepends=True)
    rows = [(line, words) for line, words in enumerate(map(_words, lines)) if words]
    keyword = _KEYWORD.match(rows[0][1][0]) if rows else None
    if keyword is None:
        raise ValueError("it does not begin with OFF, or holds other than three coordinates a vertex")
    if len(rows) < 2:
        raise ValueError("it ends after its first line")
    first = rows[0][1]
    counts, body = (first[1:], rows[1:]) if len(first) > 1 else (rows[1][1], rows[2:])
    if len(counts) < 2:
        raise ValueError("it does not say how many vertices and faces it holds")
    n, m = int(counts[0]), int(counts[1])
    if n < 0 or m < 0 or len(body) != n + m:
        raise ValueError(f"{n} vertices and {m} faces are announced, {len(body)} lines follow")
    polygons = [_polygon(number, words) for number, (_, words) in enumerate(body[n:])]
    triangles = [(ids[0], b, c) for ids in polygons for b, c in pairwise(ids[1:])]
    if not n or not triangles:
        raise InputError(f"{path}: the file holds no triangles")
    V = np.array([_numbers(i, words, 0) for i, (_, words) in enumerate(body[:n])])
    N = np.array([_numbers(i, words, 3) for i, (_, words) in enumerate(body[:n])]) if keyword[3] else None
    plain = 3 if N is None else 6
    holds = present(
        texture_coordinates=keyword[1],
        normals=keyword[3],
        vertex_colours=keyword[2] or not keyword[1] and any(len(words) > plain for _, words in body[:n]),
        face_colours=any(len(words) > int(words[0]) + 1 for _, words in body[n:]),
        polygons=any(len(ids) > 3 for ids in polygons),
        comments=any(b"#" in line for line in lines),
    )
    F = np.array(triangles, dtype=np.int64)
    places = [line for line, _ in body[:n]]
    return MeshFile(V, F, holds, (".off",), partial(_content, lines, places, V, F, N))


def _words(line: bytes) -> list[bytes]:
    return line.split(b"#", 1)[0].split()


def _numbers(vertex: int, words: list[bytes], first: int) -> list[float]:
    numbers = [float(word) for word in words[first : first + 3]]
    if len(numbers) < 3:
        raise ValueError(f"vertex {vertex} needs three coordinates{' and a normal' if first else ''}")
    return numbers


def _polygon(number: int, words: list[bytes]) -> list[int]:
    ids = [int(word) for word in words[1 : int(words[0]) + 1]]
    if len(ids) < max(3, int(words[0])):
        raise ValueError(f"face {number} is not complete")
    return ids


def _content(
    lines: list[bytes],
    places: list[int],
    rest: np.ndarray,
    F: np.ndarray,
    N: np.ndarray | None,
    V: np.ndarray,
    path: Path,
) -> bytes:
    lines = list(lines)
    for place, old, new in zip(places, rest.tolist(), V.tolist(), strict=True):
        lines[place] = with_numbers(lines[place], 0, old, new)
    if N is not None:
        turned = np.einsum("kij,kj->ki", vertex_turns(N, F, rest, V), N)
        for place, old, new in zip(places, N.tolist(), turned.tolist(), strict=True):
            lines[place] = with_numbers(lines[place], 3, old, new)
    return b"".join(lines)
