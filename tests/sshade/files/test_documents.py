"""Files as several programs write them keep everything except positions and normals."""

import struct

import numpy as np
import pytest
import trimesh
from PIL import Image

import sshade
from sshade.cli.main import main
from sshade.edit.document import Document
from sshade.files.meshes import read_arrays, read_file, write_file, write_mesh
from sshade.files.task_files import write_handles
from tests.files import sample
from tests.shapes import end_handles, icosphere
from tests.sshade.files.test_formats import OFF, STL
from tests.sshade.files.test_ply import SQUARE, ply
from tests.write import columns, mesh_ply

#: A rotation without rounding errors (x to y, y to z, z to x), and a shift.
TURN = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
SHIFT = np.array([0.5, 0.25, 2.0])

BLENDER = sample("blender.obj")

STUDIO = sample("studio.obj")

MESHLAB = sample("meshlab.ply")


def rewritten(path, V):
    out = path.with_name(f"out{path.suffix}")
    write_file(out, read_file(path), V)
    return out


def words(text: str) -> list[list[str]]:
    return [line.split() for line in text.splitlines()]


@pytest.mark.parametrize(
    ("name", "text"),
    [("a.obj", BLENDER), ("a.obj", STUDIO), ("a.ply", MESHLAB), ("a.off", OFF), ("a.stl", STL)],
)
def test_what_does_not_move_stays_byte_by_byte(tmp_path, name, text):
    path = tmp_path / name
    path.write_bytes(text.encode())
    file = read_file(path)
    assert rewritten(path, file.V).read_bytes() == path.read_bytes()
    # If one vertex moves within the plane of its faces, only the line of this vertex changes.
    V = file.V.copy()
    V[-1] += [0, 0.125, 0]
    old, new = (p.read_bytes().splitlines() for p in (path, rewritten(path, V)))
    changed = [(a, b) for a, b in zip(old, new, strict=True) if a != b]
    assert len(changed) == 1 and np.array_equal(read_arrays(tmp_path / f"out{path.suffix}")[0], V)


@pytest.mark.parametrize(
    ("name", "text", "positions", "normals"),
    [
        ("a.obj", BLENDER, {"v": slice(1, 4)}, {"vn": slice(1, 4)}),
        ("a.obj", STUDIO, {"v": slice(1, 4)}, {}),
        ("a.stl", STL, {"vertex": slice(1, 4)}, {"facet": slice(2, 5)}),
        ("a.ply", MESHLAB, {11: slice(3)}, {11: slice(3, 6), 15: slice(12, 15), 9: slice(6, 9)}),
        ("a.off", OFF, {10: slice(3), 13: slice(3)}, {10: slice(3, 6), 13: slice(3, 6)}),
    ],
)
def test_a_turned_text_differs_in_positions_and_normals_alone(tmp_path, name, text, positions, normals):
    """The keys of `positions` and `normals` are the first word of a line, or the number of words."""
    path = tmp_path / name
    path.write_bytes(text.encode())
    V = read_arrays(path)[0]
    out = rewritten(path, V @ TURN.T + SHIFT)
    assert np.array_equal(read_arrays(out)[0], V @ TURN.T + SHIFT)
    assert np.array_equal(read_arrays(out)[1], read_arrays(path)[1])
    turned = 0
    for old, new in zip(words(text), words(out.read_bytes().decode()), strict=True):
        key = old[0] if old and old[0].isalpha() else len(old)
        for places, shift in (positions.get(key), SHIFT), (normals.get(key), 0):
            if places:
                expected = np.array(old[places], dtype=float) @ TURN.T + shift
                assert np.array_equal(np.array(new[places], dtype=float), expected)
                new[places] = old[places]
                turned += 1
        assert new == old
    assert turned >= 4
    assert out.read_bytes().count(b"\r\n") == path.read_bytes().count(b"\r\n")


def test_a_normal_that_many_vertices_share_becomes_several_where_they_turn_apart(tmp_path):
    """Two distant squares share one line `vn`, as Blender writes it. The second square is turned."""
    square = "v {0} 0 0\nv {1} 0 0\nv {1} 1 0\nv {0} 1 0\n"
    for faces in (
        "f 1/1/2 2/1/2 3/1/2 4/1/2\nf 5//2 6//2 7//2 8//2\nf 1//1 3//1 2//1\n",
        "f 1/1/-1 2/1/-1 3/1/-1 4/1/-1\nf 5//-1 6//-1 7//-1 8//-1\nf 1//-2 3//-2 2//-2\n",
    ):
        text = square.format(0, 1) + square.format(8, 9) + "vt 0 0\nvn 0 0 -1\nvn 0.0 0.0 1.0\ns 1\n" + faces
        path = tmp_path / "a.obj"
        path.write_text(text + "vn 1 0 0\nf 1//3 2//3 4//3\n")
        V = read_arrays(path)[0]
        V[4:] = V[4:] @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]).T  # z to -y
        out = rewritten(path, V).read_text()
        assert out.count("vn 0.0 0.0 1.0\n") == 1 and out.count("\nvn ") == 4
        lines = [line.split() for line in out.splitlines()]
        found = {}
        normals: list[list[float]] = []
        for line in lines:
            if line[0] == "vn":
                normals.append([float(x) for x in line[1:]])
            elif line[0] == "f":
                for word in line[1:]:
                    v, _, n = word.split("/")
                    index = int(n) - 1 if int(n) > 0 else len(normals) + int(n)
                    found.setdefault((int(v), len(line)), []).append(normals[index])
        assert all(n == [0, 0, 1] for v in (1, 2, 3, 4) for n in found[v, 5])
        assert all(n == [0, -1, 0] for v in (5, 6, 7, 8) for n in found[v, 5])
        assert found[1, 4] == [[0, 0, -1], [1, 0, 0]]


