"""Files as several programs write them keep everything except positions and normals."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from sshade.files.meshes import read_arrays, read_file, write_file, write_mesh
from tests.files import sample
from tests.shapes import as_obj, icosphere
from tests.write import columns, lines, mesh_ply, rows

#: A rotation without rounding errors (x to y, y to z, z to x), and a shift.
TURN = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
SHIFT = np.array([0.5, 0.25, 2.0])
OBJ = {"groups", "comments", "texture coordinates", "materials"}
STUDIO = {"vertex colours", "lines and points"}
OFF = {"vertex colours", "normals", "face colours"}
PLY = {"vertex normals", "vertex colours", "texture coordinates", "face normals", "comments"}
#: Files; which of their words are the first number of a position and of a normal, by the first word of the
#: line or the number of its words; and their further contents. MeshLab writes normals behind colours.
SAMPLES = {
    "blender.obj": ({"v": 1}, {"vn": 1}, OBJ | {"normals", "smoothing groups", "polygons"}),
    "studio.obj": ({"v": 1}, {}, OBJ | STUDIO | {"smoothing groups", "polygons"}),
    "odd.obj": ({"v": 1}, {}, OBJ | STUDIO | {"free form curves and surfaces"}),
    "two_facets.stl": ({"vertex": 1}, {"facet": 2}, set()),
    "meshlab.ply": ({11: 0}, {11: 3, 15: 12, 9: 6}, PLY | {"property quality", "element camera"}),
    "colours.off": ({10: 0, 13: 0}, {10: 3, 13: 3}, OFF | {"polygons", "comments"}),
    "meshlab.off": ({12: 0}, {12: 7}, OFF | {"texture coordinates"}),
}


def rewritten(path: Path, V: np.ndarray) -> bytes:
    out = path.with_name(f"out{path.suffix}")
    write_file(out, read_file(path), V)
    return out.read_bytes()


@pytest.mark.parametrize("name", SAMPLES)
def test_a_turned_text_differs_in_positions_and_normals_alone(here, name):
    text, (positions, normals, holds) = sample(name), SAMPLES[name]
    path = Path(name)
    path.write_bytes(text.encode())
    file = read_file(path)
    assert set(file.lost("a.glb")) == holds and file.lost(f"a{path.suffix.upper()}") == ()
    capitals = path.with_suffix(path.suffix.upper())
    capitals.write_bytes(path.read_bytes())
    assert rewritten(path, file.V) == rewritten(capitals, file.V) == path.read_bytes()
    written = rewritten(path, file.V @ TURN.T + SHIFT).decode()
    turned = 0
    for line, changed in zip(text.splitlines(), written.splitlines(), strict=True):
        old, new = line.split(), changed.split()
        key = old[0] if old and old[0].isalpha() else len(old)
        for first, shift in (positions.get(key), SHIFT), (normals.get(key), 0):
            if first is not None:
                own = slice(first, first + 3)
                expected = np.array(old[own], dtype=float) @ TURN.T + shift
                assert np.array_equal(np.array(new[own], dtype=float), expected)
                new[own] = old[own]
                turned += 1
        assert new == old
    assert turned >= 3 and written.count("\r\n") == text.count("\r\n")


@pytest.mark.parametrize(
    ("faces", "expected"),
    [
        (
            "f 1/1/2 2/1/2 3/1/2 4/1/2\nf 5//2 6//2 7//2 8//2\nf 1//1 3//1 2//1\nf 1//4 2//7 3\n",
            "f 1/1/2 2/1/2 3/1/2 4/1/2\nf 5//3 6//3 7//3 8//3\nf 1//1 3//1 2//1\nf 1//5 2//8 3\n",
        ),
        (
            "f 1/1/-1 2/1/-1 3/1/-1 4/1/-1\nf 5//-1 6//-1 7//-1 8//-1\nf 1//-2 3//-2 2//-2\nf 1//-9 2 3\n",
            "f 1/1/2 2/1/2 3/1/2 4/1/2\nf 5//3 6//3 7//3 8//3\nf 1//1 3//1 2//1\nf 1//-10 2 3\n",
        ),
    ],
)
def test_a_normal_that_many_vertices_share_becomes_several_where_they_turn_apart(here, faces, expected):
    """Two distant squares share one line `vn`, and the second is turned. Some numbers name no normal."""
    square = "v {0} 0 0\nv {1} 0 0\nv {1} 1 0\nv {0} 1 0\n"
    normals = "vt 0 0\nvn 0 0 -1\nvn 0.0 0.0 1.0\n"
    end = "vn 1 0 0\nf 1//{0} 2//{0} 4//{0}\n"
    text = square.format(0, 1) + square.format(8, 9) + normals + faces
    Path("a.obj").write_text(text + end.format(3))
    V = read_arrays("a.obj")[0]
    V[4:] = V[4:] @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]).T  # z to -y
    written = rewritten(Path("a.obj"), V).decode()
    assert written.partition("vt 0 0\n")[2] == normals[7:] + "vn 0.0 -1.0 0.0\n" + expected + end.format(4)


def test_normals_turn_with_the_surface(here):
    """A sphere becomes an ellipsoid, and its normals become the known normals of the ellipsoid."""
    mesh, axes = icosphere(4), np.array([1.0, 1.5, 0.75])
    faces = ["f {0}//{0} {1}//{1} {2}//{2}".format(*face) for face in mesh.F + 1]
    Path("a.obj").write_bytes(lines(rows("v ", mesh.V), rows("vn ", mesh.V), faces))
    out = rewritten(Path("a.obj"), mesh.V * axes).decode().splitlines()
    N = np.array([line.split()[1:] for line in out if line.startswith("vn")], dtype=float)
    true = mesh.V / axes
    true /= np.linalg.norm(true, axis=1, keepdims=True)
    assert np.degrees(np.arccos(np.clip((N * true).sum(axis=1), -1, 1))).max() < 1.0
    assert np.allclose(np.linalg.norm(N, axis=1), 1, atol=2e-6)


@pytest.mark.parametrize("number", ["nan", "-nan(ind)", "-1.#IND", "1.#QNAN000"])
def test_normals_that_are_no_numbers_stay(here, number):
    Path("a.obj").write_text(sample("blender.obj").replace("vn 0.0000", f"vn {number}", 1))
    assert f"vn {number} 0" in rewritten(Path("a.obj"), read_arrays("a.obj")[0] @ TURN.T).decode()


@pytest.mark.parametrize("kind", ["position", "normal"])
def test_a_ply_of_whole_numbers_is_written_with_doubles(here, kind):
    """Floating-point normals of the faces do not hide whole normals of the vertices."""
    whole, sound = columns("char", "nx ny nz", [[0, 0, 127]] * 3), columns("float", "nx ny nz", [[0, 0, 1]])
    V, F = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), [[0, 1, 2]]
    given = {"kind": "int"} if kind == "position" else {"vertex": whole}
    Path("a.ply").write_bytes(mesh_ply(V, F, "", **given, face=sound))
    assert "face normals" in read_file("a.ply").lost("b.ply")
    rewritten(Path("a.ply"), V + 0.25)
    assert np.array_equal(read_arrays("out.ply")[0], V + 0.25)


def test_a_binary_stl_keeps_its_header_its_attributes_and_what_is_behind_its_end(here):
    facet = struct.pack("<12fH", 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0x7C1F)
    head = b"COLOR=abcd".ljust(80) + struct.pack("<I", 1)
    Path("a.stl").write_bytes(head + facet + b"abcd")
    file = read_file("a.stl")
    assert file.notes == ("4 bytes behind its last facet, which stay in the output",)
    assert file.rounding[:2].tolist() == [2**-23] * 2
    assert rewritten(Path("a.stl"), file.V) == head + facet + b"abcd"
    moved = struct.pack("<12fH", 1, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0x7C1F)
    assert rewritten(Path("a.stl"), file.V @ TURN.T) == head + moved + b"abcd"


def test_materials_and_textures_go_along_so_that_other_readers_find_them(here):
    """Readers like trimesh follow no names that lead out of the folder of the mesh."""
    ball = icosphere(1)
    Path("in/maps").mkdir(parents=True)
    Path("out").mkdir()
    Image.new("RGB", (2, 2), (9, 120, 30)).save("in/maps/skin.png")
    Path("in/my skin.mtl").write_text("newmtl skin\nKd 1 1 1\nmap_Kd -s 1 1 1 maps\\skin.png\n")
    Path("in/a.obj").write_text(as_obj(ball.V, ball.F).replace("skin.mtl", "my skin.mtl"))
    posed = Path("out/b.obj")
    for _ in range(2):  # also where the files are there already
        write_file(posed, read_file("in/a.obj"), ball.V)
        assert posed.read_text() == Path("in/a.obj").read_text()
        assert sorted(p.name for p in Path("out").rglob("*.*")) == ["b.obj", "my skin.mtl", "skin.png"]
        assert trimesh.load_mesh(posed, process=False).visual.material.name == "skin"
    # Another file of that name stays, and the output refers to the old place.
    Path("out/maps/skin.png").write_bytes(b"another image")
    write_file(posed, read_file("in/a.obj"), ball.V)
    assert "mtllib ../in/my skin.mtl\n" in posed.read_text()
    assert Path("out/maps/skin.png").read_bytes() == b"another image"


@pytest.mark.parametrize("name", ["a.obj", "a.ply", "a.gltf"])
def test_names_with_backslashes_are_names_in_folders(here, name):
    """The material of the OBJ file is in the folder maps and names its texture from there."""
    ball = icosphere(1)
    Path("in/maps").mkdir(parents=True)
    Path("out").mkdir()
    Path("in/maps/skin.png").write_bytes(b"an image")
    Path("in/maps/skin.mtl").write_text("newmtl skin\nmap_Kd -bm 1 ..\\maps\\skin.png\n")
    if name == "a.obj":
        text = as_obj(ball.V, ball.F)
        Path("in/a.obj").write_text(text.replace("skin.mtl", ".\\maps\\skin.mtl\nmtllib maps\\b.mtl", 1))
    elif name == "a.ply":
        comments = ["comment TextureFile maps\\skin.png"]
        Path("in/a.ply").write_bytes(mesh_ply(ball.V, ball.F, "", comments=comments))
    else:
        write_mesh("in/a.gltf", ball.V, ball.F)
        tree = json.loads(Path("in/a.gltf").read_text())
        Path("in/a.gltf").write_text(json.dumps({**tree, "images": [{"uri": "maps%5Cskin.png"}]}))
    file = read_file(f"in/{name}")
    write_file(f"out/{name}", file, file.V)
    assert Path("out/maps/skin.png").read_bytes() == b"an image"
    assert Path("out/maps/skin.mtl").exists() == (name == "a.obj")
    assert file.notes == (("its material file maps\\b.mtl is not there",) if name == "a.obj" else ())
