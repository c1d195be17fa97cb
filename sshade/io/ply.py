"""PLY files: the positions and the triangles, every number as it stands there.

Read here and not by a library, because a mesh must not change on its way in: a
text file that ends early is an error, texture seams split no vertex, and no
other file is opened that a header names.

G. Turk, "The PLY polygon file format", 1994.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from struct import unpack_from
from typing import NamedTuple

import numpy as np

_OLD_NAMES = ["char", "uchar", "short", "ushort", "int", "uint", "float", "double"]
_NEW_NAMES = ["int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64"]
_TYPES = {name: np.dtype(new) for old, new in zip(_OLD_NAMES, _NEW_NAMES, strict=True) for name in (old, new)}
_ORDER = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_CORNERS = ("vertex_indices", "vertex_index")


class Property(NamedTuple):
    """A number of an element, or a list of them; `length` is the type of its length."""

    name: str
    kind: np.dtype
    length: np.dtype | None = None


_NO_FACES = np.zeros((0, 3), dtype=np.int64)

#: Rows of an element whose lists have the same lengths: their numbers, and a structured array of
#: them with fields p0, p1, ... for the properties.
Groups = list[tuple[np.ndarray, np.ndarray]]


@dataclass
class Element:
    """Rows of properties."""

    name: str
    rows: int
    properties: list[Property] = field(default_factory=list)


def read_ply(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a PLY file, text or binary; polygons are fanned into triangles.

    Returns
    -------
    V : (n, 3) float64
    F : (m, 3) int64
        Of length 0 where the file has points only.

    Raises
    ------
    ValueError
        When the file is no PLY, holds fewer or more numbers than it announces, or has no positions.
    """
    data = path.read_bytes()
    order, elements, at = _read_header(data)
    if order == "":
        # As numbers of one type, text is read the way binary is.
        words, double = data[at:].split(), _TYPES["double"]
        data, at, order = np.fromiter(map(float, words), dtype="<f8", count=len(words)).tobytes(), 0, "<"
        for e in elements:
            e.properties = [p._replace(kind=double, length=p.length and double) for p in e.properties]
    found = {}
    for element in elements:
        groups, at = _take(data, at, element, order)
        found[element.name] = element, groups
    if at != len(data):
        raise ValueError("more follows after the last of what it announces")
    if "vertex" not in found:
        raise ValueError("it has no vertices")
    return _positions(*found["vertex"]), _triangles(*found["face"]) if "face" in found else _NO_FACES


def _positions(vertices: Element, groups: Groups) -> np.ndarray:
    """(n, 3) float64 of the element vertex."""
    place = {p.name: i for i, p in enumerate(vertices.properties)}
    if not {"x", "y", "z"} <= place.keys():
        raise ValueError("its vertices have no x, y and z")
    V = np.empty((vertices.rows, 3))
    for which, rows in groups:
        V[which] = np.stack([rows[f"p{place[axis]}"] for axis in "xyz"], axis=1)
    return V


def _triangles(faces: Element, groups: Groups) -> np.ndarray:
    """(m, 3) int64 of the element face, its polygons fanned, in the order of the file."""
    corners = [i for i, p in enumerate(faces.properties) if p.name in _CORNERS and p.length]
    if faces.rows and len(corners) != 1:
        raise ValueError("its faces have no list vertex_indices")
    fans = [_fans(rows[f"p{corners[0]}"]) for _, rows in groups]
    face = [np.repeat(which, len(F) // len(which)) for (which, _), F in zip(groups, fans, strict=True)]
    return np.concatenate([_NO_FACES, *fans])[np.argsort(np.concatenate([[], *face]), kind="stable")]


def write_ply(path: Path, V: np.ndarray, F: np.ndarray) -> None:
    """Write (n, 3) float64 positions and (m, 3) faces, binary."""
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(V)}\n"
        "property double x\nproperty double y\nproperty double z\n"
        f"element face {len(F)}\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(len(F), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"] = 3
    faces["corners"] = F
    with path.open("wb") as file:
        file.write(header.encode("ascii"))
        file.write(np.ascontiguousarray(V, dtype="<f8").tobytes())
        file.write(faces.tobytes())


