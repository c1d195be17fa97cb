"""Read glTF files for the checks: each mesh as often as a node shows it, in the order of the nodes."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from scipy.spatial.transform import Rotation

_KINDS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
#: Lists of the tree whose entries may be laid out anew.
_LAYOUT = ("buffers", "bufferViews", "accessors", "meshes", "nodes", "scenes", "images")


def read_gltf(path: Path) -> tuple[np.ndarray, np.ndarray, Any, float]:
    """Return positions (n, 3), triangles (m, 3), all other contents, and the largest stored coordinate."""
    tree, buffers = _parsed(path)
    V, F, rest, size, count = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)], [], 0.0, 0
    for name, mesh, M in _shown(tree):
        first: dict[int, int] = {}  # primitives of a mesh may share their positions
        for primitive in tree["meshes"][mesh]["primitives"]:
            arrays = {k: _array(tree, buffers, i) for k, i in primitive["attributes"].items()}
            P = arrays["POSITION"].astype(np.float64)
            normals = arrays.get("NORMAL", np.zeros(1))
            assert np.isfinite(normals).all(), "a normal is not finite"
            ids = np.arange(len(P))
            if "indices" in primitive:
                ids = _array(tree, buffers, primitive["indices"])[:, 0].astype(np.int64)
            if (position := primitive["attributes"]["POSITION"]) not in first:
                first[position], count = count, count + len(P)
                V.append(P @ M[:3, :3].T + M[:3, 3])
            F.append(first[position] + _triangles(ids, primitive.get("mode", 4)))
            size = max(size, float((np.abs(P) @ np.abs(M[:3, :3]).T + np.abs(M[:3, 3])).max(initial=0)))
            kept = {
                k: a.tobytes()
                for k, a in sorted(arrays.items())
                if k not in ("POSITION", "NORMAL", "TANGENT")
            }
            others = {k: v for k, v in primitive.items() if k not in ("attributes", "indices")}
            rest.append([name, sorted(arrays), kept, others, ids.tolist()])
    images = [_bytes(tree, buffers, image) for image in tree.get("images", [])]
    others = {k: v for k, v in tree.items() if k not in _LAYOUT}
    return np.concatenate(V), np.concatenate(F), [rest, images, others], size


def _parsed(path: Path) -> tuple[dict[str, Any], list[bytes]]:
    data, binary = path.read_bytes(), b""
    text = data
    if data[:4] == b"glTF":
        assert int.from_bytes(data[8:12], "little") == len(data)
        end = 20 + int.from_bytes(data[12:16], "little")
        text = data[20:end]
        binary = data[end + 8 : end + 8 + int.from_bytes(data[end : end + 4], "little")]
    tree = json.loads(text)
    buffers = []
    for buffer in tree.get("buffers", []):
        found = _external(path, buffer["uri"]) if "uri" in buffer else binary
        assert len(found) >= buffer["byteLength"], "a buffer is too short"
        buffers.append(found)
    return tree, buffers


def _external(path: Path, uri: str) -> bytes:
    if uri.startswith("data:"):
        return base64.b64decode(uri.partition(",")[2])
    return (path.parent / unquote(uri)).read_bytes()


def _bytes(tree: dict[str, Any], buffers: list[bytes], image: dict[str, Any]) -> Any:
    if "bufferView" not in image:
        return image["uri"]
    view = tree["bufferViews"][image["bufferView"]]
    begin = view.get("byteOffset", 0)
    return buffers[view["buffer"]][begin : begin + view["byteLength"]]


def _array(tree: dict[str, Any], buffers: list[bytes], number: int) -> np.ndarray:
    accessor = tree["accessors"][number]
    values = _stored(tree, buffers, accessor)
    if "sparse" in accessor:
        sparse = accessor["sparse"]
        parts = {
            "count": sparse["count"],
            "type": accessor["type"],
            "componentType": accessor["componentType"],
        }
        rows = _stored(tree, buffers, {**parts, "type": "SCALAR", **sparse["indices"]})[:, 0]
        values[rows] = _stored(tree, buffers, {**parts, **sparse["values"]})
    if accessor.get("normalized"):
        values = (values / np.iinfo(values.dtype).max).clip(-1, 1)
    return values


def _stored(tree: dict[str, Any], buffers: list[bytes], accessor: dict[str, Any]) -> np.ndarray:
    """Return a copy of the numbers that a view holds; zeros without one."""
    kind, shape = np.dtype(_KINDS[accessor["componentType"]]), (accessor["count"], _WIDTHS[accessor["type"]])
    if "bufferView" not in accessor:
        return np.zeros(shape, kind)
    view = tree["bufferViews"][accessor["bufferView"]]
    begin = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    stride = view.get("byteStride", kind.itemsize * shape[1])
    return np.ndarray(shape, kind, buffers[view["buffer"]], begin, (stride, kind.itemsize)).copy()


def _shown(tree: dict[str, Any]) -> list[tuple[str, int, np.ndarray]]:
    """Return name, mesh and matrix (4, 4) of each node with a mesh."""
    nodes = tree.get("nodes", [])
    if not nodes:
        return [("", number, np.eye(4)) for number in range(len(tree["meshes"]))]
    above = {child: number for number, node in enumerate(nodes) for child in node.get("children", [])}
    found = []
    for number, node in enumerate(nodes):
        if "mesh" in node:
            M, at = _matrix(node), number
            while at in above:
                at = above[at]
                M = _matrix(nodes[at]) @ M
            found.append((node.get("name", ""), node["mesh"], M))
    return found


def _matrix(node: dict[str, Any]) -> np.ndarray:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    M = np.eye(4)
    M[:3, :3] = Rotation.from_quat(node.get("rotation", (0, 0, 0, 1))).as_matrix()
    M[:3, :3] *= np.array(node.get("scale", (1, 1, 1)))
    M[:3, 3] = node.get("translation", (0, 0, 0))
    return M


def triangles_of_strip(strip: Sequence[int]) -> list[tuple[int, int, int]]:
    """Return the triangles of a strip; -1 ends a strip, and another one follows."""
    found, run = [], 0
    for k, c in enumerate(strip):
        run = run + 1 if c >= 0 else 0
        if run >= 3:
            a, b = strip[k - 2 : k]
            found.append((a, b, c) if run % 2 else (b, a, c))
    return found


def _triangles(ids: np.ndarray, mode: int) -> np.ndarray:
    if mode == 4:
        return ids.reshape(-1, 3)
    if mode < 4:  # points and lines
        return np.zeros((0, 3), dtype=np.int64)
    if mode == 6:
        return np.array([(ids[0], b, c) for b, c in zip(ids[1:], ids[2:], strict=False)])
    F = np.array(triangles_of_strip(ids.tolist()))
    return F[(F[:, 0] != F[:, 1]) & (F[:, 1] != F[:, 2]) & (F[:, 0] != F[:, 2])]
