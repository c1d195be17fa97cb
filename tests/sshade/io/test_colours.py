"""Colours of vertices are read as the programs that wrote them mean them."""

from pathlib import Path

import numpy as np
import pytest

from sshade.edit.document import Document
from sshade.io.meshes import read_file, write_mesh
from tests.shapes import icosphere

pytestmark = pytest.mark.usefixtures("here")

BALL = icosphere(1)
COLOURS = np.random.default_rng(0).integers(0, 256, (BALL.n, 3))


def as_ply(kind: str, names: str, values: np.ndarray) -> str:
    head = ["ply", "format ascii 1.0", f"element vertex {BALL.n}", *(f"property double {c}" for c in "xyz")]
    head += [f"property {kind} {name}" for name in names.split()]
    head += [f"element face {BALL.m}", "property list uchar int vertex_indices", "end_header"]
    rows = [" ".join(map(str, [*v, *c])) for v, c in zip(BALL.V.tolist(), values.tolist(), strict=True)]
    return "\n".join(head + rows + [f"3 {a} {b} {c}" for a, b, c in BALL.F.tolist()]) + "\n"


def as_obj(values: np.ndarray) -> str:
    rows = [" ".join(map(str, ["v", *v, *c])) for v, c in zip(BALL.V.tolist(), values.tolist(), strict=True)]
    return "\n".join(rows + [f"f {a} {b} {c}" for a, b, c in (BALL.F + 1).tolist()]) + "\n"


FILES = {
    "bytes.ply": as_ply("uchar", "red green blue", COLOURS),
    "alpha.ply": as_ply("uchar", "r g b a", np.c_[COLOURS, COLOURS[:, :1]]),
    "words.ply": as_ply("ushort", "diffuse_red diffuse_green diffuse_blue", 257 * COLOURS),
    "floats.ply": as_ply("float", "red green blue", COLOURS / 255),
    "floats.obj": as_obj(COLOURS / 255),
    "bytes.obj": as_obj(COLOURS),
}


@pytest.mark.parametrize("name", FILES)
def test_colours_of_vertices_are_read(name):
    Path(name).write_text(FILES[name])
    document = Document(Path(name), output=None, handles=None, carry=False)
    assert document.is_coloured and np.array_equal(document.colours, COLOURS)
    assert np.abs(read_file(name).colours() - COLOURS / 255).max() < 1e-6


def test_of_vertices_along_a_seam_the_first_gives_the_colour():
    V, F = np.r_[BALL.V[:1], BALL.V], BALL.F + 1
    F[0][F[0] == 1] = 0
    text = as_ply("uchar", "red green blue", COLOURS).splitlines()
    head = text.index("end_header")
    first = " ".join(map(str, [*V[0].tolist(), 1, 2, 3]))
    rows = text[head + 1 : head + 1 + BALL.n]
    faces = [f"3 {a} {b} {c}" for a, b, c in F.tolist()]
    text = [line.replace(f"vertex {BALL.n}", f"vertex {BALL.n + 1}") for line in text[: head + 1]]
    Path("seam.ply").write_text("\n".join([*text, first, *rows, *faces]) + "\n")
    document = Document(Path("seam.ply"), output=None, handles=None, carry=False)
    assert document.mesh.n == BALL.n and document.colours[0].tolist() == [1, 2, 3]
    assert np.array_equal(document.colours[1:], COLOURS[1:])


def test_files_without_colours_for_all_vertices_have_none():
    write_mesh("plain.ply", BALL.V, BALL.F)
    Path("some.obj").write_text(as_obj(COLOURS).replace(" ".join(map(str, COLOURS[3].tolist())), "", 1))
    for name in "plain.ply", "some.obj":
        document = Document(Path(name), output=None, handles=None, carry=False)
        assert document.colours is None and not document.is_coloured
