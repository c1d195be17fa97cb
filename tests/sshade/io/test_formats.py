"""OFF and STL as they are written elsewhere; what is not whole is refused."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from sshade import InputError
from sshade.io.document import MeshFile
from sshade.io.meshes import write_mesh
from sshade.io.obj import read_obj
from sshade.io.off import read_off
from sshade.io.stl import read_stl
from tests.shapes import icosphere

SPHERE = icosphere(1)


def arrays(file: MeshFile) -> tuple[np.ndarray, np.ndarray]:
    return file.V, file.F


def test_they_agree_with_another_reader(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    shape = trimesh.Trimesh(SPHERE.V / 3, SPHERE.F, process=False)
    for name, read, options in (
        ("a.off", read_off, {"digits": 17}),
        ("a.stl", read_stl, {}),
        ("b.stl", read_stl, {"file_type": "stl_ascii"}),
    ):
        shape.export(tmp_path / name, **options)
        V, F = arrays(read(tmp_path / name))
        other = trimesh.load(tmp_path / name, process=False, maintain_order=True)
        assert np.array_equal(V, other.vertices) and np.array_equal(F, other.faces), name


OFF = """\
COFF
# made by hand
5 3 0

0 0 0 255 0 0 255
1 0 0 255 0 0 255 # a corner
1 1 0 255 0 0 255
0 1 0 255 0 0 255
2 0 1 255 0 0 255
4 0 1 2 3
3 1 4 2 0.5 0.5 0.5
3 0 3 2
"""


def test_off_with_comments_colours_and_polygons(tmp_path):
    for text in (OFF, OFF.replace("\n", "\r\n"), OFF.replace("COFF\n# made by hand\n5", "OFF 5")):
        (tmp_path / "a.off").write_bytes(text.encode())
        V, F = arrays(read_off(tmp_path / "a.off"))
        assert V.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 1]]
        assert F.tolist() == [[0, 1, 2], [0, 2, 3], [1, 4, 2], [0, 3, 2]]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("COFF", "PLY", "does not begin with OFF"),
        ("5 3 0", "5", "does not say how many"),
        ("5 3 0", "5 4 0", "5 vertices and 4 faces are announced, 8 lines follow"),
        ("5 3 0", "-5 13 0", "announced"),
        ("2 0 1 255 0 0 255", "2 0", "vertex 4 needs three coordinates"),
        ("2 0 1 255", "2 0 x 255", "could not convert"),
        ("4 0 1 2 3", "4 0 1 2", "face 0 is not complete"),
        ("3 0 3 2", "2 0 3", "face 2 is not complete"),
        ("3 0 3 2", "3 0 3 2.5", "is no whole number"),
    ],
)
def test_what_is_wrong_with_an_off_is_said(tmp_path, old, new, words):
    assert old in OFF
    (tmp_path / "a.off").write_text(OFF.replace(old, new))
    with pytest.raises(ValueError, match=words):
        read_off(tmp_path / "a.off")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("v 0 0 0\nv 1 0\nv 0 1 0\nf 1 2 3\n", "line 2: .*three coordinates"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\n", "line 4: a face needs three"),
    ],
)
def test_what_is_wrong_with_an_obj_is_said(tmp_path, text, words):
    (tmp_path / "a.obj").write_text(text)
    with pytest.raises(ValueError, match=words):
        read_obj(tmp_path / "a.obj")


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
    V, F = arrays(read_stl(tmp_path / "a.stl"))
    assert V.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert F.tolist() == [[0, 1, 2], [3, 4, 5]]


def test_a_text_that_ends_anywhere_but_at_its_end_is_refused(tmp_path):
    whole = STL.rstrip()
    for end in range(6, len(whole) - len("endsolid two") + 1, 3):
        (tmp_path / "a.stl").write_text(whole[:end])
        with pytest.raises(ValueError):
            read_stl(tmp_path / "a.stl")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (STL + STL, "2 meshes; give one mesh a file"),
        ("solid a\nendsolid a\n", "no triangles"),
        (STL.replace("vertex 1 1e0 0", "vertex 1 1e0"), "line 12: a vertex needs three"),
        (STL.replace("vertex 1 1e0 0", "vertex 1 1e0 z"), "could not convert"),
        (STL.replace("      vertex 1 1e0 0\n", ""), "line 13: a facet has no three vertices"),
        (STL.replace("endsolid two", ""), "ends within a solid"),
        (STL.replace("endfacet", "endfaces"), "line 8 is not understood: 'endfaces'"),
        (STL + "vertex 1 2 3\n", "line 17 is not understood"),
        ("<html>", "neither a text that begins with solid, nor"),
    ],
)
def test_what_is_wrong_with_an_stl_is_said(tmp_path, text, words):
    (tmp_path / "a.stl").write_text(text)
    with pytest.raises((ValueError, InputError), match=words):
        read_stl(tmp_path / "a.stl")


def test_a_binary_stl_that_begins_with_solid_and_one_of_another_length(tmp_path):
    write_mesh(tmp_path / "a.stl", SPHERE.V, SPHERE.F)
    data = b"solid" + (tmp_path / "a.stl").read_bytes()[5:]
    (tmp_path / "a.stl").write_bytes(data)
    assert np.array_equal(read_stl(tmp_path / "a.stl").V, SPHERE.V.astype("f4")[SPHERE.F].reshape(-1, 3))
    for wrong in (data[:-1], data + b"\0", data[:80] + struct.pack("<I", SPHERE.m + 1) + data[84:]):
        (tmp_path / "a.stl").write_bytes(wrong)
        with pytest.raises(ValueError):
            read_stl(tmp_path / "a.stl")
    (tmp_path / "a.stl").write_bytes(bytes(84))
    with pytest.raises(InputError, match="no triangles"):
        read_stl(tmp_path / "a.stl")
