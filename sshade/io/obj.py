"""OBJ files: lines are kept as they are but for positions and normals.

What a file says of texture, normals, colours, groups and materials splits no vertex.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from sshade.errors import InputError
from sshade.io.document import MeshFile, moved_reference, present, with_numbers, with_words
from sshade.io.normals import turns
from sshade.mesh.seams import same_rows

#: Decimals of normals that are written.
DECIMALS = 6


@dataclass
class _Obj:
    """The lines of a file (a continued line is one), and where its numbers stand.

    `normals_before` counts those above each face, which relative ids count from; `corners` are the
    vertex and the normal (or -1) of each corner of a polygon, `triangles` numbers of corners.
    """

    lines: list[bytes]
    positions: list[list[float]] = field(default_factory=list)
    position_lines: list[int] = field(default_factory=list)
    normals: list[list[float]] = field(default_factory=list)
    normal_lines: list[int] = field(default_factory=list)
    face_lines: list[int] = field(default_factory=list)
    sizes: list[int] = field(default_factory=list)
    normals_before: list[int] = field(default_factory=list)
    corners: list[tuple[int, int]] = field(default_factory=list)
    triangles: list[tuple[int, int, int]] = field(default_factory=list)
    libraries: list[int] = field(default_factory=list)
    keys: set[bytes] = field(default_factory=set)
    coloured: bool = False


def read_obj(path: Path) -> MeshFile:
    """Read an OBJ file.

    Raises
    ------
    ValueError
        On a vertex, a normal or a face that is not complete.
    InputError
        When there are no triangles.
    """
    obj = _parsed(path.read_bytes())
    if not obj.positions or not obj.triangles:
        raise InputError(f"{path}: the file holds no triangles")
    corners = np.array(obj.corners, dtype=np.int64)
    if corners[:, 1].max() >= len(obj.normals) or corners[:, 1].min() < -1:
        raise ValueError(f"a face refers to a normal outside 1..{len(obj.normals)}")
    V = np.array(obj.positions, dtype=np.float64)
    holds = present(
        texture_coordinates=b"vt" in obj.keys,
        normals=obj.normals,
        vertex_colours=obj.coloured,
        materials=obj.keys & {b"mtllib", b"usemtl"},
        groups=obj.keys & {b"g", b"o"},
        smoothing_groups=b"s" in obj.keys,
        polygons=max(obj.sizes) > 3,
        lines_and_points=obj.keys & {b"l", b"p"},
        comments=any(key.startswith(b"#") for key in obj.keys),
    )
    F = corners[:, 0][np.array(obj.triangles)]
    return MeshFile(V, F, holds, (".obj",), partial(_content, obj, corners, V, path))


def _parsed(data: bytes) -> _Obj:
    obj = _Obj(_logical_lines(data))
    number = 1
    for place, line in enumerate(obj.lines):
        words = _words(line)
        key = words[0] if words else b""
        obj.keys.add(key[:1] if key.startswith(b"#") else key)
        if key == b"v":
            _position(obj, place, words, number)
        elif key == b"vn":
            obj.normals.append([float(word) for word in words[1:4]])
            obj.normal_lines.append(place)
            if len(obj.normals[-1]) < 3:
                raise ValueError(f"line {number}: a normal needs three coordinates")
        elif key == b"f":
            _face(obj, place, words, number)
        elif key == b"mtllib":
            obj.libraries.append(place)
        number += max(line.count(b"\n"), 1)
    return obj


def _words(line: bytes) -> list[bytes]:
    if b"\\" in line:
        line = line.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    return line.split()


def _logical_lines(data: bytes) -> list[bytes]:
    lines: list[bytes] = []
    goes_on = False
    for line in data.splitlines(keepends=True):
        if goes_on:
            lines[-1] += line
        else:
            lines.append(line)
        goes_on = line.endswith((b"\\\n", b"\\\r\n"))
    return lines


def _position(obj: _Obj, place: int, words: list[bytes], number: int) -> None:
    obj.positions.append([float(word) for word in words[1:4]])
    obj.position_lines.append(place)
    obj.coloured |= len(words) >= 7
    if len(words) < 4:
        raise ValueError(f"line {number}: a vertex needs three coordinates")


def _face(obj: _Obj, place: int, words: list[bytes], number: int) -> None:
    at = len(obj.corners)
    for word in words[1:]:
        ids = word.split(b"/")
        v, n = int(ids[0]), int(ids[2]) if len(ids) > 2 and ids[2] else None
        if v == 0 or n == 0:
            raise ValueError(f"line {number}: a face needs three vertices, counted from 1")
        v = v - 1 if v > 0 else len(obj.positions) + v
        if n is not None:
            n = n - 1 if n > 0 else len(obj.normals) + n
            if n < 0:
                raise ValueError(f"line {number}: there are not so many normals above it")
        obj.corners.append((v, -1 if n is None else n))
    size = len(words) - 1
    if size < 3:
        raise ValueError(f"line {number}: a face needs three vertices, counted from 1")
    obj.face_lines.append(place)
    obj.sizes.append(size)
    obj.normals_before.append(len(obj.normals))
    obj.triangles += [(at, b, c) for b, c in pairwise(range(at + 1, at + size))]


def _content(obj: _Obj, corners: np.ndarray, rest: np.ndarray, source: Path, V: np.ndarray, path: Path):
    lines = list(obj.lines)
    for place, old, new in zip(obj.position_lines, rest.tolist(), V.tolist(), strict=True):
        lines[place] = with_numbers(lines[place], 1, old, new)
    for place in obj.libraries:
        lines[place] = _library(lines[place], source, path)
    if obj.normals:
        _turn_normals(obj, corners, rest, V, lines)
    return b"".join(lines)


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


def _turn_normals(
    obj: _Obj, corners: np.ndarray, rest: np.ndarray, V: np.ndarray, lines: list[bytes]
) -> None:
    """Turn normals with the surface.

    Programs write equal normals once. Where the places that share one turn differently, further lines
    follow its own, and faces count anew.
    """
    N = np.array(obj.normals)
    shaded = np.flatnonzero(corners[:, 1] >= 0)
    if not len(shaded):
        return
    # Each vertex with each of its normals once.
    pair, pair_of = np.unique(corners[shaded] @ [len(N), 1], return_inverse=True)
    vertex, normal = np.divmod(pair, len(N))
    group = np.full(len(corners), -1)
    alike = same_rows(np.column_stack([rest[vertex], V[vertex], N[normal]]))
    group[shaded] = alike[pair_of]
    triangles = np.array(obj.triangles)
    Q = turns(group[triangles], corners[:, 0][triangles], rest, V)
    new = np.einsum("kij,kj->ki", Q[alike], N[normal])
    still = (new == N[normal]).all(axis=1)
    new = np.where(still[:, None], N[normal], np.round(new, DECIMALS) + 0.0)
    variant = same_rows(np.column_stack([normal, new]))
    pairs = np.unique(np.column_stack([normal, variant]), axis=0)
    value = np.empty((int(variant.max()) + 1, 3))
    value[variant] = new
    written = np.bincount(pairs[:, 0], minlength=len(N))
    start = np.append(0, np.cumsum(np.maximum(written, 1)))  # of each normal's lines among all of them
    first = np.append(0, np.cumsum(written))[:-1]
    place = np.empty(len(value), dtype=np.int64)
    place[pairs[:, 1]] = start[pairs[:, 0]] + np.arange(len(pairs)) - first[pairs[:, 0]]
    for i in np.flatnonzero(written).tolist():
        line = lines[obj.normal_lines[i]]
        own = line if line.endswith((b"\n", b"\r")) or written[i] == 1 else line + b"\n"
        variants = pairs[first[i] : first[i] + written[i], 1]
        lines[obj.normal_lines[i]] = b"".join(
            with_numbers(own, 1, obj.normals[i], value[k].tolist()) for k in variants
        )
    if start[-1] > len(N):
        ids = np.full(len(corners), -1)
        ids[shaded] = place[variant[pair_of]]
        _count_anew(obj, ids, start, lines)


def _count_anew(obj: _Obj, ids: np.ndarray, start: np.ndarray, lines: list[bytes]) -> None:
    """Give the faces the new numbers (c,) of the normals at their corners; relative ids stay relative."""
    at = 0
    for line, size, above in zip(obj.face_lines, obj.sizes, obj.normals_before, strict=True):
        own = ids[at : at + size].tolist()
        at += size
        words = _words(lines[line])
        new = {}
        for number, index in enumerate(own, start=1):
            if index >= 0:
                head, _, last = words[number].rpartition(b"/")
                new[number] = b"%b/%d" % (head, index - int(start[above]) if int(last) < 0 else index + 1)
        lines[line] = with_words(lines[line], new)
