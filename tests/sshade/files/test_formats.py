"""OFF, OBJ and STL files as other programs write them; damaged files are refused with their place."""

from pathlib import Path

import numpy as np
import pytest

from sshade import InputError
from sshade.files.mesh_file import MeshFile
from sshade.files.meshes import read_arrays, read_file, write_file
from tests.files import sample
from tests.shapes import icosphere
from tests.write import lines, mesh_ply, obj, off, rows

BALL = icosphere(1)
OFF, STL = sample("colours.off"), sample("two_facets.stl")
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\n"


def stored(name: str, text: str) -> MeshFile:
    Path(name).write_bytes(text.encode())
    return read_file(name)


@pytest.mark.parametrize(
    ("keyword", "colour", "texture"), [("NCSTOFF", "255 0 0 255", "0.5 0.25"), ("NCOFF", "255 0 0", "")]
)
def test_off_of_meshlab_with_normals_behind_colours(here, keyword, colour, texture):
    """MeshLab writes colours, normals and texture coordinates in this order."""
    points = "".join(f"{place} {colour} 0 0 1 {texture} \n" for place in ("0 0 0", "1 0 0", "0 1 0"))
    file = stored("a.off", f"{keyword}\n3 1 0\n{points}3 0 1 2 9 9 9\n")
    assert file.holds[-3:] == ("normals", "vertex colours", "face colours")
    assert file.holds[:-3] == ("texture coordinates",) * bool(texture)
    write_file("b.off", file, file.V[:, [1, 2, 0]])  # z to y
    assert np.array_equal(read_arrays("b.off")[0], file.V[:, [1, 2, 0]])
    expected = f"{colour} 0 1.0 0.0 {texture}".split()
    assert [line.split()[3:] for line in Path("b.off").read_text().splitlines()[2:5]] == [expected] * 3


def streams() -> dict[str, bytes]:
    """Return OFF files of one mesh, most of which have rows that are no lines."""
    head, counts, *rows = off(BALL.V, BALL.F).splitlines()
    vertices, faces = rows[: BALL.n], rows[BALL.n :]
    broken = [line.replace(b" ", b"\n", 2) for line in faces]
    return {
        "faces on several lines": b"\n".join([head, counts, *vertices, b"# faces", *broken]),
        "one line": b" ".join([head, counts, *rows]),
        "a number on each line": b"\n".join([head, counts, *rows]).replace(b" ", b"\r\n"),
        "counts glued to the keyword, as in ModelNet": b"\n".join([head + counts, *rows]),
        "glued counts of a stream": head + counts + b"\n" + b" ".join(rows),
    }


@pytest.mark.parametrize("name", streams())
def test_off_is_a_stream_of_numbers(here, name):
    data = streams()[name]
    Path("a.off").write_bytes(data)
    file = read_file("a.off")
    assert np.array_equal(file.V, BALL.V) and np.array_equal(file.F, BALL.F)
    write_file("b.off", file, file.V)
    assert Path("b.off").read_bytes() == data
    write_file("b.off", file, file.V + 0.5)
    assert np.array_equal(read_arrays("b.off")[0], BALL.V + 0.5)
    Path("a.off").write_bytes(data + b"\n3")
    with pytest.raises(InputError, match="42 vertices and 80 faces are announced, .* numbers on"):
        read_file("a.off")


def test_a_text_that_ends_behind_a_triangle_gives_a_note_and_elsewhere_it_is_refused(here):
    for end, noted in ("endfacet", True), ("vertex 0 1 0", True), ("vertex 1 1e0", False), (" 0 0 1", False):
        text = STL[: STL.rindex(end) + len(end)]
        if noted:
            assert stored("a.stl", text).notes[0].startswith("solids without a line endsolid: 1 of 1;")
        else:
            with pytest.raises(InputError, match="not a readable STL file"):
                stored("a.stl", text)


@pytest.mark.parametrize(
    "change",
    [str.upper, lambda text: text.replace("\n", "\r\n"), lambda text: "\ufeff" + text.replace("  ", "\t")],
)
def test_several_solids_of_an_stl(here, change):
    """The second solid has no name, the third has no facets, and the fourth has no end."""
    shifted = STL.replace("vertex 0 0 0", "vertex 0 0 7").replace(" two", "")
    unended = "".join(STL.splitlines(keepends=True)[:8])
    text = change(f"{STL}\n{shifted}solid three\nendsolid three\n{unended}")
    file = stored("a.stl", text)
    assert file.F.tolist() == np.arange(15).reshape(5, 3).tolist()
    assert file.V[:, 2].tolist() == [0] * 6 + [7] + [0] * 8
    assert file.notes == ("solids without a line endsolid: 1 of 4; check that the file is complete",)
    assert file.lost("a.ply") == ("solids",)
    write_file("b.stl", file, file.V)
    assert Path("b.stl").read_bytes() == text.encode()