def _read_header(data: bytes) -> tuple[str, list[Element], int]:
    """Byte order ("" for text), elements, and where their numbers begin."""
    order, elements, begin, number = None, [], 0, 0
    while True:
        end = data.find(b"\n", begin)
        if end < 0:
            raise ValueError("its header has no end" if number else "it does not begin with ply")
        words = data[begin:end].decode("latin-1").split()
        begin, number = end + 1, number + 1
        if number == 1:
            if words != ["ply"]:
                raise ValueError("it does not begin with ply")
        elif words == ["end_header"]:
            break
        elif words[:1] == ["format"] and len(words) == 3 and words[1] in _ORDER:
            order = _ORDER[words[1]]
        elif words[:1] == ["element"] and len(words) == 3 and words[2].isdecimal():
            elements.append(Element(words[1], int(words[2])))
        elif words[:1] == ["property"] and elements and (one := _property(words[1:])):
            elements[-1].properties.append(one)
        elif words and words[0] not in ("comment", "obj_info"):
            raise ValueError(f"line {number} of its header is not understood: {' '.join(words)[:60]!r}")
    if order is None:
        raise ValueError("its header names no format")
    return order, elements, begin


def _property(words: list[str]) -> Property | None:
    if len(words) == 2 and words[0] in _TYPES:
        return Property(words[1], _TYPES[words[0]])
    if len(words) == 4 and words[0] == "list" and {words[1], words[2]} <= _TYPES.keys():
        count = _TYPES[words[1]]
        return Property(words[3], _TYPES[words[2]], count) if count.kind != "f" else None
    return None


def _take(data: bytes, at: int, element: Element, order: str) -> tuple[Groups, int]:
    """The rows of an element that begins at byte `at`, and where they end."""
    if not element.rows or not element.properties:
        return [], at
    lengths = _lengths(data, at, element, order)
    layout = _layout(element, lengths, order)
    end = at + element.rows * layout.itemsize
    if end <= len(data):  # all rows may be as the first one
        rows = np.frombuffer(data, layout, element.rows, at)
        if all((rows[f"n{i}"] == n).all() for i, n in enumerate(lengths) if n is not None):
            return [(np.arange(element.rows), rows)], end
    layouts: dict[tuple[int | None, ...], np.dtype] = {}
    places: dict[tuple[int | None, ...], list[tuple[int, int]]] = {}
    for row in range(element.rows):
        lengths = _lengths(data, at, element, order)
        if lengths not in layouts:
            layouts[lengths], places[lengths] = _layout(element, lengths, order), []
        places[lengths].append((row, at))
        at += layouts[lengths].itemsize
    groups, every = [], np.frombuffer(data, np.uint8)
    for lengths, layout in layouts.items():
        which, begin = np.array(places[lengths]).T
        taken = every[begin[:, None] + np.arange(layout.itemsize)]
        groups.append((which, taken.view(layout)[:, 0]))
    return groups, at


def _lengths(data: bytes, at: int, element: Element, order: str) -> tuple[int | None, ...]:
    """Lengths of the lists of the row that begins at byte `at`, None for what is no list."""
    lengths: list[int | None] = []
    for one in element.properties:
        length = None
        if one.length is not None:
            if at + one.length.itemsize > len(data):
                break
            (length,) = unpack_from(order + one.length.char, data, at)
            if length < 0 or length != int(length):
                raise ValueError(f"a list of its element {element.name} has a length of {length}")
            length = int(length)
            at += one.length.itemsize
        lengths.append(length)
        at += one.kind.itemsize * (1 if length is None else length)
    if len(lengths) < len(element.properties) or at > len(data):
        raise ValueError(f"it ends within the {element.rows} rows of its element {element.name}")
    return tuple(lengths)


def _layout(element: Element, lengths: tuple[int | None, ...], order: str) -> np.dtype:
    fields: list[tuple] = []
    for i, (one, length) in enumerate(zip(element.properties, lengths, strict=True)):
        kind = order + one.kind.char
        if one.length is None:
            fields.append((f"p{i}", kind))
        else:
            fields += [(f"n{i}", order + one.length.char), (f"p{i}", kind, (length,))]
    return np.dtype(fields)


def _fans(polygons: np.ndarray) -> np.ndarray:
    """(m * (k - 2), 3) triangles of (m, k) polygons, in their order."""
    k = polygons.shape[1]
    if k < 3:
        raise ValueError(f"a face has {k} corners")
    if polygons.dtype.kind == "f" and not (np.abs(polygons) < 2**53).all():
        raise ValueError("a corner of a face is no vertex id")
    ids = polygons.astype(np.int64)
    if (ids != polygons).any():
        raise ValueError("a corner of a face is no whole number")
    first = np.repeat(ids[:, :1], k - 2, axis=1)
    return np.stack([first, ids[:, 1:-1], ids[:, 2:]], axis=2).reshape(-1, 3)
