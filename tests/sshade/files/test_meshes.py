"""Meshes that are written anew keep their order and their digits; a surface has what of a file is one."""

import os

import numpy as np
import pytest

from sshade import Mesh
from sshade.files.mesh_file import SUFFIXES
from sshade.files.meshes import read_mesh, write_mesh
from sshade.files.open_shape import open_shape
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


BODY = bumpy(2)


@pytest.mark.parametrize("given", [(BODY.V, BODY.F), (BODY,)])
def test_a_result_is_a_copy_also_if_it_is_the_shape_itself(given):
    shape = open_shape(*given)
    moved = shape.moved(shape.mesh.V)
    moved = moved.V if isinstance(moved, Mesh) else moved
    assert np.array_equal(moved, BODY.V) and not np.shares_memory(moved, BODY.V)
