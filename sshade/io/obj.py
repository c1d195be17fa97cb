"""OBJ files: lines are kept as they are but for positions and normals.

What a file says of texture, normals, colours, groups and materials splits no vertex.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sshade.errors import InputError
from sshade.io.decimals import DOUBLE, INTEGER, NOTHING, Edits, edited, numbers_edited, numbers_of
from sshade.io.document import MeshFile, fanned, moved_reference, present
from sshade.io.normals import turns
from sshade.io.words import (
    Lines,
    array_of,
    columns_of,
    integers_of,
    joined,
    key_of,
    lines_of,
    parts_of,
    words_in,
)
from sshade.mesh.seams import same_rows

#: Decimals of normals that are written.
DECIMALS = 6


class _Vectors(NamedTuple):
    """Three numbers of each line of a kind (k, 3), where they stand, and where the line begins (k,)."""

    begin: np.ndarray
    end: np.ndarray
    value: np.ndarray
    line: np.ndarray


class _Corners(NamedTuple):
    """Corners of the polygons (c,), in the order of the file.

    `vertex` and `normal` (or -1), where the number of the normal stands, whether it is `relative`, and
    how many normals are above the face, which relative numbers count from.
    """

    vertex: np.ndarray
    normal: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    relative: np.ndarray
    above: np.ndarray


class _Obj(NamedTuple):
    """A file: its bytes, its numbers, its triangles as numbers of corners, places of its lines mtllib.

    `normal_ends` (k,) is where the line after each normal begins, if there were a newline at the end.
    """

    text: np.ndarray
    positions: _Vectors
    normals: _Vectors
    normal_ends: np.ndarray
    corners: _Corners
    triangles: np.ndarray
    libraries: list[tuple[int, int]]


def read_obj(path: Path) -> MeshFile:
    """Read an OBJ file.

    Raises
    ------
    ValueError
        On a vertex, a normal or a face that is not complete.
    InputError
        When there are no triangles.
    """
    data = path.read_bytes()
    whole = array_of(data)
    text = joined(whole)
    lines = lines_of(text)
    positions, words = _vectors(text, lines.of(lines.key == key_of(b"v")), "a vertex")
    normals, _ = _vectors(text, lines.of(lines.key == key_of(b"vn")), "a normal")
    corners, triangles, sizes = _faces(text, lines.of(lines.key == key_of(b"f")), positions, normals)
    if not len(positions.line) or not len(triangles):
        raise InputError(f"{path}: the file holds no triangles")
    if corners.normal.max() >= len(normals.line):
        raise ValueError(f"a face refers to a normal outside 1..{len(normals.line)}")
    keys = set(np.unique(lines.key).tolist())
    known = (b"vt", b"mtllib", b"usemtl", b"g", b"o", b"s", b"l", b"p")
    there = {name for name in known if key_of(name) in keys}
    holds = present(
        texture_coordinates=b"vt" in there,
        normals=len(normals.line),
        vertex_colours=(words >= 7).any(),
        materials=there & {b"mtllib", b"usemtl"},
        groups=there & {b"g", b"o"},
        smoothing_groups=b"s" in there,
        polygons=(sizes > 3).any(),
        lines_and_points=there & {b"l", b"p"},
        comments=any(key & 0xFF == ord("#") for key in keys),
    )
    ends = np.append(lines.begin[1:], len(text) + (not _ended(text)))
    mtllib = lines.key == key_of(b"mtllib")
    libraries = list(zip(lines.begin[mtllib].tolist(), ends[mtllib].tolist(), strict=True))
    normal_ends = ends[lines.key == key_of(b"vn")]
    obj = _Obj(whole, positions, normals, normal_ends, corners, triangles, libraries)
    F = corners.vertex[triangles]
    return MeshFile(positions.value, F, holds, (".obj",), partial(_content, obj, path))


def _ended(text: np.ndarray) -> bool:
    """Whether the last line has an end."""
    return text[-1] in (10, 13)


def _number(text: np.ndarray, place: int) -> int:
    """Of the line that begins at a place, from 1."""
    return text[:place].tobytes().count(b"\n") + 1


def _vectors(text: np.ndarray, lines: Lines, what: str) -> tuple[_Vectors, np.ndarray]:
    """The three numbers that follow the first word of each line, and how many words it has."""
    begin, end, words = columns_of(text, lines, 1, 3)
    short = np.flatnonzero(words < 4)
    if len(short):
        raise ValueError(f"line {_number(text, lines.begin[short[0]])}: {what} needs three coordinates")
    return _Vectors(begin, end, numbers_of(text, begin, end), lines.begin), words


def _faces(
    text: np.ndarray, lines: Lines, positions: _Vectors, normals: _Vectors
) -> tuple[_Corners, np.ndarray, np.ndarray]:
    """Corners, triangles (m, 3) of numbers of corners, and how many corners each polygon has."""
    begin, end, sizes = words_in(text, lines, 1)
    if (sizes < 3).any():
        _refuse_face(text, lines.begin, sizes < 3)
    first = np.cumsum(sizes) - sizes
    which = [np.flatnonzero(sizes == size) for size in np.unique(sizes)]
    polygons = [first[own, None] + np.arange(sizes[own[0]]) for own in which]
    face = np.repeat(np.arange(len(sizes)), sizes)
    line = lines.begin[face]
    vertex = integers_of(text, *parts_of(text, begin, end, 0))
    begin, end = parts_of(text, begin, end, 2)
    shaded = np.flatnonzero(begin < end)
    normal = np.zeros(len(begin), dtype=np.int64)
    normal[shaded] = integers_of(text, begin[shaded], end[shaded])
    none = vertex == 0
    none[shaded] |= normal[shaded] == 0
    if none.any():
        _refuse_face(text, line, none)
    above = np.searchsorted(normals.line, lines.begin)[face]
    vertex += np.where(vertex > 0, -1, np.searchsorted(positions.line, lines.begin)[face])
    relative = normal < 0
    normal += np.where(relative, above, -1)
    if (normal[shaded] < 0).any():
        number = _number(text, line[shaded][normal[shaded] < 0][0])
        raise ValueError(f"line {number}: there are not so many normals above it")
    normal[begin == end] = -1
    return _Corners(vertex, normal, begin, end, relative, above), fanned(polygons, which)[0], sizes


def _refuse_face(text: np.ndarray, line: np.ndarray, wrong: np.ndarray) -> None:
    number = _number(text, line[wrong][0])
    raise ValueError(f"line {number}: a face needs three vertices, counted from 1")


def _content(obj: _Obj, source: Path, V: np.ndarray, path: Path) -> bytes:
    begin, end, rest, _ = obj.positions
    edits = [numbers_edited(begin, end, rest, V)]
    text = obj.text if _ended(obj.text) else np.append(obj.text, np.uint8(10))
    if len(obj.normals.line):
        edits += _turned_normals(obj, V)
    for begin_of, end_of in obj.libraries:
        line = obj.text[begin_of:end_of].tobytes()
        moved = _library(line, source, path)
        if moved != line:  # it is copied from behind the end of the text
            places = [np.array(p) for p in ([begin_of] * 2, [begin_of, len(text) + len(moved)])]
            resume = np.array([len(text), end_of])
            edits.append(Edits(places[0], places[1], resume, np.zeros(2, dtype=np.uint8), np.zeros(2)))
            text = np.concatenate([text, array_of(moved)])
    return edited(text, edits, size=len(obj.text))


def _library(line: bytes, source: Path, path: Path) -> bytes:
    """A line mtllib with the names as `path` has to give them; one name may have spaces."""
    rest = line.split(None, 1)[1:]
    text = rest[0].strip().decode("utf-8", "surrogateescape") if rest else ""
    names = [text] if (source.parent / text).is_file() else text.split()
    moved = [moved_reference(name, source, path) for name in names]
    if moved == names:
        return line
    end = line[len(line.rstrip()) :]
    return b"mtllib " + " ".join(moved).encode("utf-8", "surrogateescape") + end


def _turned_normals(obj: _Obj, V: np.ndarray) -> list[Edits]:
    """Turn normals with the surface.

    Programs write equal normals once. Where the places that share one turn differently, further lines
    follow its own, and faces count anew.
    """
    corners, rest, N = obj.corners, obj.positions.value, obj.normals.value
    shaded = np.flatnonzero(corners.normal >= 0)
    if not len(shaded):
        return []
    pair_of, vertex, normal = _pairs(corners.vertex[shaded], corners.normal[shaded], len(rest))
    alike = same_rows(np.column_stack([rest[vertex], V[vertex], N[normal]]))
    group = np.full(len(corners.vertex), -1)
    group[shaded] = alike[pair_of]
    Q = turns(group[obj.triangles], corners.vertex[obj.triangles], rest, V)
    new = np.einsum("kij,kj->ki", Q[alike], N[normal])
    still = (new == N[normal]).all(axis=1)
    new = np.where(still[:, None], N[normal], np.round(new, DECIMALS) + 0.0)
    variant = same_rows(np.column_stack([normal, new]))
    one = _first(variant)
    order = np.argsort(normal[one], kind="stable")  # of the variants, as they are written
    line_of, value = normal[one][order], new[one][order]
    written = np.bincount(line_of, minlength=len(N))
    edits = [_variants(obj, line_of, value)]
    if (written > 1).any():
        above = np.append(0, np.cumsum(np.maximum(written, 1)))  # lines before that of each normal
        rank = np.arange(len(order)) - np.searchsorted(line_of, line_of)
        place = np.empty(len(order), dtype=np.int64)
        place[order] = above[line_of] + rank
        edits.append(_counted_anew(corners, shaded, place[variant[pair_of]], above))
    return edits


def _pairs(vertex: np.ndarray, normal: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Each vertex with each of its normals once: the pair of each corner (c,), and of each pair the two."""
    last = np.full(n, -1)
    last[vertex] = normal
    if (last[vertex] == normal).all():  # one each, as most files have it
        used = last >= 0
        return (np.cumsum(used) - 1)[vertex], np.flatnonzero(used), last[used]
    pair_of = same_rows(np.column_stack([vertex, normal]))
    one = _first(pair_of)
    return pair_of, vertex[one], normal[one]


