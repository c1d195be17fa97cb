"""PLY files: every type and byte order, mixed polygons, and messages about errors."""

import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from sshade.files.mesh_file import MeshFile
from sshade.files.meshes import read_file, write_file
from sshade.files.ply import read_ply
from tests import write
from tests.files import sample
from tests.write import columns

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 3]])
POLYGONS = [(0, 1, 2, 3), (1, 4, 2), (3, 2, 1, 0), (4, 1, 0)]
TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), [[0, 1, 2]]
FANNED = [[0, 1, 2], [0, 2, 3], [1, 4, 2], [3, 2, 1], [3, 1, 0], [4, 1, 0]]
CODES = {"char": "b", "uchar": "B", "ushort": "H", "int": "i", "uint": "I", "float": "f", "double": "d"}
SIZED = {"int8": "char", "uint16": "ushort", "float64": "double"}


def ply(
    order: str, *, points=SQUARE, position="double", count="uchar", corner="int", polygons=POLYGONS
) -> bytes:
    """Return a PLY file of vertices with a colour and a list, edges to skip, and faces with a second list."""
    sign = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[order]
    kinds = {name: CODES[SIZED.get(name, name)] for name in (position, count, corner)}
    header = (
        f"ply\nformat {order} 1.0\ncomment TextureFile ../secret.png\nobj_info nothing\n"
        f"element vertex {len(SQUARE)}\n"
        f"property {position} x\nproperty uchar red\nproperty {position} y\nproperty {position} z\n"
        "property list uchar ushort owners\n"
        "element edge 2\nproperty int vertex1\nproperty list uchar short more\n"
        f"element face {len(polygons)}\nproperty list {count} {corner} vertex_index\n"
        "property list uchar float uv\nend_header\n"
    )
    rows: list[tuple[str, tuple]] = []
    for i, (x, y, z) in enumerate(points):
        rows.append(
            (f"{kinds[position]}B{kinds[position] * 2}B{i % 3}H", (x, 200, y, z, i % 3, *range(i % 3)))
        )
    rows += [("iB", (7, 0)), ("iBhh", (8, 2, -5, 6))]
    for number, face in enumerate(polygons):
        extra = number % 3
        form = f"{kinds[count]}{kinds[corner] * len(face)}B{'f' * extra}"
        rows.append((form, (len(face), *face, extra, *[0.5] * extra)))
    if sign:
        return header.encode() + b"".join(struct.pack(sign + form, *values) for form, values in rows)
    return (header + "\n".join(" ".join(map(repr, map(float, values))) for _, values in rows) + "\n").encode()


def stored(folder: Path, content: bytes) -> MeshFile:
    """Write a.ply and read it."""
    (folder / "a.ply").write_bytes(content)
    return read_ply(folder / "a.ply")


@pytest.mark.parametrize("order", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize(
    ("position", "count", "corner"),
    [
        ("double", "uchar", "int"),
        ("float", "char", "ushort"),
        ("int", "uint", "uchar"),
        ("float64", "int8", "uint16"),
    ],
)
def test_types_and_byte_orders(tmp_path, order, position, count, corner):
    file = stored(tmp_path, ply(order, position=position, count=count, corner=corner))
    assert file.V.dtype == np.float64 and np.array_equal(file.V, SQUARE)
    assert file.F.dtype == np.int64 and file.F.tolist() == FANNED


@pytest.mark.parametrize("order", ["ascii", "binary_little_endian"])
def test_any_end_but_the_last_byte_is_too_early(tmp_path, order):
    whole = ply(order)
    # A text may lack the last line end. A cut in the last number of a text cannot be detected.
    last = len(whole) - (len(whole.split()[-1]) + 1 if order == "ascii" else 0)
    for end in [*range(0, last, 7), last - 1]:
        with pytest.raises(ValueError, match="ends within|its header|begin with ply|to float: b'-'"):
            stored(tmp_path, whole[:end])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b"ply\n", b"obj\n", "does not begin with ply"),
        (b"format ascii 1.0\n", b"", "names no format"),
        (b"format ascii", b"format utf8", "line 2 of its header"),
        (b"element vertex 5", b"element vertex -5", "line 5 of its header"),
        (b"property double y", b"property real y", "line 8 of its header"),
        (b"list uchar int vertex_index", b"list float int vertex_index", "of its header"),
        (b"double y", b"double w", "no x, y and z"),
        (b"vertex_index", b"corners", "no list vertex_indices"),
        (b"element vertex 5", b"element corner 5", "no vertices"),
        (b"4.0 0.0 1.0 2.0 3.0 ", b"-4.0 0.0 1.0 2.0 3.0 ", "its element face has a length of -4.0"),
        (b"4.0 0.0 1.0 2.0 3.0 ", b"4.5 0.0 1.0 2.0 3.0 ", "a length of 4.5"),
        (b"4.0 0.0 1.0 2.0 3.0 ", b"4.0 0.5 1.0 2.0 3.0 ", "no whole number"),
        (b"4.0 0.0 1.0 2.0 3.0 ", b"4.0 1e300 1.0 2.0 3.0 ", "too large"),
        (b"4.0 0.0 1.0 2.0 3.0 ", b"2.0 0.0 1.0 ", "a face has 2 corners"),
        (b"4.0 0.0 1.0 2.0 3.0 ", b"4.0 zero 1.0 2.0 3.0 ", "zero"),
        (b"element face 4", b"element face 3", "more numbers follow"),
        (b"element face 4", b"element face 99999999999999999999", "ends within"),
    ],
)
def test_what_is_wrong_is_said(tmp_path, old, new, words):
    sound = ply("ascii")
    assert old in sound
    with pytest.raises(ValueError, match=words):
        stored(tmp_path, sound.replace(old, new))


