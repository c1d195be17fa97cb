"""OFF, OBJ and STL files as other programs write them; damaged files are refused with their place."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from sshade import InputError
from sshade.files.mesh_file import MeshFile
from sshade.files.meshes import read_file, write_file, write_mesh
from tests.files import sample
from tests.shapes import icosphere

SPHERE = icosphere(1)


def stored(path: Path, text: str) -> MeshFile:
    path.write_bytes(text.encode())
    return read_file(path)


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


OFF = sample("colours.off")


def test_off_with_comments_colours_and_polygons(tmp_path):
    one_line, modelnet = (OFF.replace("CNOFF # with colours\n5", head) for head in ("CNOFF 5", "CNOFF5"))
    for text in (OFF, OFF.replace("\n", "\r\n"), OFF.replace("\n", "\r"), one_line, modelnet):
        file = stored(tmp_path / "a.off", text)
        assert file.V.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0.5, 0]]
        assert file.F.tolist() == [[0, 1, 2], [0, 2, 3], [1, 4, 2], [0, 2, 3]]


@pytest.mark.parametrize(
    ("keyword", "colour", "texture"), [("NCSTOFF", "255 0 0 255", "0.5 0.25"), ("NCOFF", "255 0 0", "")]
)
def test_off_of_meshlab_with_normals_behind_colours(tmp_path, keyword, colour, texture):
    """MeshLab writes colours, normals and texture coordinates in this order."""
    points = "".join(f"{place} {colour} 0 0 1 {texture} \n" for place in ("0 0 0", "1 0 0", "0 1 0"))
    file = stored(tmp_path / "a.off", f"{keyword}\n3 1 0\n{points}3 0 1 2 9 9 9\n")
    assert file.holds[-3:] == ("normals", "vertex colours", "face colours")
    assert file.holds[:-3] == ("texture coordinates",) * bool(texture)
    write_file(tmp_path / "b.off", file, file.V[:, [1, 2, 0]])  # z to y
    assert np.array_equal(read_file(tmp_path / "b.off").V, file.V[:, [1, 2, 0]])
    lines = (tmp_path / "b.off").read_text().splitlines()
    expected = f"{colour} 0 1.0 0.0 {texture}".split()
    assert [line.split()[3:] for line in lines[2:5]] == [expected] * 3


STL = sample("two_facets.stl")


def test_a_text_that_ends_behind_a_facet_gives_a_note_and_elsewhere_it_is_refused(tmp_path):
    whole, noted = STL.rstrip(), 0
    for end in range(6, len(whole) - len("endsolid two") + 1):
        (tmp_path / "a.stl").write_text(whole[:end])
        words = whole[:end].split()
        if words.count("endfacet") == words.count("facet") > 0:
            (note,) = read_file(tmp_path / "a.stl").notes
            assert note.startswith("solids without a line endsolid: 1 of 1;")
            noted += 1
        else:
            with pytest.raises(InputError, match="not a readable STL file|no triangles"):
                read_file(tmp_path / "a.stl")
    assert noted


def test_several_solids_of_an_stl(tmp_path):
    """The second solid has no name, the third has no facets, and the fourth has no end."""
    path, lines = tmp_path / "a.stl", STL.splitlines(keepends=True)
    shifted = STL.replace("vertex 0 0 0", "vertex 0 0 7").replace(" two", "")
    text = f"{STL}\n{shifted}solid three\nendsolid three\n" + "".join(lines[:8])
    bare, marked = "\n" + text.replace("  ", ""), "\ufeff" + text.replace("  ", "\t")
    for variant in (text, text.upper(), text.replace("\n", "\r\n"), bare, marked):
        file = stored(path, variant)
        assert file.F.tolist() == np.arange(15).reshape(5, 3).tolist()
        assert file.V[:, 2].tolist() == [0] * 6 + [7] + [0] * 8
        assert file.notes == ("solids without a line endsolid: 1 of 4; check that the file is complete",)
        assert file.lost(tmp_path / "a.ply") == ("solids",)
        write_file(tmp_path / "b.stl", file, file.V)
        assert (tmp_path / "b.stl").read_bytes() == path.read_bytes()
        write_file(tmp_path / "b.stl", file, file.V[:, [1, 2, 0]])  # the facets turn from z to y
        written = (tmp_path / "b.stl").read_bytes().decode().lower().replace("\r\n", "\n")
        assert written.count("normal 0 1.0 0.0\n") >= 4 and written.count("normal") == 5
        names = [line for line in written.splitlines() if "solid" in line]
        assert names == [line for line in variant.lower().splitlines() if "solid" in line]


OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\n"


@pytest.mark.parametrize("coding", ["utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("name", ["a.obj", "a.off"])
def test_a_text_in_utf_16_is_refused(tmp_path, name, coding):
    (tmp_path / name).write_bytes(("\ufeff" + OFF).encode(coding))
    with pytest.raises(InputError, match="a text in UTF-16; save it as UTF-8"):
        read_file(tmp_path / name)


def obj(text: str, tmp_path) -> MeshFile:
    """Read an OBJ file, and check that it is written as it is if nothing moves."""
    file = stored(tmp_path / "a.obj", text)
    write_file(tmp_path / "b.obj", file, file.V)
    assert (tmp_path / "b.obj").read_bytes() == text.encode()
    return file


@pytest.mark.parametrize("nan", ["nan", "-nan(ind)", "-1.#IND"])
def test_normals_that_are_no_numbers_stay(tmp_path, nan):
    file = obj(OBJ.replace("vn 0 0 1", f"vn 0 {nan} 1"), tmp_path)
    write_file(tmp_path / "b.obj", file, file.V[:, [1, 2, 0]])
    assert f"vn 0 {nan} 1\n" in (tmp_path / "b.obj").read_text()
    file = stored(tmp_path / "a.stl", STL.replace("normal 0 0 1", f"normal 0 {nan} 1"))
    write_file(tmp_path / "b.stl", file, file.V[:, [1, 2, 0]])
    assert (tmp_path / "b.stl").read_text().count(f"normal 0 {nan} 1\n") == 2


def test_references_beyond_the_normals_of_an_obj_stay_beyond_where_normals_are_added(tmp_path):
    """Two triangles share a normal, and turn apart; the corners of a third refer to no normal."""
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 5 0 0\nv 6 0 0\nv 5 1 0\nvn 0 0 1\n"
    text += "f 1//1 2//1 3//1\nf 4//-1 5//-1 6//-1\nf 1//2 2//-2 4//7\n"
    file = obj(text, tmp_path)
    V = file.V.copy()
    V[3:] = V[3:, [1, 2, 0]]
    write_file(tmp_path / "b.obj", file, V)
    faces = [line for line in (tmp_path / "b.obj").read_text().splitlines() if line[0] == "f"]
    assert sorted(face[-1] for face in faces[:2]) == ["1", "2"]
    assert faces[2] == "f 1//3 2//-3 4//8"


def test_an_obj_with_all_that_tools_write(tmp_path):
    """Faces before vertices, comments behind numbers and in paths, weights, colours, and unknown lines."""
    text = """\
