"""glTF files as exporters write them: new positions in the buffers, all else unchanged; refused files."""

import base64
import json
from pathlib import Path

import numpy as np
import pytest

from sshade.files.gltf_morph import write_morphs
from sshade.files.mesh_file import MeshFile
from sshade.files.meshes import read_arrays, read_file, write_file
from tests.gltf import arrays, glb, taken_apart
from tests.shapes import icosphere, rotation

SPHERE = icosphere(2)
PRIMITIVE = "meshes.0.primitives.0"
HALF = 0.5 * np.sqrt(2.0)
#: A node turned by 90 degrees about x, scaled and moved, as an exporter changes axes.
NODE = {"mesh": 0, "rotation": [HALF, 0, 0, HALF], "scale": [2, 3, 4], "translation": [0, 1, 0]}
MIRROR = np.diag([-1.0, 2, 1])
MIRRORED = {"mesh": 0, "matrix": [-1, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1, 0, 3, 0, 0, 1]}
PLACE = np.array([[2.0, 0, 0], [0, 0, -4], [0, 3, 0]])


def exported(*, node=NODE, **changes) -> tuple[dict, bytes]:
    """Return JSON and buffer: interleaved position, normal, tangent, texture; short indices; a second mesh.

    `changes` maps paths in the JSON to new values.
    """
    tangents = np.cross([0.0, 0, 1], SPHERE.V + [1e-9, 0, 0])
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    rows = np.column_stack([SPHERE.V, SPHERE.V, tangents, np.ones(SPHERE.n), SPHERE.V[:, :2]]).astype("<f4")
    extra = np.array([[5, 0, 0], [6, 0, 0], [5, 1, 0]], dtype="<f4")
    parts = [rows.tobytes(), SPHERE.F.astype("<u2").tobytes(), extra.tobytes(), b"\x01\x02\x03\x04picture!"]
    begin = np.cumsum([0, *map(len, parts)]).tolist()
    views = [{"buffer": 0, "byteOffset": begin[k], "byteLength": len(parts[k])} for k in range(4)]
    views[0]["byteStride"] = 48
    at = {"bufferView": 0, "componentType": 5126, "count": SPHERE.n}
    bounds = {name: getattr(rows[:, :3], name)(axis=0).tolist() for name in ("min", "max")}
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
            {**at, "type": "VEC3", **bounds},
            {**at, "type": "VEC3", "byteOffset": 12},
            {**at, "type": "VEC4", "byteOffset": 24},
            {**at, "type": "VEC2", "byteOffset": 40},
            {"bufferView": 1, "componentType": 5123, "count": 3 * SPHERE.m, "type": "SCALAR"},
            {"bufferView": 2, "componentType": 5126, "count": 3, "type": "VEC3"},
        ],
        "bufferViews": views,
        "buffers": [{"byteLength": begin[-1]}],
    }
    for path, value in changes.items():
        change(tree, path, value)
    return tree, b"".join(parts)


def change(tree: dict, path: str, value) -> None:
    """Set the value at a path, such as "accessors.4.count", or delete it if `value` is `...`."""
    *way, last = (int(key) if key.isdecimal() else key for key in path.split("."))
    for key in way:
        tree = tree[key]
    if value is ...:
        del tree[last]
    else:
        tree[last] = value


def table(buffer: bytes) -> np.ndarray:
    return np.frombuffer(buffer, "<f4", 12 * SPHERE.n).reshape(-1, 12)


def unit(rows: np.ndarray) -> np.ndarray:
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def stored(tree: dict, buffer: bytes) -> MeshFile:
    Path("a.glb").write_bytes(glb(tree, buffer))
    return read_file("a.glb")


def written(file: MeshFile, V: np.ndarray) -> tuple[dict, bytes]:
    """Write b.glb, check that it reads back, and take it apart."""
    write_file("b.glb", file, V)
    again = read_file("b.glb")
    np.testing.assert_allclose(again.V, V, rtol=0, atol=1e-6)
    assert np.array_equal(again.F, file.F) and again.notes == () and again.holds == file.holds
    return taken_apart(Path("b.glb").read_bytes())


def test_what_does_not_move_stays_byte_by_byte(here):
    tree, buffer = exported()
    file = stored(tree, buffer)
    assert written(file, file.V) == taken_apart(Path("a.glb").read_bytes())
    for suffix in (".glb", ".gltf"):
        for name in (f"b{suffix}", f"B{suffix.upper()}"):
            write_file(name, file, file.V)
            assert read_file(name).holds == file.holds
        assert Path(f"b{suffix}").read_bytes() == Path(f"B{suffix.upper()}").read_bytes()