#: Older versions of MeshLab write texture coordinates and flags that their header does not declare.
OLD_MESHLAB = sample("old_meshlab.ply")


@pytest.mark.parametrize(("end", "mark"), [("\n", ""), ("\r\n", "\ufeff")])
def test_further_values_on_lines_of_a_text_stay(tmp_path, end, mark):
    path, text = tmp_path / "a.ply", mark + OLD_MESHLAB.replace("\n", end)
    path.write_bytes(text.encode())
    file = read_file(path)
    assert np.array_equal(file.V, SQUARE)
    assert file.F.tolist() == [[0, 1, 2], [0, 1, 4], [0, 4, 3], [2, 3, 4]]
    note = "further values than the header declares stay as they are: 4 lines, from line 12"
    assert file.notes == (note,) and file.holds == ("undeclared values", "polygons", "comments")
    write_file(tmp_path / "b.ply", file, file.V)
    assert (tmp_path / "b.ply").read_bytes() == path.read_bytes()
    write_file(tmp_path / "b.ply", file, file.V + [0, 0, 2])
    written = (tmp_path / "b.ply").read_bytes().decode()
    assert written.count(end) == text.count(end)
    assert np.array_equal(read_file(tmp_path / "b.ply").V, SQUARE + [0, 0, 2])
    assert "1 0 2.0 0.5\n" in written.replace(end, "\n")
    assert written.partition("2 0 5.0")[2] == text.partition("2 0 3")[2]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("0 1 0\n", "0 1\n", "line 15 has 2 values; its header declares 3"),
        ("3 2 3 4\n", "3 2 3\n", "line 19 has 3 values; its header declares 4"),
        ("4 0 1 4 3 0\n", "-4 0 1 4 3 0\n", "its element face has a length of -4.0"),
        ("4 0 1 4 3 0\n", "1e30 0 1 4 3 0\n", "its element face has a length of 1e[+]30"),
    ],
)
def test_lines_with_fewer_values_are_refused_with_their_number(tmp_path, old, new, words):
    assert OLD_MESHLAB.count(old) == 1
    with pytest.raises(ValueError, match=words):
        stored(tmp_path, OLD_MESHLAB.replace(old, new).encode())


def test_rows_of_a_text_may_go_on_in_the_next_line(tmp_path):
    header, end, rows = ply("ascii").partition(b"end_header\n")
    assert stored(tmp_path, header + end + rows.replace(b" ", b"\n")).F.tolist() == FANNED


@pytest.mark.parametrize("order", ["", ">"])
def test_triangle_strips_of_scans(tmp_path, order):
    """Two strips in a row, the first with a repeated vertex, behind a face that has a normal."""
    path, ids = tmp_path / "a.ply", [0, 1, 3, 2, 2, 4, -1, 4, 1, 0]
    elements = {
        "vertex": columns("float", "x y z", SQUARE),
        "face": [("vertex_indices", "uchar int", [(0, 1, 2)]), *columns("float", "nx ny nz", [[0, 0, 1]])],
        "tristrips": [("vertex_indices", "int int", [ids])],
    }
    path.write_bytes(write.ply(order, elements))
    file = read_file(path)
    assert file.F.tolist() == [[0, 1, 2], [0, 1, 3], [2, 3, 1], [4, 1, 0]]
    assert file.holds == ("face normals", "triangle strips")
    write_file(tmp_path / "b.ply", file, file.V)
    assert (tmp_path / "b.ply").read_bytes() == path.read_bytes()
    write_file(tmp_path / "b.ply", file, file.V[:, [1, 2, 0]])
    assert np.array_equal(read_file(tmp_path / "b.ply").F, file.F)
    found = trimesh.load(tmp_path / "b.ply", process=False)
    assert np.array_equal(found.vertices, file.V[:, [1, 2, 0]])


@pytest.mark.parametrize("kind", ["char", "uchar"])
def test_normals_of_whole_numbers_are_named_as_lost(tmp_path, kind):
    """The floating-point normals of the faces do not hide them."""
    whole, sound = columns(kind, "nx ny nz", [[0, 0, 127]] * 3), columns("float", "nx ny nz", [[0, 0, 1]])
    file = stored(tmp_path, write.mesh_ply(*TRIANGLE, "", vertex=whole, face=sound))
    assert "vertex normals" in file.lost(tmp_path / "b.ply")


@pytest.mark.parametrize("names", ["nx ny nz", "normal_x normal_y normal_z"])
def test_normals_turn_with_the_surface_under_both_names(tmp_path, names):
    normals = columns("double", names, [[0, 0, 1]] * 3)
    file = stored(tmp_path, write.mesh_ply(*TRIANGLE, "", vertex=normals))
    write_file(tmp_path / "b.ply", file, file.V[:, [2, 0, 1]])  # turned: z to x, x to y, y to z
    words = [line.split() for line in (tmp_path / "b.ply").read_text().splitlines()[-4:-1]]
    np.testing.assert_allclose(np.array(words, dtype=float)[:, 3:], [[1, 0, 0]] * 3, atol=1e-12)
