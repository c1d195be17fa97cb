"""OBJ, OFF and STL files: positions and triangles in their order, and nothing else of them.

What a file says of texture, normals, colours, groups and materials splits no vertex.
Polygons are fanned into triangles. For PLY see :mod:`sshade.io.ply`.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from sshade.errors import InputError

#: A facet of a binary STL.
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
#: Keywords of a text STL that carry no numbers that are read here.
_STL_WORDS = ("facet", "outer", "endloop", "endfacet")


def read_obj(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) float64 vertices and (m, 3) int64 faces of an OBJ file.

    Raises
    ------
    ValueError
        On a vertex or a face that is not complete.
    InputError
        When there are no triangles.
    """
    vertices: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    text = path.read_text(encoding="utf-8", errors="replace").replace("\\\n", " ")
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split()
        if words[:1] == ["v"]:
            vertices.append([float(word) for word in words[1:4]])
            if len(vertices[-1]) < 3:
                raise ValueError(f"line {number}: a vertex needs three coordinates")
        elif words[:1] == ["f"]:
            ids = [int(word.split("/", 1)[0]) for word in words[1:]]
            if len(ids) < 3 or 0 in ids:
                raise ValueError(f"line {number}: a face needs three vertices, counted from 1")
            ids = [i - 1 if i > 0 else len(vertices) + i for i in ids]
            faces += [(ids[0], b, c) for b, c in pairwise(ids[1:])]
    return _arrays(vertices, faces, path)


def read_off(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """The same of an OFF file.

    Raises
    ------
    ValueError
        When it is no OFF, or holds fewer or more lines than it announces.
    InputError
        When there are no triangles.
    """
    rows = [line.split("#", 1)[0].split() for line in path.read_text(encoding="utf-8").splitlines()]
    rows = [row for row in rows if row]
    if not rows or not rows[0][0].upper().endswith("OFF"):
        raise ValueError("it does not begin with OFF")
    if len(rows) < 2:
        raise ValueError("it ends after its first line")
    counts, body = (rows[0][1:], rows[1:]) if len(rows[0]) > 1 else (rows[1], rows[2:])
    if len(counts) < 2:
        raise ValueError("it does not say how many vertices and faces it holds")
    n, m = int(counts[0]), int(counts[1])
    if n < 0 or m < 0 or len(body) != n + m:
        raise ValueError(f"{n} vertices and {m} faces are announced, {len(body)} lines follow")
    faces: list[tuple[int, int, int]] = []
    short = next((i for i, row in enumerate(body[:n]) if len(row) < 3), None)
    if short is not None:
        raise ValueError(f"vertex {short} needs three coordinates")
    for number, row in enumerate(body[n:]):
        ids = [int(word) for word in row[1 : int(row[0]) + 1]]
        if len(ids) < max(3, int(row[0])):
            raise ValueError(f"face {number} is not complete")
        faces += [(ids[0], b, c) for b, c in pairwise(ids[1:])]
    return _arrays([[float(word) for word in row[:3]] for row in body[:n]], faces, path)


def read_stl(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """The same of an STL file, text or binary: a soup, with three vertices of its own for each face.

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
        V = np.frombuffer(data, _FACET, count, 84)["corners"].reshape(-1, 3).astype(np.float64)
    elif data.lstrip()[:5].lower() == b"solid":
        V = _text_solid(data.decode("latin-1"), path)
    else:
        raise ValueError("it is neither a text that begins with solid, nor as long as its header says")
    if len(V) == 0:
        raise InputError(f"{path}: the file holds no triangles")
    return V, np.arange(len(V)).reshape(-1, 3)


def _text_solid(text: str, path: Path) -> np.ndarray:
    """(3m, 3) corners of the facets of the one solid of a text."""
    corners: list[list[float]] = []
    solids, inside = 0, False
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split()
        key = words[0].lower() if words else ""
        if key == "vertex" and inside:
            corners.append([float(word) for word in words[1:]])
            if len(corners[-1]) != 3:
                raise ValueError(f"line {number}: a vertex needs three coordinates")
        elif key in ("solid", "endsolid"):
            solids, inside = solids + (key == "solid"), key == "solid"
        elif key and not (key in _STL_WORDS and inside):
            raise ValueError(f"line {number} is not understood: {' '.join(words)[:60]!r}")
        if key == "endloop" and len(corners) % 3:
            raise ValueError(f"line {number}: a facet has no three vertices")
    if inside or len(corners) % 3:
        raise ValueError("it ends within a solid")
    if solids > 1:
        raise InputError(f"{path}: the file holds {solids} meshes; give one mesh a file")
    return np.array(corners, dtype=np.float64).reshape(-1, 3)


def _arrays(
    vertices: list[list[float]], faces: list[tuple[int, int, int]], path: Path
) -> tuple[np.ndarray, np.ndarray]:
    if not vertices or not faces:
        raise InputError(f"{path}: the file holds no triangles")
    return np.array(vertices, dtype=np.float64), np.array(faces, dtype=np.int64)