\ufeffv 0 0 0 # the first vertex
# exported to C:\\meshes\\
v 1 0 0 1.0
o Part#1
g one two
f -2 -1 3 # a face whose last vertex follows
v 0 1 0 0.5 0.25 1
vt 0.5 0.5
vp 0.25
usemtl Red#2
f 1/1/ 2/1 \\
 3/
p 1
l 1 2 3
cstype bezier
curv 0 1 1 2 3
end
"""
    file = obj(text, tmp_path)
    assert file.V.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert file.F.tolist() == [[0, 1, 2], [0, 1, 2]]
    assert "free form curves and surfaces" in file.holds
    write_file(tmp_path / "b.obj", file, file.V + [0, 0, 2])
    old, new = (text.splitlines(), (tmp_path / "b.obj").read_text().splitlines())
    assert [(a, b) for a, b in zip(old, new, strict=True) if a != b] == [
        ("\ufeffv 0 0 0 # the first vertex", "\ufeffv 0 0 2.0 # the first vertex"),
        ("v 1 0 0 1.0", "v 1 0 2.0 1.0"),
        ("v 0 1 0 0.5 0.25 1", "v 0 1 2.0 0.5 0.25 1"),
    ]


@pytest.mark.parametrize(
    ("suffix", "sound", "old", "new", "words"),
    [
        (".off", OFF, "CNOFF", "PLY", "does not begin with OFF"),
        (".off", OFF, "CNOFF", "4OFF", "do not have three coordinates"),
        (".off", OFF, "CNOFF", "nOFF", "do not have three coordinates"),
        (".off", OFF, "5 3 0", "five", "does not say how many"),
        (".off", OFF, "5 3 0", "5 4 0", "5 vertices and 4 faces are announced, .* numbers on 8 lines follow"),
        (".off", OFF, "5 3 0", "-5 13 0", "does not say how many"),
        (".off", OFF, "2 0.5 0  0 0 1  0 0 255 255", "2 0.5", "line 8: a vertex needs three coordinates"),
        (".off", OFF, "2 0.5 0  0", "2 0.5 x  0", "is no number"),
        (".off", OFF, "4 0 1 2 3", "4 0 1 2", "line 9: a face needs"),
        (".off", OFF, "3 0 2 3", "2 0 3", "line 11: a face needs"),
        (".off", OFF, "3 0 2 3", "3 0 2 3.5", "is no whole number"),
        (".obj", OBJ, "1 0 0", "1 0", "line 2: a vertex needs three"),
        (".obj", OBJ, " 3//1", "", "line 5: a face needs three"),
        (".obj", OBJ, "f 1//1", "f -4//1", "line 5: .*more vertices than there are above it"),
        (".off", OFF, "CNOFF # with colours\n", "OFF BINARY\n", "binary OFF file; write it as text"),
        (".off", OFF.replace("255 0 0 255", "255"), "CNOFF", "NCOFF", "do not all have a colour"),
        (".stl", STL, STL[STL.index("\n") :], "\nendsolid", "no triangles"),
        (".stl", STL, "vertex 1 1e0 0", "vertex 1 1e0", "line 12: a vertex needs three"),
        (".stl", STL, "vertex 1 1e0 0", "vertex 1 1 1 1", "line 12 has more than three"),
        (".stl", STL, "vertex 1 1e0 0", "vertex 1 1e0 z", "is no number"),
        (
            ".stl",
            STL,
            "      vertex 1 1e0 0\n",
            "",
            "line 9 begins a facet that does not have three vertices",
        ),
        (".stl", STL, "  endfacet\nendsolid two", "", "ends within a facet"),
        (".stl", STL, "  endfacet\nendsolid two", "endsolid", "ends within a facet"),
        (".stl", STL, "  endfacet\n  facet", "  endfaces\n  facet", "ends within a facet"),
        (".stl", STL, "endsolid two", "endsolid\nvertex 1 2 3", "line 9 begins a facet that does not"),
        (".stl", STL, STL, "<html>", "neither a text that begins with solid, nor"),
    ],
)
def test_damaged_files_are_refused_with_their_place(tmp_path, suffix, sound, old, new, words):
    assert sound.count(old) == 1
    path = tmp_path / f"a{suffix}"
    stored(path, sound)
    with pytest.raises(InputError, match=rf"a\{suffix}: .*{words}"):
        stored(path, sound.replace(old, new))
