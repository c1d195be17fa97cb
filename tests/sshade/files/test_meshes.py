import os

import numpy as np
import pytest

from sshade import InputError, Mesh
from sshade.files import meshes as meshio
from sshade.files.meshes import SUFFIXES, read_arrays, read_mesh, write_mesh
from sshade.mesh.surface import surface
from tests.shapes import icosphere

ORDERED = [suffix for suffix in SUFFIXES if suffix != ".stl"]


@pytest.fixture(scope="module")
def shuffled() -> Mesh:
    """No order that a reader could restore by itself, and digits that need all of a double."""
    mesh, rng = icosphere(2), np.random.default_rng(0)
    order = rng.permutation(mesh.n)
    V = np.empty_like(mesh.V)
    V[order] = mesh.V * rng.uniform(0.9, 1.1, (mesh.n, 1)) / 3
    F = np.array([np.roll(f, r) for f, r in zip(order[mesh.F], rng.integers(0, 3, mesh.m), strict=True)])
    V[1] = V[0]  # coincident vertices must not be merged
    return Mesh(V, rng.permutation(F))


@pytest.mark.parametrize("suffix", [*ORDERED, ".PLY", ".Obj"])
def test_vertices_and_faces_keep_their_order(tmp_path, shuffled, suffix):
    path = tmp_path / f"mesh{suffix}"
    write_mesh(path, shuffled.V, shuffled.F)
    back = read_mesh(path)
    assert np.array_equal(back.F, shuffled.F)
    expected = shuffled.V.astype("f4") if suffix in (".glb", ".gltf") else shuffled.V
    assert np.allclose(back.V, expected, rtol=0, atol=1e-15 * shuffled.diagonal)
    assert os.listdir(tmp_path) == [path.name]


def test_ply_keeps_every_bit_also_of_odd_numbers(tmp_path, shuffled):
    V = shuffled.V.copy()
    V[0], V[1] = [1e-300, -0.0, np.nextafter(1, 2)], [1 / 3, 1e300, 5e-324]
    write_mesh(tmp_path / "mesh.ply", V, shuffled.F)
    back, F = read_arrays(tmp_path / "mesh.ply")
    assert back.tobytes() == V.tobytes() and np.array_equal(F, shuffled.F)


@pytest.mark.parametrize("suffix", [".stl", ".glb", ".gltf"])
def test_positions_too_large_for_single_precision_are_refused(tmp_path, shuffled, suffix):
    path = tmp_path / f"mesh{suffix}"
    write_mesh(path, shuffled.V, shuffled.F)
    before, file = path.read_bytes(), meshio.read_file(path)
    large = [lambda: write_mesh(path, 1e39 * shuffled.V, shuffled.F)]
    large += [lambda: meshio.write_file(path, file, 1e39 * file.V)] * (suffix == ".stl")
    for write in large:
        with pytest.raises(InputError, match=f"mesh{suffix}: a position is too large for the single prec"):
            write()
    assert path.read_bytes() == before and os.listdir(tmp_path) == [path.name]


def test_a_folder_that_cannot_take_the_output_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(meshio.os, "access", lambda path, mode: mode != os.W_OK)
    with pytest.raises(InputError, match="is not writable"):
        write_mesh(tmp_path / "a.ply", np.eye(3), [[0, 1, 2]])
    assert not os.listdir(tmp_path)


def test_repair_drops_unused_vertices_repeated_and_duplicate_faces():
    V = np.array([[9.0, 9, 9], [0, 0, 0], [1, 0, 0], [0, 1, 0], [-0.0, 0, 0], [1, 1, 0]])
    F = np.array([[1, 2, 3], [1, 2, 2], [4, 2, 3], [1, 4, 3], [2, 5, 3]])
    mesh, vertex, facts = surface(V, F, repair=True)
    assert (facts.unused, facts.collapsed, facts.duplicates) == (1, 2, 1)
    assert mesh.F.tolist() == [[0, 1, 2], [1, 3, 2]]
    assert vertex.tolist() == [-1, 0, 1, 2, 0, 3]
    assert np.array_equal(mesh.V, V[[1, 2, 3, 5]])
    with pytest.raises(InputError, match=r"face 3 .*the ids go from 0 to 5"):
        surface(V, np.array([[1, 2, 3], [1, 2, 2], [4, 2, 3], [1, 999, 3]]), repair=True)
