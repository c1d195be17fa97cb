"""PLY, OFF, OBJ and STL files as other programs write them, numbers in text, and messages about damage."""

from pathlib import Path

import numpy as np
import pytest

from sshade import InputError
from sshade.files.mesh_file import MeshFile
from sshade.files.meshes import read_arrays, read_file, write_file
from sshade.files.numbers_in_text import Text, rows_of
from tests.files import sample
from tests.shapes import icosphere
from tests.write import columns, lines, mesh_ply, obj, off, ply, rows

BALL = icosphere(1)
OFF, STL = sample("colours.off"), sample("two_facets.stl")


def stored(name: str, text: str) -> MeshFile:
    Path(name).write_bytes(text.encode())
    return read_file(name)


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


SHADED_FACES = [f"f {a}//1 {b}//2 {c}//3" for a, b, c in BALL.F + 1]
SHADED = lines(rows("v ", BALL.V), rows("vn ", BALL.V[:6]), SHADED_FACES)
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


@pytest.mark.parametrize("words", ["nan nan nan", "- - -", "", "1.#J 1.#QO 0", "-nan(0x8) nan -NaN", "0 0"])
def test_normals_of_an_stl_that_are_no_numbers_stay(here, words):
    """They say nothing that the corners do not; other normals turn."""
    first = next(line for line in STL.splitlines() if "facet normal" in line)
    text = STL.replace(first, f"  facet normal {words}", 1)
    file = stored("a.stl", text)
    assert np.array_equal(file.V, stored("b.stl", STL).V)
    write_file("b.stl", file, file.V[:, [1, 2, 0]])
    found = [line for line in Path("b.stl").read_text().splitlines() if "facet normal" in line]
    assert found[0] == f"  facet normal {words}" and found[1].split()[2:] != ["0", "0", "1"]


SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 3]])
POLYGONS = [(0, 1, 2, 3), (1, 4, 2), (3, 2, 1, 0), (4, 1, 0)]
FANNED = [[0, 1, 2], [0, 2, 3], [1, 4, 2], [3, 2, 1], [3, 1, 0], [4, 1, 0]]
PAIRS = [[], [0.5], [0.5, 0.5], []]
#: Older versions of MeshLab write texture coordinates and flags that their header does not declare.
OLD_MESHLAB = sample("old_meshlab.ply")


def mixed(order: str, *, points=SQUARE, position="double", count="uchar", corner="int") -> bytes:
    """Return a PLY file of vertices with a colour and a list, edges to skip, and faces with a second list."""
    x, y, z = columns(position, "x y z", points)
    owners = ("owners", "uchar ushort", [range(i % 3) for i in range(len(points))])
    elements = {
        "vertex": [x, ("red", "uchar", [200] * len(points)), y, z, owners],
        "edge": [("vertex1", "int", [7, 8]), ("more", "uchar short", [[], [-5, 6]])],
        "face": [("vertex_index", f"{count} {corner}", POLYGONS), ("uv", "uchar float", PAIRS)],
    }
    return ply(order, elements, comments=["comment TextureFile ../secret.png", "obj_info nothing"])


def stored_ply(content: bytes) -> MeshFile:
    Path("a.ply").write_bytes(content)
    return read_file("a.ply")


@pytest.mark.parametrize("order", ["", "<", ">"])
@pytest.mark.parametrize(
    ("position", "count", "corner"),
    [("double", "uchar", "int"), ("float", "char", "ushort"), ("int", "uint", "uchar")],
)
def test_types_and_byte_orders_are_read_and_stay(here, order, position, count, corner):
    kinds = {"position": position, "count": count, "corner": corner}
    file = stored_ply(mixed(order, **kinds))
    assert file.V.dtype == np.float64 and np.array_equal(file.V, SQUARE)
    assert file.F.dtype == np.int64 and file.F.tolist() == FANNED
    renamed = mixed(order, **kinds).replace(b"double", b"float64").replace(b"ushort", b"uint16")
    assert np.array_equal(stored_ply(renamed).V, SQUARE)
    if position != "int":
        write_file("b.ply", file, file.V[:, [1, 2, 0]] + 0.5)
        assert Path("b.ply").read_bytes() == mixed(order, points=SQUARE[:, [1, 2, 0]] + 0.5, **kinds)


@pytest.mark.parametrize("order", ["", "<"])
def test_any_end_but_the_last_byte_is_too_early(here, order):
    whole = mixed(order)
    # A cut in the last number of a text cannot be detected.
    for end in [*range(0, len(whole) - 2, 7), len(whole) - 1 - 2 * (order == "")]:
        with pytest.raises(InputError, match="ends within|its header|begin with ply|is no number|empty"):
            stored_ply(whole[:end])


def test_rows_of_a_text_may_go_on_in_the_next_line(here):
    header, end, rows = mixed("").partition(b"end_header\n")
    assert stored_ply(header + end + rows.replace(b" ", b"\n")).F.tolist() == FANNED


