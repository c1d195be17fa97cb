"""OBJ files: positions and normals change, all other lines stay.

Vertices are never split by texture coordinates, normals, colours, groups or materials.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sshade.errors import InputError
from sshade.io.decimals import DOUBLE, INTEGER, NOTHING, Edits, Numbers, edited, vectors_of
from sshade.io.document import MeshFile, fanned, moved_reference, present
from sshade.io.normals import turns
from sshade.io.words import Lines, array_of, integers_of, key_of, line_number, lines_of, parts_of, words_in
from sshade.mesh.seams import same_rows

#: Decimal places of written normals.
DECIMALS = 6
_NEWLINE, _RETURN, _BACKSLASH = 10, 13, 92


class _Corners(NamedTuple):
    """Corners of all polygons, (c,) arrays in the order of the file.

    Attributes
    ----------
    vertex, normal : int64
        Ids from 0; -1 for a corner without a normal.
    begin, end : int64
        Places of the number of the normal.
    relative : bool
        Whether that number counts backwards from the face.
    above : int64
        Number of normals above the face.
    """

    vertex: np.ndarray
    normal: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    relative: np.ndarray
    above: np.ndarray


class _Obj(NamedTuple):
    """An OBJ file.

    Attributes
    ----------
    text : (b,) uint8
    positions, normals : Numbers
    normal_begins, normal_ends : (k,) int64
        Places where the line of each normal and the following line begin. Behind the last line they
        count a line end, whether there is one or not.
    corners : _Corners
    triangles : (m, 3) int64
        Numbers of corners.
    libraries : list of (int, int)
        Places where lines "mtllib" and the lines behind them begin.
    """

    text: np.ndarray
    positions: Numbers
    normals: Numbers
    normal_begins: np.ndarray
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
    whole = array_of(path.read_bytes())
    text = _joined(whole)
    lines = lines_of(text)
    vertex_lines, normal_lines, face_lines = (lines.of(lines.key == key_of(k)) for k in (b"v", b"vn", b"f"))
    positions, words = vectors_of(text, vertex_lines, 1, "a vertex")
    normals, _ = vectors_of(text, normal_lines, 1, "a normal")
    corners, triangles, sizes = _faces(text, face_lines, vertex_lines.begin, normal_lines.begin)
    if not len(positions.value) or not len(triangles):
        raise InputError(f"{path}: the file holds no triangles")
    if corners.normal.max() >= len(normals.value):
        raise ValueError(f"a face refers to a normal outside 1..{len(normals.value)}")
    keys = set(np.unique(lines.key).tolist())
    known = (b"vt", b"mtllib", b"usemtl", b"g", b"o", b"s", b"l", b"p")
    there = {name for name in known if key_of(name) in keys}
    holds = present(
        texture_coordinates=b"vt" in there,
        normals=len(normals.value),
        vertex_colours=(words >= 7).any(),
        materials=there & {b"mtllib", b"usemtl"},
        groups=there & {b"g", b"o"},
        smoothing_groups=b"s" in there,
        polygons=(sizes > 3).any(),
        lines_and_points=there & {b"l", b"p"},
        comments=any(key & 0xFF == ord("#") for key in keys),
    )
    ends = np.append(lines.begin[1:], len(text) + (not _has_last_line_end(text)))
    mtllib = lines.key == key_of(b"mtllib")
    libraries = list(zip(lines.begin[mtllib].tolist(), ends[mtllib].tolist(), strict=True))
    normal_ends = ends[lines.key == key_of(b"vn")]
    obj = _Obj(whole, positions, normals, normal_lines.begin, normal_ends, corners, triangles, libraries)
    F = corners.vertex[triangles]
    return MeshFile(positions.value, F, holds, (".obj",), partial(_content, obj, path))


def _joined(text: np.ndarray) -> np.ndarray:
    """Join lines that end with a backslash to the next line, by blanks."""
    places = np.flatnonzero(text[:-1] == _BACKSLASH)
    one = places[text[places + 1] == _NEWLINE]
    two = places[(text[places + 1] == _RETURN) & (places + 2 < len(text))]
    two = two[text[two + 2] == _NEWLINE]
    if len(one) + len(two):
        text = text.copy()
        for begins, size in ((one, 2), (two, 3)):
            text[begins[:, None] + np.arange(size)] = 32
    return text


def _has_last_line_end(text: np.ndarray) -> bool:
    return text[-1] in (_NEWLINE, _RETURN)


def _faces(
    text: np.ndarray, lines: Lines, vertex_lines: np.ndarray, normal_lines: np.ndarray
) -> tuple[_Corners, np.ndarray, np.ndarray]:
    """Read the faces.

    Parameters
    ----------
    text : (b,) uint8
    lines : Lines
        Lines of the faces.
    vertex_lines, normal_lines : int64
        Places where the lines of vertices and normals begin.

    Returns
    -------
    corners : _Corners
    triangles : (m, 3) int64
        Numbers of corners.
    sizes : (p,) int64
        Number of corners of each polygon.
    """

    def require(wrong: np.ndarray, line_begins: np.ndarray, message: str) -> None:
        if wrong.any():
            raise ValueError(f"line {line_number(text, line_begins[wrong][0])}: {message}")

    begin, end, sizes = words_in(text, lines.begin, lines.end, 1)
    incomplete = "a face needs three vertices, counted from 1"
    require(sizes < 3, lines.begin, incomplete)
    first = np.cumsum(sizes) - sizes
    of_size = [np.flatnonzero(sizes == size) for size in np.unique(sizes)]
    polygons = [first[faces, None] + np.arange(sizes[faces[0]]) for faces in of_size]
    face = np.repeat(np.arange(len(sizes)), sizes)
    line = lines.begin[face]
    vertex = integers_of(text, *parts_of(text, begin, end, 0))
    begin, end = parts_of(text, begin, end, 2)
    shaded = begin < end
    normal = np.zeros(len(begin), dtype=np.int64)
    normal[shaded] = integers_of(text, begin[shaded], end[shaded])
    require((vertex == 0) | (shaded & (normal == 0)), line, incomplete)
    above = np.searchsorted(normal_lines, lines.begin)[face]
    vertex += np.where(vertex > 0, -1, np.searchsorted(vertex_lines, lines.begin)[face])
    relative = normal < 0
    normal += np.where(relative, above, -1)
    require(shaded & (normal < 0), line, "a face refers to more normals than there are above it")
    normal[~shaded] = -1
    return _Corners(vertex, normal, begin, end, relative, above), fanned(polygons, of_size)[0], sizes


def _content(obj: _Obj, source: Path, V: np.ndarray, path: Path) -> bytes:
    edits = [obj.positions.edits(V)]
    text = obj.text if _has_last_line_end(obj.text) else np.append(obj.text, np.uint8(_NEWLINE))
    if len(obj.normals.value):
        edits += _turned_normals(obj, V)
    for begin, end in obj.libraries:
        line = obj.text[begin:end].tobytes()
        moved = _moved_library(line, source, path)
        if moved != line:  # the new line is appended to the text and copied from there
            stop = np.array([begin, len(text) + len(moved)])
            resume = np.array([len(text), end])
            edits.append(Edits(np.full(2, begin), stop, resume, np.zeros(2, dtype=np.uint8), np.zeros(2)))
            text = np.concatenate([text, array_of(moved)])
    return edited(text, edits, size=len(obj.text))


def _moved_library(line: bytes, source: Path, path: Path) -> bytes:
    """Convert the names of a line "mtllib" so that they are valid in `path`."""
    rest = line.split(None, 1)[1:]
    text = rest[0].strip().decode("utf-8", "surrogateescape") if rest else ""
    # Names are separated by blanks, but a single name may contain blanks.
    names = [text] if (source.parent / text).is_file() else text.split()
    moved = [moved_reference(name, source, path) for name in names]
    if moved == names:
        return line
    line_end = line[len(line.rstrip()) :]
    return b"mtllib " + " ".join(moved).encode("utf-8", "surrogateescape") + line_end


def _turned_normals(obj: _Obj, V: np.ndarray) -> list[Edits]:
    """Turn normals with the surface.

    Programs write equal normals once. Where the vertices that share a normal turn differently, further
    lines follow the line of the normal, and the faces are numbered anew.
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
    unchanged = (new == N[normal]).all(axis=1)
    new = np.where(unchanged[:, None], N[normal], np.round(new, DECIMALS) + 0.0)
    variant = same_rows(np.column_stack([normal, new]))
    one = _first_places(variant)
    order = np.argsort(normal[one], kind="stable")  # the order in which variants are written
    line_of, value = normal[one][order], new[one][order]
    written = np.bincount(line_of, minlength=len(N))
    edits = [_variants(obj, line_of, value)]
    if (written > 1).any():
        above = np.append(0, np.cumsum(np.maximum(written, 1)))  # new lines above each normal
        rank = np.arange(len(order)) - np.searchsorted(line_of, line_of)
        place = np.empty(len(order), dtype=np.int64)
        place[order] = above[line_of] + rank
        # Numbers that count backwards from the face keep doing so.
        old_base, new_base = corners.above[shaded], above[corners.above[shaded]]
        relative = corners.relative[shaded]
        old = corners.normal[shaded] - np.where(relative, old_base, -1)
        renumbered = place[variant[pair_of]] - np.where(relative, new_base, -1)
        numbers = Numbers(corners.begin[shaded], corners.end[shaded], old)
        edits.append(numbers.edits(renumbered, kind=INTEGER))
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
    if (last[vertex] == normal).all():  # one normal a vertex, the usual case
        used = last >= 0
        return (np.cumsum(used) - 1)[vertex], np.flatnonzero(used), last[used]
    pair = same_rows(np.column_stack([vertex, normal]))
    one = _first_places(pair)
    return pair, vertex[one], normal[one]


def _first_places(ids: np.ndarray) -> np.ndarray:
    """Return the place where each id, counted from 0, occurs first."""
    first = np.empty(int(ids.max()) + 1, dtype=np.int64)
    first[ids[::-1]] = np.arange(len(ids))[::-1]
    return first


def _variants(obj: _Obj, line_of: np.ndarray, value: np.ndarray) -> Edits:
    """Write normals (w, 3) into their lines (w,), ascending; a line is repeated for each further normal."""
    begin, end, old = obj.normals
    line = obj.normal_begins
    repeats = np.append(line_of[1:] == line_of[:-1], False)
    stop, resume = (np.empty((len(line_of), 4), dtype=np.int64) for _ in range(2))
    stop[:, :3], resume[:, :3] = begin[line_of], end[line_of]
    stop[:, 3], resume[:, 3] = obj.normal_ends[line_of], line[line_of]
    kind = np.full(stop.shape, DOUBLE, dtype=np.uint8)
    kind[:, 3] = NOTHING
    changes = np.column_stack([old[line_of] != value, repeats])
    number = np.column_stack([value, np.zeros(len(value))])
    where = np.repeat(line[line_of][:, None], 4, axis=1)
    return Edits(*(column[changes] for column in (where, stop, resume, kind, number)))
