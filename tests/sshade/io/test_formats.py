"""OFF, OBJ and STL files as other programs write them; damaged files are refused with their place."""

import struct

import numpy as np
import pytest
import trimesh

from sshade import InputError
from sshade.io.meshes import read_arrays, read_file, write_mesh
from tests.shapes import icosphere

SPHERE = icosphere(1)


def test_they_agree_with_another_reader(tmp_path):
    shape = trimesh.Trimesh(SPHERE.V / 3, SPHERE.F, process=False)
    for name, options in {"a.off": {"digits": 17}, "a.stl": {}, "b.stl": {"file_type": "stl_ascii"}}.items():
        shape.export(tmp_path / name, **options)
        V, F = read_arrays(tmp_path / name)
        other = trimesh.load(tmp_path / name, process=False, maintain_order=True)
        assert np.array_equal(V, other.vertices) and np.array_equal(F, other.faces), name


def test_another_reader_agrees_with_what_is_written_as_stl(tmp_path):
    V = np.concatenate([SPHERE.V / 3, [[0.5, 0, 0]]])
    F = np.concatenate([SPHERE.F, [[0, 0, SPHERE.n]]])  # a face without area
    write_mesh(tmp_path / "a.stl", V, F)
    with (tmp_path / "a.stl").open("rb") as file:
        found = trimesh.exchange.stl.load_stl_binary(file)
    corners = V.astype("f4")[F]
    assert np.array_equal(found["vertices"][found["faces"]], corners)
    expected = trimesh.Trimesh(V, SPHERE.F, process=False).face_normals
    assert np.allclose(found["face_normals"][:-1], expected, rtol=0, atol=1e-6)
    assert not found["face_normals"][-1].any()


OFF = """\
CNOFF # with colours
5 3 0

0 0 0  0 0 1  255 0 0 255
1 0 0  0 0 1  0 255 0 255 # a corner
1 1 0  0 0 1  0 0 255 255
0 1 0  0 0 1  0 0 255 255
2 0.5 0  0 0 1  0 0 255 255
4 0 1 2 3
3 1 4 2 0.5 0.5 0.5
3 0 2 3
"""


def test_off_with_comments_colours_and_polygons(tmp_path):
    one_line_head = OFF.replace("CNOFF # with colours\n5", "CNOFF 5")
    for text in (OFF, OFF.replace("\n", "\r\n"), OFF.replace("\n", "\r"), one_line_head):
        (tmp_path / "a.off").write_bytes(text.encode())
        V, F = read_arrays(tmp_path / "a.off")
        assert V.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0.5, 0]]
        assert F.tolist() == [[0, 1, 2], [0, 2, 3], [1, 4, 2], [0, 2, 3]]


STL = """\
solid two
  facet normal 0 0 1
    outer loop
      vertex 0 0 0
      vertex 1 0 0
      vertex 0 1 0
    endloop
  endfacet
  facet normal 0 0 1
    outer loop
      vertex 1 0 0
      vertex 1 1e0 0
      vertex 0 1 0
    endloop
  endfacet
endsolid two
"""


@pytest.mark.parametrize("text", [STL, STL.upper(), STL.replace("\n", "\r\n"), "\n" + STL.replace("  ", "")])
def test_stl_as_text(tmp_path, text):
    (tmp_path / "a.stl").write_bytes(text.encode())
    V, F = read_arrays(tmp_path / "a.stl")
    assert V.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert F.tolist() == [[0, 1, 2], [3, 4, 5]]


def test_a_text_that_ends_anywhere_but_at_its_end_is_refused(tmp_path):
    whole = STL.rstrip()
    for end in range(6, len(whole) - len("endsolid two") + 1, 3):
        (tmp_path / "a.stl").write_text(whole[:end])
        with pytest.raises(InputError, match="not a readable STL file"):
            read_file(tmp_path / "a.stl")


OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\n"


