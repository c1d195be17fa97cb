"""Interpret the JSON of a glTF file: arrays in its buffers, matrices of its meshes, contents to refuse."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sshade.core.errors import InputError
from sshade.files.mesh_file import strip_triangles

_KINDS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
FLOAT = 5126
#: Targets of views: numbers of vertices, and vertex ids of triangles.
OF_VERTICES, OF_TRIANGLES = 34962, 34963
#: Component types of vertex ids.
_INDICES = (5121, 5123, 5125)
#: Attributes that follow a deformation, and their types.
CHANGED = {"POSITION": "VEC3", "NORMAL": "VEC3", "TANGENT": "VEC4"}
_LINES_AND_POINTS, _TRIANGLES, _STRIP, _FAN = range(4), 4, 5, 6
_COMPRESSED = ("compressed buffers", "export it again without compression")
#: Extensions that are not supported, their contents, and what to do about them.
_UNREAD = {
    "KHR_draco_mesh_compression": _COMPRESSED,
    "EXT_meshopt_compression": _COMPRESSED,
    "KHR_meshopt_compression": _COMPRESSED,
    "EXT_mesh_gpu_instancing": ("instances without nodes", "export each instance as a node"),
}


def require_plain(tree: dict[str, Any], path: Path) -> None:
    """Raise InputError if a file has contents that would not follow its positions.

    Raises ValueError if attributes of its primitives do not fit together.
    """
    primitives = [p for mesh in tree.get("meshes", []) for p in mesh["primitives"]]
    used = set(tree.get("extensionsUsed", [])) | set(tree.get("extensionsRequired", []))
    found = [contents for name, contents in _UNREAD.items() if name in used]
    if tree.get("skins"):
        found.append(("a skin", "apply the pose of the skeleton and export without the skeleton"))
    if any(p.get("targets") for p in primitives):
        found.append(("morph targets", "apply them, or export without them"))
    read = {i for p in primitives for name, i in p["attributes"].items() if name in CHANGED}
    read |= {p["indices"] for p in primitives if "indices" in p}
    if any("sparse" in tree["accessors"][number] for number in read):
        found.append(("sparse positions, normals or triangles", "export it again without them"))
    for contents, action in found:
        raise InputError(f"{path}: it holds {contents}, which cannot be deformed: {action}")
    corners = [tree["accessors"][p["indices"]] for p in primitives if "indices" in p]
    for attributes in (primitive["attributes"] for primitive in primitives):
        if "POSITION" not in attributes:
            raise ValueError("one of its primitives has no positions")
        size = tree["accessors"][attributes["POSITION"]]["count"]
        for name in (name for name in CHANGED if name in attributes):
            accessor = tree["accessors"][attributes[name]]
            if (accessor["type"], accessor["count"]) != (CHANGED[name], size):
                raise ValueError(f"its attribute {name} is no {CHANGED[name]} for each position")
    if any(a["componentType"] not in _INDICES or a["type"] != "SCALAR" for a in corners):
        raise ValueError("the corners of its triangles are no whole numbers from 0")


def accessor_bytes(tree: dict[str, Any], number: int) -> tuple:
    """Return the view, offset, count and types of an accessor, which identify its numbers."""
    accessor = tree["accessors"][number]
    place = accessor["bufferView"], accessor.get("byteOffset", 0), accessor["count"]
    return *place, accessor["componentType"], accessor["type"]


class Gltf(NamedTuple):
    """A glTF file.

    Attributes
    ----------
    source : path
    tree : dict
        Its JSON.
    buffers : list of bytes, or of other buffers
    """

    source: Path
    tree: dict[str, Any]
    buffers: list[Any]

    def array(self, number: int) -> np.ndarray:
        """Return a (count, width) view of the numbers of an accessor; writable if the buffers are."""
        accessor, name = self.tree["accessors"][number], f"its accessor {number}"
        view = self.tree["bufferViews"][accessor["bufferView"]]
        offset, count = accessor.get("byteOffset", 0), accessor["count"]
        kind, width = np.dtype(_KINDS[accessor["componentType"]]), _WIDTHS[accessor["type"]]
        stride = view.get("byteStride", kind.itemsize * width)
        begin = view.get("byteOffset", 0) + offset
        needed = offset + (count - 1) * stride + kind.itemsize * width
        if min(offset, count - 1, stride, begin) < 0 or needed > view["byteLength"]:
            raise ValueError(f"{name} reaches out of its view")
        if stride < kind.itemsize * width and count > 1:
            raise ValueError(f"the values of {name} overlap each other")
        buffer = self.tree["buffers"][view["buffer"]]
        if view.get("byteOffset", 0) + view["byteLength"] > buffer["byteLength"]:
            raise ValueError(f"the view of {name} reaches out of its buffer")
        return np.ndarray((count, width), kind, self.buffers[view["buffer"]], begin, (stride, kind.itemsize))

    def fractions(self, number: int) -> np.ndarray:
        """Return numbers (count, width) float64, of which whole ones are parts of the largest of their type.

        They lie in [-1, 1].
        """
        values = self.array(number)
        if values.dtype.kind == "f":
            return values.astype(np.float64)
        return np.maximum(values / np.iinfo(values.dtype).max, -1.0)


class NewAccessors:
    """New accessors of a file, whose numbers follow the contents of its first buffer.

    Parameters
    ----------
    gltf : Gltf
        Its first buffer is a bytearray, which grows.
    """

    def __init__(self, gltf: Gltf) -> None:
        self._tree, self._buffer = gltf.tree, gltf.buffers[0]
        del self._buffer[self._tree["buffers"][0]["byteLength"] :]

    def add(
        self, values: np.ndarray, fields: Mapping[str, Any] = {}, *, target: int | None = OF_VERTICES
    ) -> int:
        """Append numbers (k, w) float32 or uint32; return the number of their accessor.

        Parameters
        ----------
        values : (k, w) float32 or uint32
        fields : mapping
            Further fields of the accessor, such as its :func:`bounds`.
        target : int, optional
            Target of their view.
        """
        views, accessors, width = self._tree["bufferViews"], self._tree["accessors"], values.shape[1]
        self._buffer += bytes(-len(self._buffer) % 4)
        view = {"buffer": 0, "byteOffset": len(self._buffer), "byteLength": values.nbytes}
        views.append(view if target is None else {**view, "target": target})
        kind = next(code for code, name in _KINDS.items() if values.dtype == name)
        self._buffer += values.astype(_KINDS[kind]).tobytes()
        accessor = {"bufferView": len(views) - 1, "componentType": kind, "count": len(values)}
        accessors.append({**accessor, "type": "SCALAR" if width == 1 else f"VEC{width}", **fields})
        return len(accessors) - 1

    def close(self) -> None:
        """Update the entry of the first buffer, whose file lacks the new bytes."""
        first = self._tree["buffers"][0]
        first["byteLength"] = len(self._buffer)
        first.pop("uri", None)


def is_surface(primitive: dict[str, Any]) -> bool:
    """Whether a primitive has triangles, in contrast to lines and points."""
    return primitive.get("mode", _TRIANGLES) not in _LINES_AND_POINTS


def triangles_of(gltf: Gltf, primitive: dict[str, Any], size: int) -> np.ndarray:
    """Return the triangles (m, 3) int64 of a primitive with `size` vertices; convert strips and fans.

    Lines and points have no triangles.
    """
    mode = primitive.get("mode", _TRIANGLES)
    if not is_surface(primitive):
        return np.zeros((0, 3), dtype=np.int64)
    if "indices" in primitive:
        ids = gltf.array(primitive["indices"])[:, 0].astype(np.int64)
        if len(ids) and ids.max() >= size:
            raise ValueError(f"a triangle refers to vertex {ids.max()} of {size}")
    else:
        ids = np.arange(size)
    if mode == _TRIANGLES:
        return ids.reshape(-1, 3)
    if mode == _FAN:
        return np.column_stack([ids[1:-1], ids[2:], np.full(max(len(ids) - 2, 0), ids[0])])
    if mode != _STRIP:
        raise ValueError(f"one of its primitives has the unknown mode {mode}")
    return strip_triangles(ids)


def mesh_matrices(tree: dict[str, Any]) -> dict[int, np.ndarray]:
    """Return the matrix (4, 4) that maps each shown mesh to the scene. At most one node shows each mesh."""
    return {tree["nodes"][number]["mesh"]: matrix for number, matrix in node_matrices(tree).items()}


def node_matrices(tree: dict[str, Any]) -> dict[int, np.ndarray]:
    """Return the matrix (4, 4) that maps each node with a mesh to the scene.

    A node is shown if one of the scenes has it, or if the file has no scenes. What is above a node that a
    scene names does not move it. Raises ValueError when a shown node flattens its mesh.
    """
    nodes = tree.get("nodes", [])
    roots = {number for scene in tree.get("scenes", []) for number in scene.get("nodes", [])}
    parent = {child: i for i, node in enumerate(nodes) for child in node.get("children", [])}
    found: dict[int, np.ndarray] = {}
    for number in (number for number, node in enumerate(nodes) if "mesh" in node):
        above, matrix = number, node_matrix(nodes[number])
        for _ in nodes:
            if above in roots or above not in parent:
                break
            above = parent[above]
            matrix = node_matrix(nodes[above]) @ matrix
        else:
            raise ValueError("its nodes are their own ancestors")
        if "scenes" in tree and above not in roots:
            continue
        if not abs(np.linalg.det(matrix[:3, :3])) > 0:
            raise ValueError(f"its node {number} has a scale of zero, which leaves a mesh no volume")
        found[number] = matrix
    return found


def bounds(values: np.ndarray, names: Collection[str] = ("min", "max")) -> dict[str, list[float]]:
    """Return the least and the greatest values (w,) of the numbers (k, w) of an accessor, or one of both.

    NaN, which JSON does not have, counts as 0.
    """
    known = np.nan_to_num(values, nan=0.0)
    return {name: getattr(known, name)(axis=0).astype(np.float64).tolist() for name in names}


def is_embedded(uri: str) -> bool:
    """Whether the address of a buffer or an image holds its bytes."""
    return uri[:5].lower() == "data:"


def node_matrix(node: dict[str, Any]) -> np.ndarray:
    """Return the matrix (4, 4) that maps a node to the coordinates of its parent."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    *axis, w = node.get("rotation", [0.0, 0.0, 0.0, 1.0])
    K = np.cross(np.eye(3), axis)
    R = np.eye(3) + 2 * w * K + 2 * K @ K
    matrix = np.eye(4)
    matrix[:3, :3] = R * np.array(node.get("scale", [1.0, 1.0, 1.0]))
    matrix[:3, 3] = node.get("translation", [0.0, 0.0, 0.0])
    return matrix
