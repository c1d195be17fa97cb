"""Colours of vertices are read as the programs that wrote them mean them."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from sshade.edit.document import Document
from sshade.files.meshes import write_mesh
from sshade.files.vertex_colours import colours_of
from tests.shapes import icosphere
from tests.write import columns, mesh_ply, obj, rows

pytestmark = pytest.mark.usefixtures("here")

BALL = icosphere(1)
COLOURS = np.random.default_rng(0).integers(0, 256, (BALL.n, 3))


def as_ply(
    kind: str, names: str, colours: np.ndarray, V: np.ndarray = BALL.V, F: np.ndarray = BALL.F
) -> bytes:
    return mesh_ply(V, F, "", vertex=columns(kind, names, colours))


def as_obj(colours: np.ndarray) -> bytes:
    return obj(np.c_[BALL.V, colours], BALL.F)


FILES = {
    "bytes.ply": as_ply("uchar", "red green blue", COLOURS),
    "words.ply": as_ply("ushort", "diffuse_red diffuse_green diffuse_blue", 257 * COLOURS),
    "floats.ply": as_ply("float", "red green blue", COLOURS / 255),
    "bytes.obj": as_obj(COLOURS),
}


@pytest.mark.parametrize("name", FILES)
def test_colours_of_vertices_are_read(name):
    Path(name).write_bytes(FILES[name])
    document = Document(Path(name))
    assert document.is_coloured and np.array_equal(document.colours, COLOURS)
    assert np.abs(colours_of(Path(name)) - COLOURS / 255).max() < 1e-6


def test_of_vertices_along_a_seam_the_first_gives_the_colour():
    V, F = np.r_[BALL.V[:1], BALL.V], BALL.F + 1
    F[0][F[0] == 1] = 0
    Path("seam.ply").write_bytes(as_ply("uchar", "red green blue", np.r_[[[1, 2, 3]], COLOURS], V, F))
    document = Document(Path("seam.ply"))
    assert document.mesh.n == BALL.n and document.colours[0].tolist() == [1, 2, 3]
    assert np.array_equal(document.colours[1:], COLOURS[1:])


def test_files_without_colours_for_all_vertices_have_none():
    write_mesh("plain.ply", BALL.V, BALL.F)
    (third,) = rows("", COLOURS[3:4].astype(float))
    Path("some.obj").write_bytes(as_obj(COLOURS).replace(third.encode(), b"", 1))
    for name in "plain.ply", "some.obj":
        document = Document(Path(name))
        assert document.colours is None and not document.is_coloured


def test_colours_of_a_gltf_are_linear():
    colours = np.random.default_rng(0).integers(0, 256, (BALL.n, 4), dtype=np.uint8)
    trimesh.Trimesh(BALL.V, BALL.F, vertex_colors=colours, process=False).export("body.glb")
    found = colours_of(Path("body.glb"))
    back = np.where(found <= 0.04045, found / 12.92, ((found + 0.055) / 1.055) ** 2.4)
    assert np.abs(back - colours[:, :3] / 255).max() < 1e-6
