"""glTF as exporters lay it out: written into the buffers, the rest as it was; what is refused."""

import base64
import json

import numpy as np
import pytest

from sshade import InputError
from sshade.io.meshes import read_arrays, read_file, write_file
from tests.shapes import icosphere

SPHERE = icosphere(2)
HALF = 0.5 * np.sqrt(2.0)
#: A node turned by 90 degrees about x, scaled and moved, as an exporter changes axes.
NODE = {
    "name": "body",
    "mesh": 0,
    "rotation": [HALF, 0, 0, HALF],
    "scale": [2, 2, 2],
    "translation": [0, 1, 0],
}
MIRROR = np.diag([-1.0, 2, 1])
MIRRORED = {"mesh": 0, "matrix": [-1, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1, 0, 3, 0, 0, 1]}
PLACE = np.array([[2.0, 0, 0], [0, 0, -2], [0, 2, 0]])


def exported(*, node=NODE, normals=SPHERE.V, **changes) -> tuple[dict, bytes]:
    """JSON and buffer: interleaved position, normal, tangent, texture; short indices; a second mesh.

    `changes` are values by their paths.
    """
    tangents = np.cross([0.0, 0, 1], SPHERE.V + [1e-9, 0, 0])
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    rows = np.column_stack([SPHERE.V, normals, tangents, np.ones(SPHERE.n), SPHERE.V[:, :2]]).astype("<f4")
    indices = SPHERE.F.astype("<u2").tobytes()
    extra = np.array([[5, 0, 0], [6, 0, 0], [5, 1, 0]], dtype="<f4").tobytes()
    buffer = rows.tobytes() + indices + extra + b"\x01\x02\x03\x04picture!"
    low, high = rows[:, :3].min(axis=0).tolist(), rows[:, :3].max(axis=0).tolist()
    at = {"bufferView": 0, "componentType": 5126, "count": SPHERE.n}
    attributes = {"POSITION": 0, "NORMAL": 1, "TANGENT": 2, "TEXCOORD_0": 3}
    tree = {
        "asset": {"version": "2.0", "generator": "Khronos glTF Blender I/O v4.2.60"},
        "scene": 0,
        "scenes": [{"nodes": [1]}],
        "nodes": [node, {"name": "root", "children": [0, 2], "extras": {"kept": [1.5, "ü"]}}, {"mesh": 1}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"bufferView": 3, "mimeType": "image/png"}],
        "meshes": [
            {"primitives": [{"attributes": attributes, "indices": 4, "material": 0}]},
            {"primitives": [{"attributes": {"POSITION": 5}}]},
        ],
        "accessors": [
            {**at, "type": "VEC3", "min": low, "max": high},
            {**at, "type": "VEC3", "byteOffset": 12},
            {**at, "type": "VEC4", "byteOffset": 24},
            {**at, "type": "VEC2", "byteOffset": 40},
            {"bufferView": 1, "componentType": 5123, "count": 3 * SPHERE.m, "type": "SCALAR"},
            {"bufferView": 2, "componentType": 5126, "count": 3, "type": "VEC3"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": rows.nbytes, "byteStride": 48},
            {"buffer": 0, "byteOffset": rows.nbytes, "byteLength": len(indices)},
            {"buffer": 0, "byteOffset": rows.nbytes + len(indices), "byteLength": len(extra)},
            {"buffer": 0, "byteOffset": rows.nbytes + len(indices) + len(extra), "byteLength": 12},
        ],
        "buffers": [{"byteLength": len(buffer)}],
    }
    for path, value in changes.items():
        change(tree, path, value)
    return tree, buffer


def change(tree: dict, path: str, value) -> None:
    """Set the value at a path, such as "accessors.4.count"; it may extend a list. ... drops it."""
    *way, last = (int(key) if key.isdecimal() else key for key in path.split("."))
    for key in way:
        tree = tree[key]
    if value is ...:
        del tree[last]
    elif isinstance(tree, list):
        tree[last : last + 1] = [value]
    else:
        tree[last] = value


def glb(tree: dict, buffer: bytes, further: bytes = b"") -> bytes:
    text = json.dumps(tree, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % 4)
    buffer += bytes(-len(buffer) % 4)
    body = len(text).to_bytes(4, "little") + b"JSON" + text
    body += len(buffer).to_bytes(4, "little") + b"BIN\0" + buffer + further
    return b"glTF" + (2).to_bytes(4, "little") + (12 + len(body)).to_bytes(4, "little") + body


