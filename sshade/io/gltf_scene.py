"""Interpret the JSON of a glTF file: arrays in its buffers, matrices of its meshes, contents to refuse."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sshade.errors import InputError
from sshade.io.triangles import strip_triangles

_KINDS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_FLOAT = 5126
#: Component types of vertex ids.
_INDICES = (5121, 5123, 5125)
#: Attributes that follow a deformation, and their types.
_CHANGED = {"POSITION": "VEC3", "NORMAL": "VEC3", "TANGENT": "VEC4"}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
#: Extensions that are not supported, and the contents that they stand for.
_UNREAD = {
    "KHR_draco_mesh_compression": "compressed buffers",
    "EXT_meshopt_compression": "compressed buffers",
    "KHR_meshopt_compression": "compressed buffers",
    "KHR_mesh_quantization": "quantised positions",
    "EXT_mesh_gpu_instancing": "instances of one mesh",
}


def require_plain(tree: dict[str, Any], path: Path) -> None:
    """Raise InputError if a file has contents that would not follow its positions.

    Raises ValueError if attributes of its primitives do not fit together.
    """
    primitives = [p for mesh in tree.get("meshes", []) for p in mesh["primitives"]]
    used = set(tree.get("extensionsUsed", [])) | set(tree.get("extensionsRequired", []))
    found = [contents for name, contents in _UNREAD.items() if name in used]
    changed = [p["attributes"][a] for p in primitives for a in _CHANGED if a in p["attributes"]]
    accessors = [tree["accessors"][i] for i in changed]
    found += ["a skin"] * bool(tree.get("skins"))
    found += ["morph targets"] * any(p.get("targets") for p in primitives)
    corners = [tree["accessors"][p["indices"]] for p in primitives if "indices" in p]
    found += ["sparse accessors"] * any("sparse" in a for a in accessors + corners)
    found += ["positions or normals that are no floats"] * any(
        a["componentType"] != _FLOAT for a in accessors
    )
    found += ["lines or points"] * any(p.get("mode", _TRIANGLES) < _TRIANGLES for p in primitives)
    if found:
        contents = " and ".join(dict.fromkeys(found))
        raise InputError(f"{path}: it holds {contents}, which cannot be deformed; export it again without")
    for attributes in (primitive["attributes"] for primitive in primitives):
        if "POSITION" not in attributes:
            raise ValueError("one of its primitives has no positions")
        size = tree["accessors"][attributes["POSITION"]]["count"]
        for name in (name for name in _CHANGED if name in attributes):
            accessor = tree["accessors"][attributes[name]]
            if (accessor["type"], accessor["count"]) != (_CHANGED[name], size):
                raise ValueError(f"its attribute {name} is no {_CHANGED[name]} for each position")
            if "bufferView" not in accessor:
                raise ValueError(f"its attribute {name} has no bytes")
    if any(a["componentType"] not in _INDICES or a["type"] != "SCALAR" for a in corners):
        raise ValueError("the corners of its triangles are no whole numbers from 0")
    if any("bufferView" not in a for a in corners):
        raise ValueError("the corners of its triangles have no bytes")


def require_apart(tree: dict[str, Any], buffers: list[bytes], path: Path) -> None:
    """Raise InputError if numbers that change share bytes with each other or with numbers that stay.

    Several accessors may read the same numbers. Accessors of the same normals or tangents must belong to
    the same positions.
    """
    primitives = [p for mesh in tree.get("meshes", []) for p in mesh["primitives"]]
    owner: dict[tuple, tuple] = {}
    for attributes in (primitive["attributes"] for primitive in primitives):
        positions = accessor_bytes(tree, attributes["POSITION"])
        for name in (name for name in _CHANGED if name in attributes):
            key = accessor_bytes(tree, attributes[name])
            if owner.setdefault(key, (name, positions)) != (name, positions):
                _refuse_shared(attributes[name], path)
    uses = [np.zeros(len(data), dtype=np.uint8) for data in buffers]  # of each byte, counted up to 3
    numbers: dict[tuple, int] = {}
    views = [image.get("bufferView") for image in tree.get("images", [])]
    for number, accessor in enumerate(tree["accessors"]):
        if "sparse" in accessor:
            views += [accessor["sparse"][part]["bufferView"] for part in ("indices", "values")]
        if "bufferView" in accessor:
            numbers[accessor_bytes(tree, number)] = number
    for number in numbers.values():
        here = array_of(tree, uses, number).view(np.uint8)
        here += here < 2
    there = range(len(tree["bufferViews"]))
    for view in (tree["bufferViews"][number] for number in views if number in there):
        begin = view.get("byteOffset", 0)
        uses[view["buffer"]][begin : begin + view["byteLength"]] |= 2
    for key in owner:
        if (array_of(tree, uses, numbers[key]).view(np.uint8) > 1).any():
            _refuse_shared(numbers[key], path)


def _refuse_shared(number: int, path: Path) -> None:
    raise InputError(f"{path}: its accessor {number} shares bytes with another accessor; export it again")


def accessor_bytes(tree: dict[str, Any], number: int) -> tuple[int, int, int, int, str]:
    """Return the view, offset, count, component type and type, which identify the bytes of an accessor."""
    accessor = tree["accessors"][number]
    place = accessor["bufferView"], accessor.get("byteOffset", 0), accessor["count"]
    return *place, accessor["componentType"], accessor["type"]


def array_of(tree: dict[str, Any], buffers: list[Any], number: int) -> np.ndarray:
    """Return a (count, width) view of the numbers of an accessor; writable if the buffers are."""
    accessor = tree["accessors"][number]
    view = tree["bufferViews"][accessor["bufferView"]]
    offset, count = accessor.get("byteOffset", 0), accessor["count"]
    kind, width = np.dtype(_KINDS[accessor["componentType"]]), _WIDTHS[accessor["type"]]
    stride = view.get("byteStride", kind.itemsize * width)
    begin = view.get("byteOffset", 0) + offset
    needed = offset + (count - 1) * stride + kind.itemsize * width
    if min(offset, count - 1, stride, begin) < 0 or needed > view["byteLength"]:
        raise ValueError(f"its accessor {number} reaches out of its view")
    if stride < kind.itemsize * width and count > 1:
        raise ValueError(f"the values of its accessor {number} overlap each other")
    if view.get("byteOffset", 0) + view["byteLength"] > tree["buffers"][view["buffer"]]["byteLength"]:
        raise ValueError(f"the view of its accessor {number} reaches out of its buffer")
    buffer = buffers[view["buffer"]]
    return np.ndarray((count, width), kind, buffer, begin, (stride, kind.itemsize))


def triangles_of(
    tree: dict[str, Any], buffers: list[Any], primitive: dict[str, Any], size: int
) -> np.ndarray:
    """Return the triangles (m, 3) int64 of a primitive with `size` vertices; convert strips and fans."""
    if "indices" in primitive:
        ids = array_of(tree, buffers, primitive["indices"])[:, 0].astype(np.int64)
        if len(ids) and ids.max() >= size:
            raise ValueError(f"a triangle refers to vertex {ids.max()} of {size}")
    else:
        ids = np.arange(size)
    mode = primitive.get("mode", _TRIANGLES)
    if mode == _TRIANGLES:
        if len(ids) % 3:
            raise ValueError(f"{len(ids)} corners are announced for triangles")
        return ids.reshape(-1, 3)
    if mode == _FAN:
        return np.column_stack([ids[1:-1], ids[2:], np.full(max(len(ids) - 2, 0), ids[0])])
    return strip_triangles(ids)


def mesh_matrices(tree: dict[str, Any], path: Path) -> dict[int, np.ndarray]:
    """Return the matrix (4, 4) that maps each mesh to the scene; the identity if there are no nodes.

    Raises
    ------
    InputError
        When several nodes show one mesh, so that its vertices have several places, or a node flattens a
        mesh.
    """
    nodes = tree.get("nodes", [])
    if not nodes:
        return {number: np.eye(4) for number in range(len(tree.get("meshes", [])))}
    parent = {child: i for i, node in enumerate(nodes) for child in node.get("children", [])}
    found: dict[int, np.ndarray] = {}
    for number, node in enumerate(nodes):
        if "mesh" not in node:
            continue
        if node["mesh"] in found:
            raise InputError(f"{path}: several nodes show its mesh {node['mesh']}; make it single-user first")
        matrix, above, steps = _matrix(node), number, 0
        while above in parent:
            above, steps = parent[above], steps + 1
            if steps > len(nodes):
                raise ValueError("its nodes are their own ancestors")
            matrix = _matrix(nodes[above]) @ matrix
        if not abs(np.linalg.det(matrix[:3, :3])) > 0:
            raise InputError(f"{path}: its node {number} has a scale of zero, which leaves a mesh no volume")
        found[node["mesh"]] = matrix
    return found


def _matrix(node: dict[str, Any]) -> np.ndarray:
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