@pytest.mark.parametrize(("node", "M"), [(NODE, PLACE), ({"mesh": 0}, np.eye(3)), (MIRRORED, MIRROR)])
def test_positions_normals_tangents_and_their_bounds_follow(here, node, M):
    tree, buffer = exported(node=node)
    file = stored(tree, buffer)
    turn = rotation(2)
    new_tree, new = written(file, file.V @ turn.T + [1, 2, 3])
    before, after = table(buffer), table(new)
    local = np.linalg.inv(M) @ turn @ M  # the turn of the scene in the coordinates of the node
    assert np.allclose(after[:, 3:6], unit(before[:, 3:6] @ np.linalg.inv(local)), atol=1e-5)
    assert np.allclose(after[:, 6:9], unit(before[:, 6:9] @ local.T), atol=1e-5)
    assert np.array_equal(after[:, 9:], before[:, 9:]) and new[-12:] == buffer[-12:]
    bounds = {name: getattr(after[:, :3], name)(axis=0).tolist() for name in ("min", "max")}
    tree["accessors"][0] |= bounds
    assert new_tree == tree


def test_a_gltf_with_buffer_and_images_beside_it(here):
    tree, buffer = exported()
    tree["buffers"][0]["uri"] = "with%20space.bin"
    tree["images"] = [{"uri": "maps/skin%201.png"}, {"uri": "data:image/png;base64,AAAA"}]
    Path("in/maps").mkdir(parents=True)
    Path("out").mkdir()
    Path("in/with space.bin").write_bytes(buffer)
    Path("in/a.gltf").write_text(json.dumps(tree))
    file = read_file("in/a.gltf")
    write_file("out/b.gltf", file, file.V + [1, 0, 0])
    assert np.allclose(read_arrays("out/b.gltf")[0], file.V + [1, 0, 0], atol=1e-6)
    new = json.loads(Path("out/b.gltf").read_text())
    assert new["images"] == [{"uri": "../in/maps/skin%201.png"}, tree["images"][1]]
    data = base64.b64decode(new["buffers"][0]["uri"].partition(",")[2])
    assert np.array_equal(table(data)[:, 9:], table(buffer)[:, 9:])
    # Images that are there are copied. Buffers are in the output.
    Path("in/maps/skin 1.png").write_bytes(b"image")
    for suffix in ("gltf", "glb"):
        write_file(f"out/c.{suffix}", file, file.V)
        assert np.array_equal(read_arrays(f"out/c.{suffix}")[0], file.V)
    new_tree, new_buffer = taken_apart(Path("out/c.glb").read_bytes())
    assert "uri" not in new_tree["buffers"][0] and new_buffer[: len(buffer)] == buffer
    assert new_tree["images"][0]["uri"] == "maps/skin%201.png" and Path("out/maps/skin 1.png").exists()
    assert not Path("out/with space.bin").exists()


@pytest.mark.parametrize("mode", [0, 1, 3])
def test_lines_and_points_beside_triangles_have_vertices_without_faces(here, mode):
    """They may lie at NaN, which no JSON holds."""
    tree, buffer = exported(**{"meshes.1.primitives.0.mode": mode})
    tree["accessors"][5] |= {"min": [5, 0, 0], "max": [6, 1, 0]}
    file = stored(tree, buffer[:-48] + np.full(3, np.nan, "<f4").tobytes() + buffer[-36:])
    assert "lines and points" in file.holds and np.array_equal(file.F, SPHERE.F)
    assert len(file.V) == SPHERE.n + 3 and np.isnan(file.V[SPHERE.n]).all()
    write_file("b.glb", file, file.V + 1)
    content = Path("b.glb").read_bytes()
    json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")], parse_constant=pytest.fail)


def test_nodes_that_no_scene_shows_keep_their_shape(here):
    """A hidden node and a shown node have the same mesh. In a file without scenes, both are shown."""
    tree, buffer = exported()
    tree["nodes"] = [{"mesh": 0, "name": "hidden"}, {"mesh": 0}]
    file = stored(tree, buffer)
    assert np.array_equal(file.V, SPHERE.V.astype("f4"))
    write_file("b.glb", file, file.V + [1, 0, 0])
    new, data = taken_apart(Path("b.glb").read_bytes())
    assert [node["mesh"] for node in new["nodes"]] == [2, 0]
    hidden = new["meshes"][2]["primitives"][0]["attributes"]["POSITION"]
    assert np.array_equal(arrays(new, data)[hidden], SPHERE.V.astype("f4"))
    del tree["scenes"], tree["scene"]
    assert len(stored(tree, buffer).V) == 2 * SPHERE.n


@pytest.mark.parametrize("root", [1, 2])
def test_what_is_above_a_node_that_the_scene_names_does_not_move_it(here, root):
    """Exporters of avatars put the scene's node below another one."""
    tree, buffer = exported()
    tree["nodes"] = [
        {"name": "armature", "translation": [9, 9, 9], "children": [1]},
        {"translation": [1, 2, 3], "children": [2]},
        {"mesh": 0, "scale": [2, 2, 2]},
    ]
    tree["scenes"] = [{"nodes": [root]}]
    file = stored(tree, buffer)
    assert np.allclose(file.V, 2 * SPHERE.V + (np.array([1, 2, 3]) if root == 1 else 0), atol=1e-6)
    written(file, file.V + [0, 0, 1])


