"""Write mesh files in every dialect of their formats. No code of the package is used."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np

#: NumPy types of the types of PLY.
_PLY = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"}
_PLY |= {"float": "f4", "double": "f8"}
#: A property of PLY: its name, its type or the two types of a list, and a value for each row.
Property = tuple[str, str, Any]


def ply(
    order: str, elements: dict[str, list[Property]], *, comments: Sequence[str] = (), end: str = "\n"
) -> bytes:
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


def stl(corners: np.ndarray, *, head: bytes = b"", attribute: int = 0) -> bytes:
    """Return a binary STL file of triangles (m, 3, 3)."""
    facets = np.zeros(len(corners), [("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")])
    facets["c"], facets["a"], facets["n"] = corners, attribute, _normals(corners)
    return head.ljust(80, b"\0") + struct.pack("<I", len(corners)) + facets.tobytes()


def solid(corners: np.ndarray, name: str = "part", *, digits: str = "{!r}") -> list[str]:
    """Return the lines of a solid of a text STL file."""
    found = [f"solid {name}".rstrip()]
    for normal, triangle in zip(_normals(corners).tolist(), corners.tolist(), strict=True):
        found += ["facet normal " + " ".join(map(digits.format, normal)), " outer loop"]
        found += ["  vertex " + " ".join(map(digits.format, corner)) for corner in triangle]
        found += [" endloop", "endfacet"]
    return [*found, f"endsolid {name}".rstrip()]


def _normals(corners: np.ndarray) -> np.ndarray:
    N = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(N, axis=1, keepdims=True)
    return np.divide(N, length, out=np.zeros_like(N), where=length > 0)


class Gltf:
    """Builds a glTF file: add arrays and primitives, then take the bytes.

    Attributes
    ----------
    tree : dict
        JSON of the file; `nodes` and `meshes` may be changed before the bytes are taken.
    """

    KINDS = {"<f4": 5126, "<u4": 5125, "<u2": 5123, "|u1": 5121}
    WIDTHS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}

    def __init__(self) -> None:
        self.tree: dict[str, Any] = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}]}
        self.tree |= {name: [] for name in ("nodes", "meshes", "accessors", "bufferViews")}
        self.binary = b""

    def view(self, data: bytes) -> int:
        """Add bytes to the buffer; return the number of their view."""
        self.binary += bytes(-len(self.binary) % 4)
        self.tree["bufferViews"].append(
            {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data)}
        )
        self.binary += data
        return len(self.tree["bufferViews"]) - 1

    def array(self, values: Any, kind: str = "<f4") -> int:
        """Add an array; return the number of its accessor."""
        values = np.asarray(values).astype(kind)
        values = values[:, None] if values.ndim == 1 else values
        accessor = {"bufferView": self.view(values.tobytes()), "componentType": self.KINDS[values.dtype.str]}
        accessor |= {"count": len(values), "type": self.WIDTHS[values.shape[1]]}
        accessor |= {"min": values.min(0).tolist(), "max": values.max(0).tolist()}
        self.tree["accessors"].append(accessor)
        return len(self.tree["accessors"]) - 1

    def mesh(self, V: np.ndarray, F: Any, *, ids: str = "<u4", node: dict | None = None, **more: Any) -> int:
        """Add a mesh of one primitive, and a node that shows it; `more` has arrays of attributes."""
        attributes = {"POSITION": self.array(V)} | {name: self.array(a) for name, a in more.items()}
        primitive = {"attributes": attributes, "indices": self.array(np.ravel(F), ids)}
        self.tree["meshes"].append({"primitives": [primitive]})
        self.show(len(self.tree["meshes"]) - 1, **(node or {}))
        return len(self.tree["meshes"]) - 1

    def show(self, mesh: int, **node: Any) -> None:
        """Add a node that shows a mesh."""
        self.tree["scenes"][0]["nodes"].append(len(self.tree["nodes"]))
        self.tree["nodes"].append({"mesh": mesh, **node})

    def json(self, uri: str) -> bytes:
        """Return a .gltf file whose buffer has an address."""
        return json.dumps({**self.tree, "buffers": [{"byteLength": len(self.binary), "uri": uri}]}).encode()

    def glb(self) -> bytes:
        """Return a .glb file."""
        body = self.binary + bytes(-len(self.binary) % 4)
        head = json.dumps({**self.tree, "buffers": [{"byteLength": len(body)}]}).encode()
        head += b" " * (-len(head) % 4)
        chunks = (
            struct.pack("<I", len(head)) + b"JSON" + head + struct.pack("<I", len(body)) + b"BIN\0" + body
        )
        return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks
