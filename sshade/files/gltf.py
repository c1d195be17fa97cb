"""glTF 2.0 files, .glb and .gltf: positions, normals and tangents change, all other bytes stay.

The vertices of all triangle primitives are read in the order of the meshes of the file, at the places where
the nodes of the scene put them. Where several nodes have a mesh, each node but the first gets a mesh of its
own behind the meshes of the file. Libraries would lay out the buffers anew.

Khronos Group, "glTF 2.0 specification", 2021.
"""

from __future__ import annotations

import base64
import copy
import json
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote, unquote, unquote_to_bytes

import numpy as np

from sshade.core.errors import InputError
from sshade.files.gltf_own import with_own_numbers
from sshade.files.gltf_scene import (
    OF_TRIANGLES,
    Gltf,
    NewAccessors,
    accessor_bytes,
    bounds,
    is_embedded,
    is_surface,
    mesh_matrices,
    require_plain,
    triangles_of,
)
from sshade.files.mesh_file import MeshFile, as_floats, beside, moved_reference, present
from sshade.mesh.mesh import unit_rows
from sshade.mesh.normals import vertex_turns
from sshade.mesh.surface import single_steps

_MAGIC, _JSON, _BINARY = b"glTF", b"JSON", b"BIN\0"
_OTHER_VERSION = "{}: it is a file of glTF {}, and only glTF 2.0 is read; export it again as glTF 2.0"
#: Keys of the JSON whose values are lists of objects.
_LISTS = {"accessors", "animations", "bufferViews", "buffers", "images", "materials", "meshes", "nodes"}
_LISTS |= {"scenes", "skins", "textures"}


class _BufferPart(NamedTuple):
    """Vertices of one accessor of positions.

    Attributes
    ----------
    position : int
        Accessor of the positions.
    normal, tangent : int or None
        Accessors of the normals and tangents.
    first : int
        Id of the first vertex.
    matrix : (4, 4) float64
        Maps the positions of the file to the scene.
    """

    position: int
    normal: int | None
    tangent: int | None
    first: int
    matrix: np.ndarray


def read_gltf(path: Path) -> MeshFile:
    """Read a .glb or a .gltf with its buffers.

    Raises
    ------
    ValueError
        When the file is no glTF 2.0 file, or refers to missing entries.
    InputError
        When there are contents that cannot be deformed: skins, morph targets, compressed buffers, instances
        without nodes.
    """
    gltf, notes, shown = shown_primitives(path)
    parts: dict[tuple, _BufferPart] = {}
    V, F = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)]
    count, rounding = 0, np.zeros(3)
    for primitive, M, corners in shown:
        attributes = primitive["attributes"]
        position, shading = attributes["POSITION"], (attributes.get("NORMAL"), attributes.get("TANGENT"))
        key = accessor_bytes(gltf.tree, position)
        if key not in parts:
            P = gltf.array(position).astype(np.float64)
            with np.errstate(invalid="ignore"):  # an infinite position, which is refused later
                V.append(P if (np.eye(4) == M).all() else P @ M[:3, :3].T + M[:3, 3])
            rounding = np.maximum(rounding, np.abs(M[:3, :3]) @ single_steps(P))
            parts[key] = _BufferPart(position, *shading, count, M)
            count += len(P)
        F.append(parts[key].first + corners)
    rest, triangles = np.concatenate(V), np.concatenate(F)
    content = partial(_content, gltf, list(parts.values()), rest, triangles)
    holds, suffixes = _holds(gltf.tree), (".glb", ".gltf")
    named = tuple(unquote(entry["uri"]) for entry in _outside(gltf.tree))
    shows = [node for node in gltf.tree["nodes"] if "mesh" in node]
    title = {id(p): n.get("name", "") for n in shows for p in gltf.tree["meshes"][n["mesh"]]["primitives"]}
    first = np.cumsum([len(part) for part in F]).tolist()
    titles = tuple(zip(first, [title[id(primitive)] for primitive, _, _ in shown], strict=False))
    return MeshFile(rest, triangles, holds, suffixes, content, notes, rounding, None, path, named, titles)