def test_sparse_accessors_of_what_does_not_move_stay(here):
    """One has no view, which stands for zeros; the other changes numbers of its view."""
    at = {"count": 1, "indices": {"bufferView": 1, "componentType": 5123}, "values": {"bufferView": 2}}
    for change in ({"accessors.3.sparse": at}, {"accessors.3.sparse": at, "accessors.3.bufferView": ...}):
        tree, buffer = exported(**change)
        file = stored(tree, buffer)
        new, data = written(file, file.V + [1, 0, 0])
        assert new["accessors"][3] == tree["accessors"][3] and data[-12:] == buffer[-12:]


def instanced() -> tuple[dict, bytes]:
    """Return a file in which three nodes show the sphere: turned, moved aside, and mirrored."""
    tree, buffer = exported()
    tree["nodes"] += [{"mesh": 0, "translation": [9, 0, 0], "name": "second"}, MIRRORED]
    tree["nodes"][1]["children"] += [3, 4]
    return tree, buffer


def test_targets_of_a_sequence_have_bounds(here):
    file = stored(*exported())
    write_morphs(Path("b.glb"), file, [file.V + 1, 2 * file.V], np.array([0.0, 0.1]), ["one", "two"])
    tree, data = taken_apart(Path("b.glb").read_bytes())
    assert len(arrays(tree, data)) == 6 + 2 * 4 + 2
    targets = [target for mesh in tree["meshes"] for target in mesh["primitives"][0]["targets"]]
    assert all({"min", "max"} <= tree["accessors"][target["POSITION"]].keys() for target in targets)


def test_quantised_positions_are_written_as_single_precision(here):
    """Positions are shorts, and normals are normalised bytes."""
    rows = np.zeros(SPHERE.n, [("p", "<i2", 4), ("n", "<i1", 4)])
    rows["p"][:, :3], rows["n"][:, :3] = np.round(1000 * SPHERE.V), np.round(127 * SPHERE.V)
    tree, buffer = exported(node={"mesh": 0, "scale": [0.001] * 3})
    view = {"buffer": 0, "byteOffset": len(buffer), "byteLength": rows.nbytes, "byteStride": 12}
    tree["bufferViews"].append(view)
    buffer += rows.tobytes()
    tree["buffers"][0]["byteLength"] = len(buffer)
    at = {"bufferView": 4, "count": SPHERE.n, "type": "VEC3"}
    tree["accessors"][0] = {**at, "componentType": 5122, "max": [1000, 1000, 1000]}
    tree["accessors"][1] = {**at, "byteOffset": 8, "componentType": 5120, "normalized": True}
    tree["extensionsUsed"] = tree["extensionsRequired"] = ["KHR_mesh_quantization"]
    file = stored(tree, buffer)
    expected = rows["p"][:, :3] * 0.001
    assert np.allclose(file.V[:-3], expected, atol=1e-12) and np.array_equal(file.F[:-1], SPHERE.F)
    assert file.notes == ("quantised positions and normals of 1 primitive become float32",)
    new, data = written(file, file.V + [0, 0, 1])
    normals = new["meshes"][0]["primitives"][0]["attributes"]["NORMAL"]
    del new["accessors"][:2]  # shorts and bytes
    assert "normalized" not in new["accessors"][normals - 2]
    assert np.allclose(arrays(new, data)[normals - 2], rows["n"][:, :3] / 127, atol=5e-3)


def test_normals_that_are_also_positions_or_those_of_other_positions_get_numbers_of_their_own(here):
    """Normals of a unit sphere are its positions; a smaller sphere inside it has the same normals."""
    turn = rotation(2)
    tree, buffer = exported(node={"mesh": 0}, **{f"{PRIMITIVE}.attributes.NORMAL": 0})
    file = stored(tree, buffer)
    new, data = written(file, file.V @ turn.T + [1, 2, 3])
    normals = new["meshes"][0]["primitives"][0]["attributes"]["NORMAL"]
    assert np.allclose(arrays(new, data)[normals], SPHERE.V @ turn.T, atol=1e-6)

    tree, buffer = exported(node={"mesh": 0})
    tree["accessors"].append({**tree["accessors"][0], "bufferView": 4, "max": [0.5] * 3, "min": [-0.5] * 3})
    tree["bufferViews"].append({"buffer": 0, "byteOffset": len(buffer), "byteLength": 12 * SPHERE.n})
    tree["buffers"][0]["byteLength"] += 12 * SPHERE.n
    attributes = {"POSITION": 6, "NORMAL": 1, "TANGENT": 2}
    tree["meshes"][0]["primitives"].append({"attributes": attributes, "indices": 4})
    file = stored(tree, buffer + (0.5 * SPHERE.V).astype("<f4").tobytes())
    inner = np.arange(len(file.V)) >= SPHERE.n
    new, data = written(file, np.where(inner[:, None], file.V @ turn.T, file.V))
    found = [list(p["attributes"].values())[:3] for p in new["meshes"][0]["primitives"]]
    assert found == [[0, 1, 2], [7, 8, 9]]
    for number, expected in (1, SPHERE.V), (8, SPHERE.V @ turn.T):
        assert np.allclose(arrays(new, data)[number], expected, atol=1e-6)
