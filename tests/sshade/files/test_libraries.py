"""Files that MeshLab writes, with all that they can hold, are read, written, and read there again."""

import numpy as np
import pymeshlab
import pytest

from sshade.files.meshes import read_file, write_file
from tests.shapes import icosphere

SPHERE = icosphere(2)
RNG = np.random.default_rng(0)
TEXTURE = RNG.random((SPHERE.n, 2))
#: Options of pymeshlab. It writes most of a mesh by default.
MESHLAB = {
    ".ply": [{}, {"binary": False, "save_vertex_normal": True}, {"save_face_color": True}],
    ".obj": [{}, {"save_vertex_normal": True}],
    ".off": [{}, {"save_vertex_color": False}, {"save_vertex_normal": False}],
    ".stl": [{}, {"binary": False}, {"colormode": True}],
}


def moved(V):
    return V * [1, 1.5, 1] + [0.5, 0, 0]


def rewritten(path):
    """Write a file as it is and with new positions; return the path of the second."""
    file, out = read_file(path), path.with_name(f"out{path.suffix}")
    write_file(out, file, file.V)
    assert out.read_bytes() == path.read_bytes()
    write_file(out, file, moved(file.V))
    again = read_file(out)
    assert np.allclose(again.V, moved(file.V), atol=1e-6) and np.array_equal(again.F, file.F)
    assert again.holds == file.holds and again.notes == file.notes == ()
    return out


@pytest.mark.parametrize("suffix", MESHLAB)
def test_files_of_meshlab(tmp_path, suffix):
    colours = {"v_color_matrix": RNG.random((SPHERE.n, 4)), "f_color_matrix": RNG.random((SPHERE.m, 4))}
    content = {"v_normals_matrix": SPHERE.V, "v_tex_coords_matrix": TEXTURE, "v_scalar_array": TEXTURE[:, 0]}
    mesh = pymeshlab.Mesh(SPHERE.V, SPHERE.F, **content, **colours)
    for options in MESHLAB[suffix]:
        meshes, path = pymeshlab.MeshSet(), tmp_path / f"a{suffix}"
        meshes.add_mesh(mesh)
        meshes.save_current_mesh(str(path), **options)
        out = rewritten(path)
        for each in (path, out):
            meshes.load_new_mesh(str(each))
        old, new = meshes.mesh(1), meshes.mesh(2)
        # MeshLab merges the corners of an STL file in the order of their positions.
        corners = (m.vertex_matrix()[m.face_matrix()] for m in (new, old))
        assert np.allclose(next(corners), moved(next(corners)), atol=1e-6)
        # MeshLab reads normals of an OFF file in another place than it writes them: as colours.
        if old.has_vertex_color() and not (suffix == ".off" and options.get("save_vertex_normal", True)):
            assert np.array_equal(old.vertex_color_matrix(), new.vertex_color_matrix())
        assert old.has_face_color() == new.has_face_color()
        if old.has_face_color():
            assert np.array_equal(old.face_color_matrix(), new.face_color_matrix())