def shown_primitives(
    path: Path,
) -> tuple[Gltf, tuple[str, ...], list[tuple[dict[str, Any], np.ndarray, np.ndarray]]]:
    """Read a file, and give each mesh numbers of its own.

    Returns
    -------
    gltf : Gltf
    notes : tuple of str
    primitives : list of (dict, (4, 4) float64, (k, 3) int64)
        The primitives that nodes show, their matrices, and the corners of their triangles as numbers of their
        vertices.
    """
    gltf = parsed_gltf(path.read_bytes(), path)
    if not gltf.tree.get("meshes"):
        raise InputError(f"{path}: it has no mesh")
    for number, accessor in enumerate(gltf.tree["accessors"]):
        if "bufferView" in accessor:
            gltf.array(number)  # raises ValueError; normals are used first where the file is written
    gltf, notes = with_own_numbers(gltf)
    shown = []
    for number, M in sorted(mesh_matrices(gltf.tree).items()):
        for primitive in gltf.tree["meshes"][number]["primitives"]:
            size = gltf.tree["accessors"][primitive["attributes"]["POSITION"]]["count"]
            corners = triangles_of(gltf, primitive, size)
            # A mirror turns faces around.
            shown.append((primitive, M, corners[:, ::-1] if np.linalg.det(M[:3, :3]) < 0 else corners))
    return gltf, notes, shown


def parsed_gltf(data: bytes, path: Path) -> Gltf:
    """Return the contents of a .glb or a .gltf; `path` tells where its buffers are.

    Raises
    ------
    ValueError
        When it is no glTF 2.0 file.
    InputError
        When a buffer is not a file beside it, or as :func:`require_plain`.
    """
    text, binary = data, None
    if data[:4] == _MAGIC:
        if (version := int.from_bytes(data[4:8], "little")) != 2:
            raise InputError(_OTHER_VERSION.format(path, version))
        end = 20 + int.from_bytes(data[12:16], "little")
        text = data[20:end]
        if data[end + 4 : end + 8] == _BINARY:
            binary = data[end + 8 : end + 8 + int.from_bytes(data[end : end + 4], "little")]
    tree = json.loads(text)
    if not isinstance(tree, dict) or not isinstance(tree.get("asset"), dict):
        raise ValueError("it names no version of glTF")
    if not str(version := tree["asset"].get("version", "")).startswith("2."):
        raise InputError(_OTHER_VERSION.format(path, str(version)[:20]))
    for name in _LISTS & tree.keys():
        if not isinstance(tree[name], list) or not all(isinstance(one, dict) for one in tree[name]):
            raise ValueError(f"its {name} are no list of objects")
    require_plain(tree, path)  # before the buffers, which gltfpack leaves empty
    buffers = [
        _buffer(one, path, binary if i == 0 else None) for i, one in enumerate(tree.get("buffers", []))
    ]
    return Gltf(path, tree, buffers)


def _outside(tree: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the images whose bytes are in other files."""
    return [image for image in tree.get("images", []) if not is_embedded(image.get("uri", "data:"))]


def _buffer(buffer: dict[str, Any], path: Path, binary: bytes | None) -> bytes:
    uri = buffer.get("uri")
    if uri is None:
        if binary is None:
            raise ValueError("one of its buffers has no bytes")
        data = binary
    elif is_embedded(uri):
        head, _, body = uri.partition(",")
        data = base64.b64decode(body, validate=True) if head.endswith(";base64") else unquote_to_bytes(body)
    else:
        file = beside(path, unquote(uri))
        if not file.is_file():
            raise InputError(f"{path}: its buffer {uri} is missing")
        data = file.read_bytes()
    if len(data) < buffer["byteLength"]:
        raise ValueError(f"a buffer has {len(data)} bytes of the {buffer['byteLength']} announced")
    return data


def _holds(tree: dict[str, Any]) -> tuple[str, ...]:
    primitives = [p for mesh in tree.get("meshes", []) for p in mesh["primitives"]]
    names = {name.partition("_")[0] for p in primitives for name in p["attributes"]}
    return present(
        texture_coordinates="TEXCOORD" in names,
        normals="NORMAL" in names,
        tangents="TANGENT" in names,
        vertex_colours="COLOR" in names,
        attributes_of_its_own="" in names,
        materials=tree.get("materials"),
        images=tree.get("images"),
        animations=tree.get("animations"),
        cameras=tree.get("cameras"),
        scene_of_nodes=len(tree.get("nodes", [])) > 1,
        extensions=tree.get("extensions"),
        lines_and_points=not all(map(is_surface, primitives)),
    )


def _content(
    gltf: Gltf,
    parts: list[_BufferPart],
    rest: np.ndarray,
    F: np.ndarray,
    V: np.ndarray,
    path: Path,
) -> bytes:
    buffers = [bytearray(data) for data in gltf.buffers]
    new = gltf._replace(tree=copy.deepcopy(gltf.tree), buffers=buffers)
    accessors = new.tree["accessors"]
    moved = (rest != V).any(axis=1)
    normals = np.zeros_like(rest)
    for part in parts:
        if part.normal is not None:
            with np.errstate(invalid="ignore"):  # the bytes may be no numbers
                stored = new.array(part.normal).astype(np.float64) @ np.linalg.inv(part.matrix[:3, :3])
            normals[part.first : part.first + len(stored)] = stored
    Q = vertex_turns(normals, F, rest, V)
    turned = (np.eye(3) != Q).any(axis=(1, 2))
    for part in parts:
        vertices = slice(part.first, part.first + accessors[part.position]["count"])
        A, t = part.matrix[:3, :3], part.matrix[:3, 3]
        back = np.linalg.inv(A)
        # The arrays are views of the buffers, which assignments change.
        positions = new.array(part.position)
        changes = moved[vertices]
        positions[changes] = as_floats((V[vertices] - t)[changes] @ back.T, path)
        turns = turned[vertices]
        rotations = Q[vertices][turns]
        if part.normal is not None:
            stored = new.array(part.normal)
            stored[turns] = unit_rows(np.einsum("kij,kj->ki", rotations, normals[vertices][turns]) @ A)
        if part.tangent is not None:
            stored = new.array(part.tangent)
            with np.errstate(invalid="ignore"):
                tangents = stored[turns, :3].astype(np.float64) @ A.T
            stored[turns, :3] = unit_rows(np.einsum("kij,kj->ki", rotations, tangents) @ back.T)
    changed = {accessor_bytes(new.tree, i) for part in parts for i in part[:3] if i is not None}
    for number, accessor in enumerate(accessors):
        if "bufferView" in accessor and accessor_bytes(new.tree, number) in changed:
            accessor |= bounds(new.array(number), accessor.keys() & {"min", "max"})
    return gltf_bytes(new, path)


def gltf_bytes(gltf: Gltf, path: Path) -> bytes:
    """Return the bytes of a .glb, with the first buffer in it, or of a .gltf; all other buffers are embedded.

    Parameters
    ----------
    gltf : Gltf
    path : path
        Where the bytes will be written; its suffix selects the format.
    """
    tree, binary = gltf.tree, path.suffix.lower() == ".glb"
    for number, (buffer, data) in enumerate(zip(tree.get("buffers", []), gltf.buffers, strict=True)):
        if binary and number == 0:
            buffer.pop("uri", None)
        else:
            body = base64.b64encode(data[: buffer["byteLength"]]).decode()
            buffer["uri"] = f"data:application/octet-stream;base64,{body}"
    for entry in _outside(tree):
        name = unquote(entry["uri"])
        moved = moved_reference(name, gltf.source, path)
        entry["uri"] = entry["uri"] if moved == name else quote(moved)
    if not binary:
        return json.dumps(tree, indent=2).encode() + b"\n"
    text = json.dumps(tree, separators=(",", ":")).encode()
    chunks = _chunk(_JSON, text + b" " * (-len(text) % 4))
    if gltf.buffers:
        chunks += _chunk(_BINARY, bytes(gltf.buffers[0]) + bytes(-len(gltf.buffers[0]) % 4))
    return _MAGIC + (2).to_bytes(4, "little") + (12 + len(chunks)).to_bytes(4, "little") + chunks


def _chunk(kind: bytes, content: bytes) -> bytes:
    return len(content).to_bytes(4, "little") + kind + content


def plain_gltf(path: Path, V: np.ndarray, F: np.ndarray) -> bytes:
    """Return a .glb or a .gltf of one mesh with positions (n, 3), as float32, and triangles (m, 3)."""
    if not len(F):
        raise InputError(f"{path}: a glTF file needs a face")
    tree: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "sshade"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [],
        "bufferViews": [],
        "buffers": [{"byteLength": 0}],
    }
    gltf, positions = Gltf(path, tree, [bytearray()]), as_floats(V, path)
    new = NewAccessors(gltf)
    new.add(positions, bounds(positions))
    new.add(F.astype(np.uint32).reshape(-1, 1), target=OF_TRIANGLES)
    new.close()
    return gltf_bytes(gltf, path)