def taken_apart(data: bytes) -> tuple[dict, bytes]:
    length = int.from_bytes(data[12:16], "little")
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def table(buffer: bytes) -> np.ndarray:
    return np.frombuffer(buffer, "<f4", 12 * SPHERE.n).reshape(-1, 12)


def test_vertices_stand_where_the_nodes_put_them(tmp_path):
    (tmp_path / "a.glb").write_bytes(glb(*exported()))
    V, F = read_arrays(tmp_path / "a.glb")
    expected = SPHERE.V.astype("f4") @ PLACE.T + [0, 1, 0]
    assert np.allclose(V[:-3], expected, rtol=0, atol=1e-15)
    assert V[-3:].tolist() == [[5, 0, 0], [6, 0, 0], [5, 1, 0]]
    assert np.array_equal(F, [*SPHERE.F, [SPHERE.n, SPHERE.n + 1, SPHERE.n + 2]])


def test_what_does_not_move_stays_byte_by_byte(tmp_path):
    further = (4).to_bytes(4, "little") + b"EXTR" + b"data"
    (tmp_path / "a.glb").write_bytes(glb(*exported(), further))
    file = read_file(tmp_path / "a.glb")
    write_file(tmp_path / "b.glb", file, file.V)
    old, new = ((tmp_path / name).read_bytes() for name in ("a.glb", "b.glb"))
    assert taken_apart(new)[1] == taken_apart(old)[1] and new.endswith(further)
    tree = taken_apart(new)[0]
    triangle = tree["accessors"].pop()
    assert tree == {**taken_apart(old)[0], "accessors": taken_apart(old)[0]["accessors"][:-1]}
    assert "min" not in triangle  # it has none, and gets none


@pytest.mark.parametrize(("node", "M"), [(NODE, PLACE), ({"mesh": 0}, np.eye(3)), (MIRRORED, MIRROR)])
def test_positions_normals_tangents_and_their_bounds_follow(tmp_path, node, M):
    tree, buffer = exported(node=node)
    (tmp_path / "a.glb").write_bytes(glb(tree, buffer))
    file = read_file(tmp_path / "a.glb")
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    write_file(tmp_path / "b.glb", file, file.V @ turn.T + [1, 2, 3])
    assert np.allclose(read_arrays(tmp_path / "b.glb")[0], file.V @ turn.T + [1, 2, 3], atol=1e-6)
    new_tree, new = taken_apart((tmp_path / "b.glb").read_bytes())
    before, after = table(buffer), table(new)
    # In the node's own coordinates, the motion is that of the scene between its matrix and back.
    local = np.linalg.inv(M) @ turn @ M
    expected = before[:, 3:6] @ np.linalg.inv(local)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    assert np.allclose(after[:, 3:6], expected, atol=1e-5)
    expected = before[:, 6:9] @ local.T
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    assert np.allclose(after[:, 6:9], expected, atol=1e-5)
    assert np.array_equal(after[:, 9:], before[:, 9:]) and new[before.nbytes :][-12:] == buffer[-12:]
    accessor = new_tree["accessors"][0]
    assert accessor["min"] == after[:, :3].min(axis=0).tolist() != tree["accessors"][0]["min"]
    assert accessor["max"] == after[:, :3].max(axis=0).tolist()
    new_tree["accessors"][0].update(min=tree["accessors"][0]["min"], max=tree["accessors"][0]["max"])
    assert new_tree == tree


