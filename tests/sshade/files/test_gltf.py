"""glTF files as exporters write them: new positions in the buffers, all else unchanged; refused files."""

import base64
import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from sshade import InputError, Mesh
from sshade.files.meshes import MeshFile, read_arrays, read_file, write_file
from tests.gltf import arrays, glb, taken_apart, with_arrays
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
    """Return JSON and buffer: interleaved position, normal, tangent, texture; short indices; a second mesh.

    `changes` maps paths in the JSON to new values.
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
    """Set the value at a path, such as "accessors.4.count", or delete it if `value` is `...`.

    The path may also append an item to a list.
    """
    *way, last = (int(key) if key.isdecimal() else key for key in path.split("."))
    for key in way:
        tree = tree[key]
    if value is ...:
        del tree[last]
    elif isinstance(tree, list):
        tree[last : last + 1] = [value]
    else:
        tree[last] = value


def table(buffer: bytes) -> np.ndarray:
    return np.frombuffer(buffer, "<f4", 12 * SPHERE.n).reshape(-1, 12)


def stored(folder: Path, tree: dict, buffer: bytes) -> MeshFile:
    """Write a.glb and read it."""
    (folder / "a.glb").write_bytes(glb(tree, buffer))
    return read_file(folder / "a.glb")


def test_what_does_not_move_stays_byte_by_byte(tmp_path):
    file = stored(tmp_path, *exported())
    write_file(tmp_path / "b.glb", file, file.V)
    old, new = ((tmp_path / name).read_bytes() for name in ("a.glb", "b.glb"))
    assert taken_apart(new)[1] == taken_apart(old)[1]
    tree = taken_apart(new)[0]
    triangle = tree["accessors"].pop()
    assert tree == {**taken_apart(old)[0], "accessors": taken_apart(old)[0]["accessors"][:-1]}
    assert "min" not in triangle  # an accessor without bounds gets no bounds


@pytest.mark.parametrize(("node", "M"), [(NODE, PLACE), ({"mesh": 0}, np.eye(3)), (MIRRORED, MIRROR)])
def test_positions_normals_tangents_and_their_bounds_follow(tmp_path, node, M):
    tree, buffer = exported(node=node)
    file = stored(tmp_path, tree, buffer)
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    write_file(tmp_path / "b.glb", file, file.V @ turn.T + [1, 2, 3])
    assert np.allclose(read_arrays(tmp_path / "b.glb")[0], file.V @ turn.T + [1, 2, 3], atol=1e-6)
    new_tree, new = taken_apart((tmp_path / "b.glb").read_bytes())
    before, after = table(buffer), table(new)
    # `local` is the turn of the scene in the coordinates of the node.
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
    # Images that are there are copied; a buffer that changes is not.
    (tmp_path / "in" / "maps").mkdir()
    (tmp_path / "in" / "maps" / "skin 1.png").write_bytes(b"image")
    write_file(tmp_path / "out" / "b.gltf", file, file.V + [1, 0, 0])
    assert json.loads((tmp_path / "out" / "b.gltf").read_text())["images"][0]["uri"] == "maps/skin%201.png"
    assert (tmp_path / "out" / "maps" / "skin 1.png").read_bytes() == b"image"
    assert not (tmp_path / "out" / "with space.bin").exists()
    # If nothing moves, a .gltf refers to the old file of the buffer. A .glb contains the buffer.
    write_file(tmp_path / "out" / "c.gltf", file, file.V)
    new = json.loads((tmp_path / "out" / "c.gltf").read_text())
    assert new["buffers"][0]["uri"] == "../in/with%20space.bin"
    write_file(tmp_path / "out" / "d.glb", file, file.V + [1, 0, 0])
    new_tree, new_buffer = taken_apart((tmp_path / "out" / "d.glb").read_bytes())
    assert "uri" not in new_tree["buffers"][0] and new_buffer[: len(data)] == data


def test_what_is_no_number_or_no_letter_stays_out_of_the_json(tmp_path):
    """A vertex without a face is NaN; a name ends within a character; the JSON is padded with zeros."""
    tree, buffer = exported(node={**NODE, "name": "cut\ud800"}, **{"meshes.1.primitives.0.mode": 0})
    tree["accessors"][5] |= {"min": [5, 0, 0], "max": [6, 1, 0]}
    data = bytearray(buffer) + bytes(-len(buffer) % 4)
    at = tree["bufferViews"][2]["byteOffset"]
    data[at : at + 12] = np.full(3, np.nan, "<f4").tobytes()
    text = json.dumps(tree).encode()
    text += bytes(-len(text) % 4)
    sizes = [(12 + 8 + len(text) + 8 + len(data)), len(text), len(data)]
    whole, first, second = (size.to_bytes(4, "little") for size in sizes)
    content = b"glTF\2\0\0\0" + whole + first + b"JSON" + text + second + b"BIN\0" + data
    (tmp_path / "a.glb").write_bytes(content)
    file = read_file(tmp_path / "a.glb")
    assert "lines and points" in file.holds and np.isnan(file.V[SPHERE.n]).all()
    write_file(tmp_path / "b.glb", file, file.V + 1)
    written = (tmp_path / "b.glb").read_bytes()
    length = int.from_bytes(written[12:16], "little")
    found = json.loads(written[20 : 20 + length], parse_constant=pytest.fail)
    assert found["nodes"][0]["name"] == "cut\ud800"


@pytest.mark.parametrize(("mode", "expected"), [(5, [[0, 1, 2], [3, 2, 1]]), (6, [[1, 2, 0], [2, 3, 0]])])
def test_strips_and_fans(tmp_path, mode, expected):
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], dtype="f4")
    tree = {"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": mode}]}]}
    (tmp_path / "a.glb").write_bytes(with_arrays(tree, points))
    assert read_arrays(tmp_path / "a.glb")[1].tolist() == expected


def instanced() -> tuple[dict, bytes]:
    """Return a file in which three nodes show the sphere: turned, moved aside, and mirrored."""
    tree, buffer = exported()
    tree["nodes"] += [{"mesh": 0, "translation": [9, 0, 0], "name": "second"}, MIRRORED]
    tree["nodes"][1]["children"] += [3, 4]
    return tree, buffer


def test_nodes_that_no_scene_shows_keep_their_shape(tmp_path):
    """A hidden node and a shown node have the same mesh. In a file without scenes, both are shown."""
    tree, buffer = exported()
    tree["nodes"] = [{"mesh": 0, "name": "hidden"}, {"mesh": 0}]
    file = stored(tmp_path, tree, buffer)
    assert np.array_equal(file.V, SPHERE.V.astype("f4"))
    write_file(tmp_path / "b.glb", file, file.V + [1, 0, 0])
    new, data = taken_apart((tmp_path / "b.glb").read_bytes())
    assert [node["mesh"] for node in new["nodes"]] == [2, 0]
    hidden = new["meshes"][2]["primitives"][0]["attributes"]["POSITION"]
    assert np.array_equal(arrays(new, data)[hidden], SPHERE.V.astype("f4"))
    del tree["scenes"], tree["scene"]
    assert len(stored(tmp_path, tree, buffer).V) == 2 * SPHERE.n


@pytest.mark.parametrize("suffix", ["glb", "gltf"])
def test_instances_are_written_as_meshes_that_share_what_does_not_move(tmp_path, suffix):
    tree, buffer = instanced()
    if suffix == "gltf":
        tree["buffers"][0]["uri"] = "a.bin"
        (tmp_path / "a.bin").write_bytes(buffer)
        (tmp_path / "a.gltf").write_text(json.dumps(tree))
    else:
        (tmp_path / "a.glb").write_bytes(glb(tree, buffer))
    file = read_file(tmp_path / f"a.{suffix}")
    assert file.notes == ("2 nodes have a mesh that another node has; each gets a mesh of its own",)
    V = file.V.copy()
    V[-SPHERE.n :] = V[-SPHERE.n :, [1, 2, 0]]  # the mirrored instance turns
    for moved in (file.V, V):
        write_file(tmp_path / "b.glb", file, moved)
        again = read_file(tmp_path / "b.glb")
        assert np.allclose(again.V, moved, atol=1e-6) and np.array_equal(again.F, file.F)
        assert again.notes == () and again.holds == file.holds
        shown = trimesh.load(tmp_path / "b.glb", process=False).to_mesh()
        assert np.isclose(Mesh(moved, file.F).volume, Mesh(shown.vertices, shown.faces).volume)
    new, data = taken_apart((tmp_path / "b.glb").read_bytes())
    assert data[: len(buffer)] == buffer
    assert [node.get("mesh") for node in new["nodes"]] == [0, None, 1, 2, 3]
    primitives = [mesh["primitives"][0] for mesh in new["meshes"]]
    names = ("POSITION", "NORMAL", "TANGENT", "TEXCOORD_0")
    found = [[p["attributes"][name] for name in names] for p in primitives if "indices" in p]
    assert found == [[0, 1, 2, 3], [6, 7, 8, 3], [9, 10, 11, 3]]
    assert [(p["indices"], p["material"]) for p in primitives if "indices" in p] == [(4, 0)] * 3
    for number in (6, 9):
        positions, normals = arrays(new, data)[number : number + 2]
        assert "min" in new["accessors"][number]
        moved = number == 9
        assert (positions == SPHERE.V.astype("f4")).all() == (normals == SPHERE.V.astype("f4")).all() != moved


def test_quantised_and_sparse_positions_are_written_as_single_precision(tmp_path):
    """Positions are shorts, and normals are normalised bytes. The first position is sparse."""
    positions = np.round(1000 * SPHERE.V).astype("<i2")
    normals = np.round(127 * SPHERE.V).astype("<i1")
    rows = np.zeros(SPHERE.n, [("p", "<i2", 4), ("n", "<i1", 4)])
    rows["p"][:, :3], rows["n"][:, :3] = positions, normals
    tree, buffer = exported(node={"mesh": 0, "scale": [0.001] * 3})
    begin = len(buffer)
    buffer += rows.tobytes() + np.array([0, 0], "<u2").tobytes() + np.array([2000, 0, 0, 0], "<i2").tobytes()
    tree["buffers"][0]["byteLength"] = len(buffer)
    tree["bufferViews"] += [
        {"buffer": 0, "byteOffset": begin, "byteLength": rows.nbytes, "byteStride": 12},
        {"buffer": 0, "byteOffset": begin + rows.nbytes, "byteLength": 4},
        {"buffer": 0, "byteOffset": begin + rows.nbytes + 4, "byteLength": 8},
    ]
    at = {"bufferView": 4, "count": SPHERE.n, "type": "VEC3"}
    indices = {"bufferView": 5, "componentType": 5123}
    tree["accessors"][0] = {
        **at,
        "componentType": 5122,
        "max": [2000, 1000, 1000],
        "sparse": {"count": 1, "indices": indices, "values": {"bufferView": 6}},
    }
    tree["accessors"][1] = {**at, "byteOffset": 8, "componentType": 5120, "normalized": True}
    tree["extensionsUsed"] = tree["extensionsRequired"] = ["KHR_mesh_quantization"]
    file = stored(tmp_path, tree, buffer)
    expected = positions * 0.001
    expected[0] = [2, 0, 0]
    assert np.allclose(file.V[:-3], expected, atol=1e-12) and np.array_equal(file.F[:-1], SPHERE.F)
    assert file.notes == ("sparse or quantised positions and normals of 1 primitive become float32",)
    write_file(tmp_path / "b.glb", file, file.V + [0, 0, 1])
    again = read_file(tmp_path / "b.glb")
    assert np.allclose(again.V, file.V + [0, 0, 1], atol=1e-6) and again.notes == ()
    new, data = taken_apart((tmp_path / "b.glb").read_bytes())
    accessor = new["accessors"][new["meshes"][0]["primitives"][0]["attributes"]["NORMAL"]]
    view = new["bufferViews"][accessor["bufferView"]]
    written = np.frombuffer(data, "<f4", 3 * SPHERE.n, view["byteOffset"]).reshape(-1, 3)
    assert accessor["componentType"] == 5126 and "normalized" not in accessor
    assert np.allclose(written[1:], normals[1:] / 127, atol=5e-3)


@pytest.mark.parametrize("mode", [0, 1, 3])
def test_lines_and_points_beside_triangles_have_vertices_without_faces(tmp_path, mode):
    file = stored(tmp_path, *exported(**{"meshes.1.primitives.0.mode": mode}))
    assert len(file.V) == SPHERE.n + 3 and np.array_equal(file.F, SPHERE.F)
    write_file(tmp_path / "b.glb", file, file.V + [1, 0, 0])
    assert np.allclose(read_file(tmp_path / "b.glb").V, file.V + [1, 0, 0], atol=1e-6)


PRIMITIVE = "meshes.0.primitives.0"


def sparse(view: int, offset: int) -> dict:
    """Return a sparse entry: its index is a short at an offset of a view, and its value is in view 2."""
    indices = {"bufferView": view, "byteOffset": offset, "componentType": 5123}
    return {"count": 1, "indices": indices, "values": {"bufferView": 2}}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"skins": [{"joints": [0]}]}, "a skin, which cannot be deformed: apply the pose of the skeleton"),
        ({"extensionsUsed": ["EXT_mesh_gpu_instancing"]}, "export each instance as a node"),
        ({"extensionsUsed": ["KHR_draco_mesh_compression"]}, "compressed"),
        ({f"{PRIMITIVE}.mode": 1, "meshes.1.primitives.0.mode": 0}, "no triangles"),
        ({f"{PRIMITIVE}.mode": 7}, "the unknown mode 7"),
        ({"accessors.0.componentType": 5125}, "POSITION has numbers of type 5125"),
        ({"accessors.0.sparse": sparse(0, 2)}, "sparse numbers of its accessor 0 reach beyond"),
        ({"nodes": [{"mesh": 0, "scale": [1, 0, 1]}], "scenes": [{"nodes": [0]}]}, "a scale of zero"),
        ({"nodes": [{"mesh": 0, "children": [0]}], "scenes": [{"nodes": [0]}]}, "their own ancestors"),
        ({"nodes": [{}], "scenes": [{"nodes": [0]}]}, "no triangles"),
        ({"asset.version": "1.0"}, "it is a file of glTF 1.0, and only glTF 2.0 is read"),
        ({"buffers.0.byteLength": 10**9}, "bytes of the"),
        ({"buffers.0.byteLength": 9600}, "reaches out of its buffer"),
        ({"bufferViews.0.byteLength": 8}, "reaches out of its view"),
        ({"bufferViews.0.byteStride": 8, f"{PRIMITIVE}.attributes": {"POSITION": 0}}, "overlap each other"),
        ({f"{PRIMITIVE}.attributes.POSITION": ...}, "no positions"),
        ({f"{PRIMITIVE}.attributes.POSITION": 3}, "POSITION is no VEC3"),
        ({"accessors.2.bufferView": ...}, "TANGENT has no bytes"),
        ({"accessors.4.bufferView": ...}, "have no bytes"),
        ({"accessors.4.componentType": 5126, "accessors.4.count": 12}, "no whole numbers"),
        ({"accessors.4.bufferView": 0, "accessors.4.count": 9}, "refers to vertex"),
    ],
)
def test_files_that_cannot_be_deformed_are_refused(tmp_path, changes, words):
    with pytest.raises(InputError, match=words):
        stored(tmp_path, *exported(**changes))