def _first(ids: np.ndarray) -> np.ndarray:
    """Where each of some ids, counted from 0, comes first."""
    first = np.empty(int(ids.max()) + 1, dtype=np.int64)
    first[ids[::-1]] = np.arange(len(ids))[::-1]
    return first


def _variants(obj: _Obj, line_of: np.ndarray, value: np.ndarray) -> Edits:
    """Write normals (w, 3), in the order of their lines (w,); a line is repeated for a second one."""
    begin, end, old, line = obj.normals
    again = np.append(line_of[1:] == line_of[:-1], False)  # another variant follows
    stop, resume = (np.empty((len(line_of), 4), dtype=np.int64) for _ in range(2))
    stop[:, :3], resume[:, :3] = begin[line_of], end[line_of]
    stop[:, 3], resume[:, 3] = obj.normal_ends[line_of], line[line_of]
    kind = np.full(stop.shape, DOUBLE, dtype=np.uint8)
    kind[:, 3] = NOTHING
    made = np.column_stack([old[line_of] != value, again])
    number = np.column_stack([value, np.zeros(len(value))])
    where = np.repeat(line[line_of][:, None], 4, axis=1)
    return Edits(*(column[made] for column in (where, stop, resume, kind, number)))


def _counted_anew(corners: _Corners, shaded: np.ndarray, place: np.ndarray, above: np.ndarray) -> Edits:
    """Give the corners `shaded` the new numbers `place` of their normals; relative ones stay relative."""
    relative, over = corners.relative[shaded], corners.above[shaded]
    old = corners.normal[shaded] - np.where(relative, over, -1)
    new = place - np.where(relative, above[over], -1)
    return numbers_edited(corners.begin[shaded], corners.end[shaded], old, new, kind=INTEGER)