def test_a_gltf_with_buffer_and_images_beside_it(tmp_path):
    tree, buffer = exported()
    tree["buffers"][0]["uri"] = "with%20space.bin"
    tree["images"] = [{"uri": "maps/skin%201.png"}, {"uri": "data:image/png;base64,AAAA"}]
    (tmp_path / "in").mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "in" / "with space.bin").write_bytes(buffer)
    (tmp_path / "in" / "a.gltf").write_text(json.dumps(tree))
    file = read_file(tmp_path / "in" / "a.gltf")
    write_file(tmp_path / "out" / "b.gltf", file, file.V + [1, 0, 0])
    new = json.loads((tmp_path / "out" / "b.gltf").read_text())
    images = [image["uri"] for image in new["images"]]
    assert images == ["../in/maps/skin%201.png", "data:image/png;base64,AAAA"]
    assert np.allclose(read_arrays(tmp_path / "out" / "b.gltf")[0], file.V + [1, 0, 0], atol=1e-6)
    assert (tmp_path / "in" / "with space.bin").read_bytes() == buffer
    data = base64.b64decode(new["buffers"][0]["uri"].partition(",")[2])
    assert np.array_equal(table(data)[:, 9:], table(buffer)[:, 9:])
    # Unmoved, the buffer is referred to where it is; in a .glb it is within.
    write_file(tmp_path / "out" / "c.gltf", file, file.V)
    new = json.loads((tmp_path / "out" / "c.gltf").read_text())
    assert new["buffers"][0]["uri"] == "../in/with%20space.bin"
    write_file(tmp_path / "out" / "d.glb", file, file.V + [1, 0, 0])
    new_tree, new_buffer = taken_apart((tmp_path / "out" / "d.glb").read_bytes())
    assert "uri" not in new_tree["buffers"][0] and new_buffer[: len(data)] == data


@pytest.mark.parametrize(("mode", "expected"), [(5, [[0, 1, 2], [3, 2, 1]]), (6, [[1, 2, 0], [2, 3, 0]])])
def test_strips_and_fans(tmp_path, mode, expected):
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], dtype="<f4").tobytes()
    tree = {
        "asset": {"version": "2.0"},
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": mode}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": len(points)}],
        "buffers": [{"byteLength": len(points)}],
    }
    (tmp_path / "a.glb").write_bytes(glb(tree, points))
    assert read_arrays(tmp_path / "a.glb")[1].tolist() == expected


PRIMITIVE = "meshes.0.primitives.0"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"skins": [{"joints": [0]}]}, "it holds a skin, which cannot be deformed"),
        ({"extensionsUsed": ["KHR_draco_mesh_compression"]}, "compressed buffers"),
        ({"extensionsRequired": ["KHR_mesh_quantization"]}, "quantised positions"),
        ({f"{PRIMITIVE}.mode": 1}, "lines or points"),
        ({f"{PRIMITIVE}.targets": [{}]}, "morph targets"),
        ({"accessors.4.sparse": {"count": 1, "indices": {"bufferView": 1}}}, "it holds sparse accessors"),
        ({"nodes": [{"mesh": 0}, {"mesh": 0}]}, "several nodes show its mesh 0"),
        ({"nodes": [{"mesh": 0, "scale": [1, 0, 1]}]}, "a scale of zero"),
        ({"nodes": [{"mesh": 0, "children": [1]}, {"children": [0]}]}, "their own ancestors"),
        ({"nodes": [{}]}, "no triangles"),
        ({"asset.version": "1.0"}, "version 2"),
        ({"buffers.0.byteLength": 10**9}, "bytes of the"),
        ({"buffers.0.uri": "gone.bin"}, "its buffer gone.bin is missing"),
        ({"buffers.0.uri": "https://a.org/b.bin"}, "not a file beside it"),
        ({"buffers.0.byteLength": 9600}, "reaches out of its buffer"),
        ({"bufferViews.0.byteLength": 8}, "reaches out of its view"),
        ({"bufferViews.0.byteStride": 8, f"{PRIMITIVE}.attributes": {"POSITION": 0}}, "overlap each other"),
        ({f"{PRIMITIVE}.attributes.POSITION": ...}, "no positions"),
        ({f"{PRIMITIVE}.attributes.POSITION": 3}, "POSITION is no VEC3"),
        ({"accessors.2.bufferView": ...}, "TANGENT has no bytes"),
        ({"accessors.4.bufferView": ...}, "have no bytes"),
        ({"accessors.4.componentType": 5126, "accessors.4.count": 12}, "no whole numbers"),
        ({"accessors.4.bufferView": 0, "accessors.4.count": 9}, "refers to vertex"),
        ({"accessors.1.byteOffset": 4}, "shares bytes with another accessor"),
        ({f"{PRIMITIVE}.attributes.NORMAL": 0}, "shares bytes"),
        ({"bufferViews.3.byteOffset": 1000}, "shares bytes"),
    ],
)
def test_files_that_cannot_be_deformed_are_refused(tmp_path, changes, words):
    (tmp_path / "a.glb").write_bytes(glb(*exported(**changes)))
    with pytest.raises(InputError, match=words):
        read_file(tmp_path / "a.glb")