def test_an_obj_with_all_that_tools_write(here):
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
    file = stored("a.obj", text)
    assert file.V.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert file.F.tolist() == [[0, 1, 2], [0, 1, 2]]
    assert "free form curves and surfaces" in file.holds
    write_file("b.obj", file, file.V + [0, 0, 2])
    for old in ("v 0 0 0 #", "v 1 0 0 1.0", "v 0 1 0 0.5 0.25 1"):
        text = text.replace(old, old[:6] + "2.0" + old[7:])
    assert Path("b.obj").read_bytes() == text.encode()


@pytest.mark.parametrize(
    ("suffix", "sound", "old", "new", "words"),
    [
        (".off", OFF, "CNOFF", "4OFF", "do not have three coordinates"),
        (".off", OFF, "5 3 0", "five", "does not say how many"),
        (".off", OFF, "5 3 0", "-5 13 0", "does not say how many"),
        (".off", OFF, "2 0.5 0  0 0 1  0 0 255 255", "2 0.5", "line 8: a vertex needs three coordinates"),
        (".off", OFF, "2 0.5 0  0", "2 0.5 x  0", "is no number"),
        (".off", OFF, "4 0 1 2 3", "4 0 1 2", "line 9: a face needs"),
        (".off", OFF, "3 0 2 3", "2 0 3", "line 11: a face needs"),
        (".off", OFF, "3 0 2 3", "3 0 2 3.5", "is no whole number"),
        (".off", OFF.replace("255 0 0 255", "255"), "CNOFF", "NCOFF", "do not all have a colour"),
        (".obj", OBJ, "1 0 0", "1 0", "line 2: a vertex needs three"),
        (".obj", OBJ, " 3//1", "", "line 5: a face needs three"),
        (".obj", OBJ, "f 1//1", "f -4//1", "line 5: .*more vertices than there are above it"),
        (".stl", STL, "vertex 1 1e0 0", "vertex 1 1e0", "line 12: a vertex needs three"),
        (".stl", STL, "      vertex 1 1e0 0\n", "", "line 9 begins a facet that does not have three"),
        (".stl", STL, "endsolid two", "endsolid\nvertex 1 2 3", "line 9 begins a facet that does not"),
        (".stl", STL, STL, "<html>", "neither a text that begins with solid, nor"),
    ],
)
def test_damaged_files_are_refused_with_their_place(here, suffix, sound, old, new, words):
    assert sound.count(old) == 1
    stored(f"a{suffix}", sound)
    with pytest.raises(InputError, match=rf"a\{suffix}: .*{words}"):
        stored(f"a{suffix}", sound.replace(old, new))


SHADED = lines(
    rows("v ", BALL.V), rows("vn ", BALL.V[:6]), [f"f {a}//1 {b}//2 {c}//3" for a, b, c in BALL.F + 1]
)
#: Files whose lines end in a line feed.
TEXTS = {
    "a.obj": SHADED,
    "b.obj": lines(["o one \\", "two"]) + obj(BALL.V, BALL.F),
    "a.off": off(BALL.V, BALL.F),
    "a.stl": STL.encode(),
    "a.ply": mesh_ply(BALL.V, BALL.F, "", comments=["comment 1"]),
}


@pytest.mark.parametrize("name", [*TEXTS, "binary.ply"])
def test_lines_that_end_in_a_carriage_return_alone(here, name):
    """The output has them, too."""
    if name in TEXTS:
        old, new = TEXTS[name], TEXTS[name].replace(b"\n", b"\r")
    else:
        old = mesh_ply(BALL.V, BALL.F)
        end = old.index(b"end_header") + 11
        new = old[:end].replace(b"\n", b"\r") + old[end:]
    Path(name).write_bytes(old)
    Path(f"cr_{name}").write_bytes(new)
    file, other = read_file(name), read_file(f"cr_{name}")
    assert np.array_equal(other.V, file.V) and np.array_equal(other.F, file.F)
    for V in (file.V, file.V[:, [1, 2, 0]]):
        write_file(f"out_{name}", file, V)
        write_file(f"out_cr_{name}", other, V)
        expected = Path(f"out_{name}").read_bytes()
        expected = expected.replace(b"\n", b"\r") if name in TEXTS else new[:end] + expected[end:]
        assert Path(f"out_cr_{name}").read_bytes() == expected
    with pytest.raises(InputError, match="line 3: "):
        stored("damaged.off", off(BALL.V, BALL.F).decode().replace("\n", "\r").replace("0.0", "x", 1))


@pytest.mark.parametrize(
    "words", ["nan nan nan", "- - -", "", "1.#J 1.#QO 0", "-nan(0x8) nan(snan) -NaN", "0 0"]
)
def test_normals_of_an_stl_that_are_no_numbers_stay(here, words):
    """They say nothing that the corners do not; other normals turn."""
    first = next(line for line in STL.splitlines() if "facet normal" in line)
    text = STL.replace(first, f"  facet normal {words}", 1)
    file = stored("a.stl", text)
    assert np.array_equal(file.V, stored("b.stl", STL).V)
    write_file("b.stl", file, file.V[:, [1, 2, 0]])
    found = [line for line in Path("b.stl").read_text().splitlines() if "facet normal" in line]
    assert found[0] == f"  facet normal {words}" and found[1].split()[2:] != ["0", "0", "1"]
