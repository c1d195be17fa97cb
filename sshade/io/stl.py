"""STL files, text or binary: positions and facet normals change, all else stays as it is."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sshade.errors import InputError
from sshade.io.decimals import edited, numbers_edited, numbers_of
from sshade.io.document import MeshFile, present
from sshade.io.normals import turns
from sshade.io.words import Lines, array_of, columns_of, key_of, lines_of

#: A facet of a binary STL.
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
#: Keywords of a text STL between those of a solid; none has more letters than a key.
_WORDS = (b"facet", b"outer", b"vertex", b"endloop", b"endfacet")


class _Solid(NamedTuple):
    """The numbers of a text and where they stand: of each facet the normal, then its corners, (m, 4, 3)."""

    text: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    value: np.ndarray


def read_stl(path: Path) -> MeshFile:
    """Read an STL file: three vertices of its own for each face.

    Raises
    ------
    ValueError
        When it is no STL, or ends early.
    InputError
        When there are no triangles, or several solids.
    """
    data = path.read_bytes()
    count = int.from_bytes(data[80:84], "little") if len(data) >= 84 else -1
    if len(data) == 84 + _FACET.itemsize * count:
        facets = np.frombuffer(data, _FACET, count, 84)
        V = facets["corners"].reshape(-1, 3).astype(np.float64)
        content = partial(_binary, data[:84], facets, V)
        holds = present(facet_attributes=facets["attribute"].any())
    elif data.lstrip()[:5].lower() == b"solid":
        solid = _text_solid(array_of(data), path)
        V = solid.value[:, 1:].reshape(-1, 3)
        content, holds = partial(_text, solid), ()
    else:
        raise ValueError("it is neither a text that begins with solid, nor as long as its header says")
    if len(V) == 0:
        raise InputError(f"{path}: the file holds no triangles")
    return MeshFile(V, np.arange(len(V)).reshape(-1, 3), holds, (".stl",), content)


def _text_solid(text: np.ndarray, path: Path) -> _Solid:
    """The numbers of the one solid of a text."""
    every = lines_of(text, fold=True)
    number = np.flatnonzero(every.key)
    lines = every if len(number) == len(every.key) else every.of(number)
    key = lines.key
    solid, facet, vertex = (key == key_of(word) for word in (b"solid", b"facet", b"vertex"))
    inside = np.cumsum(solid) > np.cumsum(key == key_of(b"endsolid"))
    known = solid | (key == key_of(b"endsolid"))
    for word in _WORDS:
        known |= (key == key_of(word)) & inside
    wrong = np.flatnonzero(~known)
    if len(wrong):
        words = text[lines.begin[wrong[0]] : lines.end[wrong[0]]].tobytes().decode("latin-1").split()
        raise ValueError(f"line {number[wrong[0]] + 1} is not understood: {' '.join(words)[:60]!r}")
    corner_words = _words(text, lines, vertex, number, first=1, what="a vertex")
    normal_words = _words(text, lines, facet, number, first=2, what="a normal")
    loops = np.flatnonzero(key == key_of(b"endloop"))
    uneven = loops[np.cumsum(vertex)[loops] != 3 * np.cumsum(facet)[loops]]
    if len(uneven):
        raise ValueError(f"line {number[uneven[0]] + 1}: a facet has no three vertices")
    m = len(normal_words[0])
    if inside[-1] or len(corner_words[0]) != 3 * m:
        raise ValueError("it ends within a solid")
    if solid.sum() > 1:
        raise InputError(f"{path}: the file holds {solid.sum()} meshes; give one mesh a file")
    begin, end = (
        np.concatenate([normals[:, None], corners.reshape(m, 3, 3)], axis=1)
        for normals, corners in zip(normal_words, corner_words, strict=True)
    )
    return _Solid(text, begin, end, numbers_of(text, begin, end))


def _words(
    text: np.ndarray, lines: Lines, which: np.ndarray, number: np.ndarray, *, first: int, what: str
) -> tuple[np.ndarray, np.ndarray]:
    """Where the three numbers of each line (k, 3) begin and end."""
    begin, end, words = columns_of(text, lines.of(which), first, 3)
    short = np.flatnonzero(words < first + 3 if first == 2 else words != first + 3)
    if len(short):
        raise ValueError(f"line {number[which][short[0]] + 1}: {what} needs three coordinates")
    return begin, end


def _turned(N: np.ndarray, rest: np.ndarray, V: np.ndarray) -> np.ndarray:
    """Facet normals (m, 3) for positions V (3m, 3); one of zeros, which many programs write, stays that."""
    F = np.arange(len(rest)).reshape(-1, 3)
    return np.einsum("kij,kj->ki", turns(np.repeat(np.arange(len(N))[:, None], 3, axis=1), F, rest, V), N)


def _binary(head: bytes, facets: np.ndarray, rest: np.ndarray, V: np.ndarray, path: Path) -> bytes:
    facets = facets.copy()
    facets["normal"] = _turned(facets["normal"].astype(np.float64), rest, V)
    facets["corners"] = V.reshape(-1, 3, 3)
    return head + facets.tobytes()


def _text(solid: _Solid, V: np.ndarray, path: Path) -> bytes:
    text, begin, end, old = solid
    N, rest = old[:, 0], old[:, 1:].reshape(-1, 3)
    new = np.concatenate([_turned(N, rest, V)[:, None], V.reshape(-1, 3, 3)], axis=1)
    return edited(text, [numbers_edited(begin, end, old, new)])