@pytest.mark.parametrize(
    ("suffix", "sound", "old", "new", "words"),
    [
        (".off", OFF, "CNOFF", "PLY", "does not begin with OFF"),
        (".off", OFF, "CNOFF", "4OFF", "do not have three coordinates"),
        (".off", OFF, "CNOFF", "nOFF", "do not have three coordinates"),
        (".off", OFF, "5 3 0", "5", "does not say how many"),
        (".off", OFF, "5 3 0", "5 4 0", "5 vertices and 4 faces are announced, 8 lines follow"),
        (".off", OFF, "5 3 0", "-5 13 0", "announced"),
        (".off", OFF, "2 0.5 0  0 0 1  0 0 255 255", "2 0.5", "line 8: a vertex needs three coordinates"),
        (".off", OFF, "2 0.5 0  0", "2 0.5 x  0", "could not convert"),
        (".off", OFF, "4 0 1 2 3", "4 0 1 2", "line 9: a face needs"),
        (".off", OFF, "3 0 2 3", "2 0 3", "line 11: a face needs"),
        (".off", OFF, "3 0 2 3", "3 0 2 3.5", "is no whole number"),
        (".obj", OBJ, "1 0 0", "1 0", "line 2: a vertex needs three"),
        (".obj", OBJ, " 3//1", "", "line 5: a face needs three"),
        (".obj", OBJ, " 3//1", " 3//0", "line 5: .*counted from 1"),
        (".obj", OBJ, " 3//1", " 3//2", "a normal outside 1..1"),
        (".obj", OBJ, " 3//1", " 3//-2", "line 5: .*more normals than there are above it"),
        (".stl", STL, "endsolid two", "endsolid\n" + STL, "2 meshes; write each mesh"),
        (".stl", STL, STL[STL.index("\n") :], "\nendsolid", "no triangles"),
        (".stl", STL, "vertex 1 1e0 0", "vertex 1 1e0", "line 12: a vertex needs three"),
        (".stl", STL, "vertex 1 1e0 0", "vertex 1 1 1 1", "line 12 has more than three"),
        (".stl", STL, "vertex 1 1e0 0", "vertex 1 1e0 z", "could not convert"),
        (".stl", STL, "      vertex 1 1e0 0\n", "", "line 13 ends a facet .* not have three vertices"),
        (".stl", STL, "endsolid two", "", "ends within a solid"),
        (".stl", STL, "  endfacet\n  facet", "  endfaces\n  facet", "line 8 is not understood: 'endfaces'"),
        (".stl", STL, "endsolid two", "endsolid\nvertex 1 2 3", "line 17 is not understood"),
        (".stl", STL, STL, "<html>", "neither a text that begins with solid, nor"),
    ],
)
def test_damaged_files_are_refused_with_their_place(tmp_path, suffix, sound, old, new, words):
    assert sound.count(old) == 1
    path = tmp_path / f"a{suffix}"
    path.write_text(sound)
    read_file(path)
    path.write_text(sound.replace(old, new))
    with pytest.raises(InputError, match=rf"a\{suffix}: .*{words}"):
        read_file(path)


def test_a_binary_stl_that_begins_with_solid_and_one_of_another_length(tmp_path):
    write_mesh(tmp_path / "a.stl", SPHERE.V, SPHERE.F)
    data = b"solid" + (tmp_path / "a.stl").read_bytes()[5:]
    (tmp_path / "a.stl").write_bytes(data)
    assert np.array_equal(read_file(tmp_path / "a.stl").V, SPHERE.V.astype("f4")[SPHERE.F].reshape(-1, 3))
    for wrong in (data[:-1], data + b"\0", data[:80] + struct.pack("<I", SPHERE.m + 1) + data[84:]):
        (tmp_path / "a.stl").write_bytes(wrong)
        with pytest.raises(InputError, match="not a readable STL file"):
            read_file(tmp_path / "a.stl")
    (tmp_path / "a.stl").write_bytes(bytes(84))
    with pytest.raises(InputError, match="no triangles"):
        read_file(tmp_path / "a.stl")