@pytest.mark.parametrize(("end", "mark"), [("\n", ""), ("\r\n", "\ufeff")])
def test_further_values_on_lines_of_a_text_stay(here, end, mark):
    text = mark + OLD_MESHLAB.replace("\n", end)
    file = stored_ply(text.encode())
    assert np.array_equal(file.V, SQUARE)
    assert file.F.tolist() == [[0, 1, 2], [0, 1, 4], [0, 4, 3], [2, 3, 4]]
    note = "further values than the header declares stay as they are: 4 lines, from line 12"
    assert file.notes == (note,) and file.holds == ("undeclared values", "polygons", "comments")
    write_file("b.ply", file, file.V + [0, 0, 2])
    moved = text
    for x, y in (0, 0), (1, 0), (1, 1), (0, 1):
        moved = moved.replace(f"{end}{x} {y} 0", f"{end}{x} {y} 2.0", 1)
    moved = moved.replace(f"{end}2 0 3", f"{end}2 0 5.0")
    assert Path("b.ply").read_bytes() == moved.encode()


@pytest.mark.parametrize("rows", [[[0, 1, 3, 2, 2, 4, -1, 4, 1, 0]], [[0, 1, 3, 2, 2], [4, 1, 0, 0, 0]]])
@pytest.mark.parametrize("order", ["", ">"])
def test_triangle_strips_of_scans(here, order, rows):
    """Two strips, the first with a repeated vertex, behind a face that has a normal."""
    elements = {
        "vertex": columns("float", "x y z", SQUARE),
        "face": [("vertex_indices", "uchar int", [(0, 1, 2)]), *columns("float", "nx ny nz", [[0, 0, 1]])],
        "tristrips": [("vertex_indices", "int int", rows)],
    }
    file = stored_ply(ply(order, elements))
    assert file.F.tolist() == [[0, 1, 2], [0, 1, 3], [2, 3, 1], [4, 1, 0]]
    assert file.holds == ("face normals", "triangle strips")
    write_file("b.ply", file, file.V[:, [1, 2, 0]])
    assert np.array_equal(read_arrays("b.ply")[0], file.V[:, [1, 2, 0]])
    assert np.array_equal(read_arrays("b.ply")[1], file.F)


def test_normals_of_vertices_and_faces_turn_with_the_surface_where_they_are(here):
    """Two triangles in a plane; the second turns from z to y."""
    V = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 0, 0], [6, 0, 0], [5, 1, 0.0]])
    vertex = columns("double", "normal_x normal_y normal_z", [[0, 0, 1]] * 6)
    face = columns("double", "nx ny nz", [[0, 0, 1]] * 2)
    file = stored_ply(mesh_ply(V, [[0, 1, 2], [3, 4, 5]], "", vertex=vertex, face=face))
    posed = np.where(np.arange(6)[:, None] < 3, V, V[:, [0, 2, 1]] * [1, -1, 1])
    write_file("b.ply", file, posed)
    words = [line.split() for line in Path("b.ply").read_text().splitlines()[-8:]]
    normals = np.array([line[-3:] for line in words], dtype=float)
    np.testing.assert_allclose(normals[[0, 1, 2, 6]], [[0, 0, 1]] * 4, atol=1e-12)
    np.testing.assert_allclose(normals[[3, 4, 5, 7]], [[0, -1, 0]] * 4, atol=1e-12)


RNG = np.random.default_rng(0)
DOUBLES = np.concatenate(
    [
        RNG.integers(0, 2**64, 5000, dtype=np.uint64).view(np.float64),
        np.round(100 * RNG.standard_normal(1000), 4),
        [0.0, -0.0, 5e-324, 1.7976931348623157e308, 1e16, 1e-4, np.inf, -np.inf, np.nan],
    ]
)
#: Half way between two doubles, and next to it; the least and greatest; numbers that become zero or infinite.
EDGES = """9007199254740993 9007199254740992.5 9007199254740993.0000000000001 4503599627370496.5
1.7976931348623159e308 2.4703282292062327e-324 2.4703282292062328e-324 1e400 1e-400 .5 5. 0e999
00000000000000000000000000000000000000007 1e00000000000000000000005 -Infinity inf nan"""


@pytest.mark.parametrize("text", [rows_of("", DOUBLES[:, None]).decode(), EDGES, EDGES + " 1_0"])
def test_numbers_are_read_as_by_float(text):
    expected = np.array([float(word) for word in text.split()])
    found = Text(text.encode()).numbers(slice(None)).value
    assert np.array_equal(found, expected, equal_nan=True)
    assert np.array_equal(np.signbit(found), np.signbit(expected))


def test_numbers_are_written_as_by_repr():
    assert rows_of("v ", DOUBLES[:, None]).decode() == "".join(f"v {x!r}\n" for x in DOUBLES.tolist())


@pytest.mark.parametrize("word", [".", "e5", "1e+", "1.2.3", "1-2", "--1", "0x10", "1f", "nan(1)", "1\0"])
def test_words_that_are_no_numbers_are_refused(word):
    with pytest.raises(ValueError, match="is no number"):
        Text(f"7 {word} 8".encode()).numbers(slice(None))


def test_whole_numbers():
    text = Text(b"0 -1 +12 007 123456789012345678 -123456789012345678")
    assert text.integers(text.begin, text.end).tolist() == [int(word) for word in text.data.split()]
    for word in (b"1.0", b"x", b"-", b"- 7", b"1_0", b"1-2", b"1234567890123456789"):
        text = Text(b"5 " + word)
        with pytest.raises(ValueError, match="is no whole number"):
            text.integers(text.begin, text.end)
