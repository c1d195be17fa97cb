"""Read mesh files for the checks. No code of the package is used.

A reader returns positions, triangles, and all other contents in a form that can be compared: the file of a
deformed mesh must equal the file of the mesh but for positions and normals.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tools.corpus.document_gltf import read_gltf, triangles_of_strip

#: Properties of PLY that a deformation changes.
GEOMETRY = ("x", "y", "z", "nx", "ny", "nz")
_TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"}
_TYPES |= {"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"}
_TYPES |= {"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"}


@dataclass(frozen=True)
class Document:
    """A mesh file.

    Attributes
    ----------
    V : (n, 3) float64
    F : (m, 3) int64
        Polygons are fanned from their first corners.
    rest : object
        All other contents.
    step : float
        Greatest rounding error of a coordinate in the file.
    """

    V: np.ndarray
    F: np.ndarray
    rest: Any
    step: float


def read(path: Path) -> Document:
    """Read a mesh file. Any error means that the file is damaged, or in a dialect that is not known here."""
    suffix = path.suffix.lower()
    if suffix in (".glb", ".gltf"):
        V, F, rest, size = read_gltf(path)
        return Document(V, F, rest, step(size))
    data = path.read_bytes()
    V, polygons, rest, single = {".ply": _ply, ".obj": _obj, ".off": _off, ".stl": _stl}[suffix](data)
    F = polygons if isinstance(polygons, np.ndarray) else fanned(polygons)
    return Document(V, F, rest, step(np.abs(V).max(initial=0), single=single))


def step(size: float, *, single: bool = True) -> float:
    """Return the rounding error of coordinates up to a size."""
    return float(np.finfo(np.float32 if single else np.float64).eps * size)


def fanned(polygons: Sequence[Sequence[int]]) -> np.ndarray:
    """Fan polygons into triangles (m, 3)."""
    F = [(p[0], p[k], p[k + 1]) for p in polygons for k in range(1, len(p) - 1)]
    return np.array(F, dtype=np.int64).reshape(-1, 3)


def _ply(data: bytes) -> tuple[np.ndarray, Any, Any, bool]:
    end = re.search(rb"^end_header\r?\n", data, re.MULTILINE)
    assert end is not None and data.startswith(b"ply")
    head = data[: end.end()].decode("latin-1").splitlines()
    elements: list[tuple[str, int, list[list[str]]]] = []
    for words in map(str.split, head):
        if words[:1] == ["element"]:
            elements.append((words[1], int(words[2]), []))
        elif words[:1] == ["property"]:
            elements[-1][2].append(words[1:])
    order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
    order = order[next(line.split()[1] for line in head if line.startswith("format"))]
    tables, at, rest = {}, end.end(), [head]
    following = iter(data[end.end() :].decode("latin-1").splitlines())
    for name, count, properties in elements:
        if order:
            table, at = _binary_rows(data, at, count, properties, order)
        else:
            table = [_text_row(next(following), properties) for _ in range(count)]
        fixed = [
            i for i, p in enumerate(properties) if p[-1] not in GEOMETRY or name not in ("vertex", "face")
        ]
        rest.append([[row[i] for i in fixed] + row[len(properties) :] for row in table])
        tables[name] = {p[-1]: [row[i] for row in table] for i, p in enumerate(properties)}
    assert at == len(data) if order else not "".join(following).strip()
    vertex = tables["vertex"]
    kinds = next({p[-1]: p[0] for p in e[2]} for e in elements if e[0] == "vertex")
    faces = tables.get("face", {})
    polygons = faces.get("vertex_indices", faces.get("vertex_index", []))
    for strip in tables.get("tristrips", {}).get("vertex_indices", []):
        polygons = [*polygons, *triangles_of_strip(strip)]
    V = np.array([vertex[axis] for axis in "xyz"], dtype=np.float64).T.reshape(-1, 3)
    return V, polygons, rest, _TYPES[kinds["x"]] == "f4"


def _text_row(line: str, properties: list[list[str]]) -> list[Any]:
    words, row = line.split(), []
    for kind in properties:
        size = int(words.pop(0)) if kind[0] == "list" else 1
        values = [float(words.pop(0)) for _ in range(size)]
        values = [int(v) for v in values] if "_ind" in kind[-1] else values
        row.append(values if kind[0] == "list" else values[0])
    return row + words  # what the header does not declare


def _binary_rows(
    data: bytes, at: int, count: int, properties: list[list[str]], order: str
) -> tuple[list[list[Any]], int]:
    if all(p[0] != "list" for p in properties):
        layout = np.dtype([(f"p{i}", order + _TYPES[p[0]]) for i, p in enumerate(properties)])
        return [
            list(row) for row in np.frombuffer(data, layout, count, at).tolist()
        ], at + count * layout.itemsize
    table = []
    for _ in range(count):
        row: list[Any] = []
        for kind in properties:
            size, code = 1, order + _TYPES[kind[-2]]
            if kind[0] == "list":
                size = int(np.frombuffer(data, order + _TYPES[kind[1]], 1, at)[0])
                at += int(_TYPES[kind[1]][1])
            values = np.frombuffer(data, code, size, at).tolist()
            at += size * int(_TYPES[kind[-2]][1])
            row.append(values if kind[0] == "list" else values[0])
        table.append(row)
    return table, at


def _obj(data: bytes) -> tuple[np.ndarray, Any, Any, bool]:
    text = data.decode("utf-8-sig", "surrogateescape")
    text = re.sub(r"\\\r?\n", " ", text)
    V, polygons, rest, normals = [], [], [], 0
    for line in text.splitlines():
        words = line.split()
        key = words[0] if words else ""
        if key == "v":
            V.append([float(w) for w in words[1:4]])
            rest.append(words[4:])
        elif key == "vn":
            normals += 1
            assert np.isfinite([float(w) for w in words[1:4]]).all(), "a normal is not finite"
        elif key == "f":
            corners = [word.split("/") for word in words[1:]]
            ids = [int(c[0]) for c in corners]
            assert all(ids), "a face counts from 1"
            polygons.append([i - 1 if i > 0 else i + len(V) for i in ids])
            # A normal may get another number: vertices that shared it turn apart.
            rest.append([(*c[:2], bool("".join(c[2:]))) for c in corners])
        else:
            rest.append(line)
    return np.array(V, dtype=np.float64).reshape(-1, 3), polygons, rest, False


def _off(data: bytes) -> tuple[np.ndarray, Any, Any, bool]:
    lines = data.decode("latin-1").splitlines()
    table = [words for line in lines if (words := line.partition("#")[0].split())]
    comments = [line for line in lines if "#" in line and not line.partition("#")[0].strip()]
    head = table.pop(0)
    counts = head[1:] or table.pop(0)
    n, m = int(counts[0]), int(counts[1])
    vertex, face = table[:n], table[n:]
    assert len(face) == m
    skipped = 6 if "N" in head[0] else 3
    polygons = [[int(w) for w in row[1 : 1 + int(row[0])]] for row in face]
    V = np.array([row[:3] for row in vertex], dtype=np.float64).reshape(-1, 3)
    return V, polygons, [head, counts, [row[skipped:] for row in vertex], face, comments], False


def _stl(data: bytes) -> tuple[np.ndarray, Any, Any, bool]:
    if len(data) >= 84 and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little"):
        facets = np.frombuffer(data[84:], [("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")])
        assert np.isfinite(facets["n"]).all(), "a normal is not finite"
        V = facets["c"].reshape(-1, 3).astype(np.float64)
        return V, np.arange(len(V)).reshape(-1, 3), [data[:84], facets["a"].tolist()], True
    lines = [line.strip() for line in data.decode("latin-1").splitlines()]
    assert lines[0].lower().startswith("solid")
    points = [line.split()[1:] for line in lines if line.lower().startswith("vertex")]
    assert all(len(point) == 3 for point in points)
    V = np.array(points, dtype=np.float64).reshape(-1, 3)
    rest = [line for line in lines if not line.lower().startswith(("vertex", "facet"))]
    count = sum(line.lower().startswith("facet") for line in lines)
    assert len(V) == 3 * count == 3 * sum(line.lower() == "endloop" for line in lines)
    return V, np.arange(len(V)).reshape(-1, 3), rest, True
