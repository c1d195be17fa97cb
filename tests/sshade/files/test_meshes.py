"""Meshes that are written anew keep their order and their digits; a surface has what of a file is one."""

import os
from pathlib import Path

import numpy as np
import pytest

from sshade import InputError, Mesh
from sshade.files.mesh_file import SUFFIXES
from sshade.files.meshes import read_file, read_mesh, write_file, write_mesh
from sshade.files.open_shape import open_shape
from sshade.mesh.surface import surface
from tests.shapes import bumpy, icosphere


def shuffled() -> Mesh:
    """No order that a reader could restore by itself, and digits that need all of a double."""
    mesh, rng = icosphere(2), np.random.default_rng(0)
    order = rng.permutation(mesh.n)
    V = np.empty_like(mesh.V)
    V[order] = mesh.V * rng.uniform(0.9, 1.1, (mesh.n, 1)) / 3
    V[2] = [1e-20, -0.0, np.nextafter(1, 2)]
    V[1] = V[0]  # coincident vertices must not be merged
    F = np.array([np.roll(f, r) for f, r in zip(order[mesh.F], rng.integers(0, 3, mesh.m), strict=True)])
    return Mesh(V, rng.permutation(F))


@pytest.mark.parametrize("suffix", [*(suffix for suffix in SUFFIXES if suffix != ".stl"), ".Obj"])
def test_vertices_and_faces_keep_their_order_and_their_bits(here, suffix):
    mesh = shuffled()
    write_mesh(f"mesh{suffix}", mesh.V, mesh.F)
    back = read_mesh(f"mesh{suffix}")
    expected = mesh.V.astype("f4").astype("f8") if suffix in (".glb", ".gltf") else mesh.V
    assert np.array_equal(back.F, mesh.F) and back.V.tobytes() == expected.tobytes()
    assert os.listdir() == [f"mesh{suffix}"]


@pytest.mark.parametrize("suffix", [".stl", ".glb", ".gltf"])
def test_positions_too_large_for_single_precision_are_refused(here, suffix):
    ball, path = icosphere(1), f"mesh{suffix}"
    write_mesh(path, ball.V, ball.F)
    before, file = Path(path).read_bytes(), read_file(path)
    with pytest.raises(InputError, match=f"mesh{suffix}: a position is too large for the single prec"):
        write_mesh(path, 1e39 * ball.V, ball.F)
    with pytest.raises(InputError, match=f"mesh{suffix}: .* single precision"):
        write_file(path, file, 1e39 * file.V)
    assert Path(path).read_bytes() == before and os.listdir() == [path]


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


BODY = bumpy(2)


@pytest.mark.parametrize("given", [(BODY.V, BODY.F), (BODY,)])
def test_a_result_is_a_copy_also_if_it_is_the_shape_itself(given):
    shape = open_shape(*given)
    moved = shape.moved(shape.mesh.V)
    moved = moved.V if isinstance(moved, Mesh) else moved
    assert np.array_equal(moved, BODY.V) and not np.shares_memory(moved, BODY.V)


def test_what_is_no_shape_is_refused():
    with pytest.raises(InputError, match="no mesh in an object of type list"):
        open_shape([BODY.V])
