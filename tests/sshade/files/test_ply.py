"""PLY files: every type and byte order, mixed polygons, and messages about errors."""

from pathlib import Path

import numpy as np
import pytest

from sshade import InputError
from sshade.files.mesh_file import MeshFile
from sshade.files.meshes import read_arrays, read_file, write_file
from tests.files import sample
from tests.write import columns, mesh_ply, ply

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


def stored(content: bytes) -> MeshFile:
    Path("a.ply").write_bytes(content)
    return read_file("a.ply")


@pytest.mark.parametrize("order", ["", "<", ">"])
@pytest.mark.parametrize(
    ("position", "count", "corner"),
    [("double", "uchar", "int"), ("float", "char", "ushort"), ("int", "uint", "uchar")],
)
def test_types_and_byte_orders_are_read_and_stay(here, order, position, count, corner):
    kinds = {"position": position, "count": count, "corner": corner}
    file = stored(mixed(order, **kinds))
    assert file.V.dtype == np.float64 and np.array_equal(file.V, SQUARE)
    assert file.F.dtype == np.int64 and file.F.tolist() == FANNED
    renamed = mixed(order, **kinds).replace(b"double", b"float64").replace(b"ushort", b"uint16")
    assert np.array_equal(stored(renamed).V, SQUARE)
    if position != "int":
        write_file("b.ply", file, file.V[:, [1, 2, 0]] + 0.5)
        assert Path("b.ply").read_bytes() == mixed(order, points=SQUARE[:, [1, 2, 0]] + 0.5, **kinds)


@pytest.mark.parametrize("order", ["", "<"])
def test_any_end_but_the_last_byte_is_too_early(here, order):
    whole = mixed(order)
    # A cut in the last number of a text cannot be detected.
    for end in [*range(0, len(whole) - 2, 7), len(whole) - 1 - 2 * (order == "")]:
        with pytest.raises(InputError, match="ends within|its header|begin with ply|is no number|empty"):
            stored(whole[:end])


def test_rows_of_a_text_may_go_on_in_the_next_line(here):
    header, end, rows = mixed("").partition(b"end_header\n")
    assert stored(header + end + rows.replace(b" ", b"\n")).F.tolist() == FANNED


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("format ascii 1.0\n", "", "names no format"),
        ("format ascii", "format utf8", "line 2 of its header"),
        ("element vertex 5", "element vertex -5", "line 5 of its header"),
        ("property double y", "property real y", "line 8 of its header"),
        ("list uchar int vertex_index", "list float int vertex_index", "of its header"),
        ("double y", "double w", "no x, y and z"),
        ("vertex_index", "corners", "no list vertex_indices"),
        ("element vertex 5", "element corner 5", "no vertices"),
        ("4 0 1 2 3 ", "-4 0 1 2 3 ", "its element face has a length of -4.0"),
        ("4 0 1 2 3 ", "4 0.5 1 2 3 ", "no whole number"),
        ("4 0 1 2 3 ", "4 1e300 1 2 3 ", "too large"),
        ("4 0 1 2 3 ", "2 0 1 ", "a face has 2 corners"),
        ("4 0 1 2 3 ", "4 zero 1 2 3 ", "zero"),
        ("element face 4", "element face 3", "more numbers follow"),
        ("element face 4", "element face 99999999999999999999", "ends within"),
    ],
)
def test_what_is_wrong_is_said(here, old, new, words):
    sound = mixed("").decode()
    assert old in sound
    with pytest.raises(InputError, match=words):
        stored(sound.replace(old, new).encode())


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("0 1 0\n", "0 1\n", "line 15 has 2 values; its header declares 3"),
        ("3 2 3 4\n", "3 2 3\n", "line 19 has 3 values; its header declares 4"),
        ("4 0 1 4 3 0\n", "1e30 0 1 4 3 0\n", "its element face has a length of 1e[+]30"),
    ],
)
def test_lines_with_fewer_values_are_refused_with_their_number(here, old, new, words):
    assert OLD_MESHLAB.count(old) == 1
    with pytest.raises(InputError, match=words):
        stored(OLD_MESHLAB.replace(old, new).encode())


@pytest.mark.parametrize(("end", "mark"), [("\n", ""), ("\r\n", "\ufeff")])
def test_further_values_on_lines_of_a_text_stay(here, end, mark):
    text = mark + OLD_MESHLAB.replace("\n", end)
    file = stored(text.encode())
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
    file = stored(ply(order, elements))
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
    file = stored(mesh_ply(V, [[0, 1, 2], [3, 4, 5]], "", vertex=vertex, face=face))
    posed = np.where(np.arange(6)[:, None] < 3, V, V[:, [0, 2, 1]] * [1, -1, 1])
    write_file("b.ply", file, posed)
    words = [line.split() for line in Path("b.ply").read_text().splitlines()[-8:]]
    normals = np.array([line[-3:] for line in words], dtype=float)
    np.testing.assert_allclose(normals[[0, 1, 2, 6]], [[0, 0, 1]] * 4, atol=1e-12)
    np.testing.assert_allclose(normals[[3, 4, 5, 7]], [[0, -1, 0]] * 4, atol=1e-12)