def test_normals_turn_with_the_surface_and_keep_what_an_artist_set(tmp_path):
    """A sphere becomes an ellipsoid, and its normals become the known normals of the ellipsoid."""
    mesh = icosphere(4)
    lines = [f"v {x!r} {y!r} {z!r}\nvn {x!r} {y!r} {z!r}" for x, y, z in mesh.V.tolist()]
    lines += [f"f {a}//{a} {b}//{b} {c}//{c}" for a, b, c in (mesh.F + 1).tolist()]
    (tmp_path / "a.obj").write_text("\n".join(lines))
    axes = np.array([1.0, 1.5, 0.75])
    out = rewritten(tmp_path / "a.obj", mesh.V * axes).read_text().splitlines()
    N = np.array([line.split()[1:] for line in out if line.startswith("vn")], dtype=float)
    true = mesh.V / axes
    true /= np.linalg.norm(true, axis=1, keepdims=True)
    assert np.degrees(np.arccos(np.clip((N * true).sum(axis=1), -1, 1))).max() < 1.0
    assert np.allclose(np.linalg.norm(N, axis=1), 1, atol=2e-6)


@pytest.mark.parametrize("order", ["binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("position", ["float", "double"])
def test_unknown_properties_and_elements_of_a_binary_ply_survive(tmp_path, order, position):
    path = tmp_path / "a.ply"
    path.write_bytes(ply(order, position=position))
    moved = SQUARE @ TURN.T + SHIFT
    assert rewritten(path, moved).read_bytes() == ply(order, position=position, points=moved)
    assert rewritten(path, SQUARE).read_bytes() == path.read_bytes()


def test_a_ply_of_whole_numbers_is_written_with_doubles(tmp_path):
    path = tmp_path / "a.ply"
    path.write_text(MESHLAB.replace("property float y", "property int y").replace(" 0.5 0 0", " 1 0 0"))
    file = read_file(path)
    assert "vertex colours" in file.lost(path)
    assert np.array_equal(read_arrays(rewritten(path, file.V + 0.25))[0], file.V + 0.25)


def test_a_binary_stl_keeps_its_header_and_attributes(tmp_path):
    path = tmp_path / "a.stl"
    facet = struct.pack("<12fH", 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0x7C1F)
    path.write_bytes(b"COLOR=abcd".ljust(80) + struct.pack("<I", 1) + facet)
    V = read_arrays(path)[0]
    assert rewritten(path, V).read_bytes() == path.read_bytes()
    moved = struct.pack("<12fH", 1, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0x7C1F)
    assert rewritten(path, V @ TURN.T).read_bytes() == path.read_bytes()[:84] + moved


def test_materials_and_textures_go_along_so_that_other_readers_find_them(tmp_path):
    """Readers like trimesh follow no names that lead out of the folder of the mesh."""
    (tmp_path / "in" / "maps").mkdir(parents=True)
    (tmp_path / "out").mkdir()
    ball, image = icosphere(1), Image.new("RGB", (2, 2), (9, 120, 30))
    image.save(tmp_path / "in" / "maps" / "skin.png")
    (tmp_path / "in" / "a.mtl").write_text("newmtl skin\nKd 1 1 1\nmap_Kd -s 1 1 1 maps\\skin.png\n")
    uv = "".join(f"vt {x!r} {y!r}\n" for x, y in ball.V[:, :2].tolist())
    faces = "".join("f {0}/{0} {1}/{1} {2}/{2}\n".format(*(face + 1)) for face in ball.F)
    vertices = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in ball.V.tolist())
    path, posed = tmp_path / "in" / "a.obj", tmp_path / "out" / "b.obj"
    path.write_text(f"mtllib a.mtl\nusemtl skin\n{vertices}{uv}{faces}")
    for _ in range(2):  # also where the files are there already
        write_file(posed, read_file(path), ball.V)
        assert posed.read_text().startswith("mtllib a.mtl\n")
        assert sorted(p.name for p in (tmp_path / "out").rglob("*.*")) == ["a.mtl", "b.obj", "skin.png"]
        assert trimesh.load_mesh(posed, process=False).visual.material.name == "skin"
    # Another file of that name stays, and the output refers to the old place.
    (tmp_path / "out" / "maps" / "skin.png").write_bytes(b"another image")
    write_file(posed, read_file(path), ball.V)
    assert posed.read_text().startswith("mtllib ../in/a.mtl\n")
    assert (tmp_path / "out" / "maps" / "skin.png").read_bytes() == b"another image"


@pytest.mark.parametrize(
    ("line", "moved"),
    [
        ("mtllib maps/one.mtl two.mtl", "mtllib ../in/maps/one.mtl ../in/two.mtl"),
        ("mtllib one.mtl # by a program", "mtllib ../in/one.mtl # by a program"),
        (f"mtllib one.mtl # {'long' * 99}", f"mtllib ../in/one.mtl # {'long' * 99}"),
        ("mtllib not there.mtl", "mtllib ../in/not there.mtl"),
        ("mtllib of it.mtl", None),
        ("mtllib of it #2.mtl", None),
        ("mtllib C:\\models\\one.mtl", None),
        ("mtllib /models/one.mtl", None),
    ],
)
def test_the_name_of_a_library_is_what_programs_read(tmp_path, line, moved):
    """A name may contain blanks and a # if the file exists, which goes along."""
    for name in ("in", "out"):
        (tmp_path / name).mkdir()
    for name in ("of it.mtl", "of it #2.mtl"):
        (tmp_path / "in" / name).write_text("newmtl red\n")
    (tmp_path / "in" / "a.obj").write_text(f"{line}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    file = read_file(tmp_path / "in" / "a.obj")
    write_file(tmp_path / "out" / "a.obj", file, file.V)
    assert (tmp_path / "out" / "a.obj").read_text().startswith((moved or line) + "\n")
    assert [p.name for p in (tmp_path / "out").glob("*.mtl")] == [line[7:]] * ("of it" in line)


def test_a_texture_in_the_comments_of_a_ply_is_named_from_the_new_place(tmp_path):
    for name in ("in", "out"):
        (tmp_path / name).mkdir()
    path = tmp_path / "in" / "a.ply"
    path.write_text(MESHLAB)
    write_file(tmp_path / "out" / "b.ply", read_file(path), read_arrays(path)[0])
    assert (tmp_path / "out" / "b.ply").read_text() == MESHLAB.replace("skin of", "../in/skin of")


def test_what_another_format_loses_is_named(tmp_path):
    found = {}
    for name, text in {"a.obj": BLENDER, "b.obj": STUDIO, "a.ply": MESHLAB, "a.off": OFF}.items():
        path = tmp_path / name
        path.write_text(text)
        file = read_file(path)
        assert file.lost(tmp_path / f"other{path.suffix.upper()}") == ()
        found[name] = set(file.lost(tmp_path / "other.stl"))
        write_file(tmp_path / "other.glb", file, file.V)
        assert np.array_equal(read_arrays(tmp_path / "other.glb")[1], file.F)
    assert found == {
        "a.obj": {"texture coordinates", "normals", "materials", "groups", "smoothing groups", "polygons"}
        | {"comments"},
        "b.obj": {"texture coordinates", "vertex colours", "materials", "groups", "smoothing groups"}
        | {"polygons", "lines and points", "comments"},
        "a.ply": {"vertex normals", "vertex colours", "property quality", "texture coordinates"}
        | {"face normals", "element camera", "comments"},
        "a.off": {"vertex colours", "normals", "face colours", "polygons", "comments"},
    }
    write_mesh(tmp_path / "plain.ply", np.eye(3), np.array([[0, 1, 2]]))
    assert read_file(tmp_path / "plain.ply").lost("a.stl") == ()


def test_all_commands_print_the_notes_of_a_file_once(here, capsys):
    """Each line of a vertex has one more value than the header declares."""
    body = icosphere(1)
    note = "further values than the header declares stay as they are: {} lines, from line 10"
    declared = mesh_ply(body.V, body.F, "", vertex=columns("uchar", "more", np.ones((body.n, 1))))
    (here / "a.ply").write_bytes(declared.replace(b"property uchar more\n", b""))
    write_handles("a.json", end_handles(body.V))
    for command in (
        ["deform", "a.ply", "a.json", "-o", "b.ply", "--vertices", "30"],
        ["remesh", "a.ply", "-o", "proxy.ply", "--map", "map.npz", "--vertices", "30"],
        ["carry", "a.ply", "map.npz", "proxy.ply", "-o", "c.ply"],
        ["reconstruct", "a.ply", "b.ply", "-o", "d.ply", "--vertices", "30", "--samplings", "1"],
    ):
        assert main(command) == 0
        said = capsys.readouterr().err
        assert said.count(f"note: a.ply: {note.format(body.n)}\n") == 1
    with pytest.warns(UserWarning, match=f"a.ply: {note.format(body.n)}"):
        V, F = sshade.read("a.ply")
    assert np.array_equal(V, body.V) and np.array_equal(F, body.F)
    document = Document(here / "a.ply", output=None, handles=None, refuse=False)
    assert document.notes == (note.format(body.n),)
