"""Write mesh files for the tests, without code of the package."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

#: NumPy types of the types of PLY.
_PLY = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"}
_PLY |= {"float": "f4", "double": "f8"}
#: A property of PLY: its name, its type or the two types of a list, and a value for each row.
Property = tuple[str, str, Any]


def ply(order: str, elements: dict[str, list[Property]], *, comments: Sequence[str] = (), end="\n") -> bytes:
    """Return a PLY file. `order` is "<" or ">" for binary files, and "" for text."""
    names = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}
    lines, body = ["ply", f"format {names[order]} 1.0", *comments], []
    for element, properties in elements.items():
        lines.append(f"element {element} {len(properties[0][2])}")
        lines += [f"property {'list ' * (' ' in kind)}{kind} {label}" for label, kind, _ in properties]
        for row in zip(*(values for _, _, values in properties), strict=True):
            numbers: list[tuple[str, Any]] = []
            for (_, kind, _), cell in zip(properties, row, strict=True):
                if " " in kind:
                    of_length, of_items = kind.split()
                    numbers += [(of_length, len(cell)), *((of_items, item) for item in cell)]
                else:
                    numbers.append((kind, cell))
            if order:
                body += [np.array(v).astype(order + _PLY[kind]).tobytes() for kind, v in numbers]
            else:
                body.append((" ".join(_word(v, kind) for kind, v in numbers) + end).encode())
    return end.join([*lines, "end_header", ""]).encode() + b"".join(body)


def _word(value: Any, kind: str) -> str:
    if kind == "float":
        return str(np.float32(value))
    return repr(float(value)) if kind == "double" else str(int(value))


def columns(kind: str, names: str, values: Any) -> list[Property]:
    """Return a property for each name and column of numbers (n, k)."""
    return [(name, kind, column) for name, column in zip(names.split(), np.transpose(values), strict=True)]


def mesh_ply(V: np.ndarray, F: Any, order: str = "<", kind: str = "double", **more: Any) -> bytes:
    """Return a PLY file of positions and polygons. `more` has further properties, as vertex= or face=."""
    vertex = columns(kind, "x y z", V) + more.pop("vertex", [])
    face = [("vertex_indices", "uchar int", F)] + more.pop("face", [])
    return ply(order, {"vertex": vertex, "face": face}, **more)


def rows(head: str, array: Any) -> list[str]:
    """Return a line of text for each row of numbers."""
    return [head + " ".join(map(repr, row)) for row in np.asarray(array).tolist()]


def lines(*parts: Sequence[str], end: str = "\n") -> bytes:
    """Join lines of text."""
    return "".join(line + end for part in parts for line in part).encode()


def obj(V: np.ndarray, F: Any, *, end: str = "\n") -> bytes:
    """Return an OBJ file of positions and polygons."""
    return lines(rows("v ", V), ["f " + " ".join(str(i + 1) for i in face) for face in F], end=end)


def off(V: np.ndarray, F: Any, *, end: str = "\n", keyword: str = "OFF") -> bytes:
    """Return an OFF file of positions and polygons."""
    faces = [" ".join(map(str, [len(face), *face])) for face in F]
    return lines([keyword, f"{len(V)} {len(F)} 0"], rows("", V), faces, end=end)
