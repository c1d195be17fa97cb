"""Subdivision and remeshing: counts, topology, shape, Loop's rules, and refused meshes."""

import os
import subprocess
import sys

import igl
import numpy as np
import pytest
from scipy.spatial import cKDTree

from defaust.build.options import BuildOptions
from defaust.build.upsample import subdivide, upsample
from defaust.tasks.loop import loop_matrix, split
from sshade import InputError, Mesh
from tests.shapes import beside, bumpy, double_torus, icosphere, shifted, tetrahedron, torus


@pytest.fixture(scope="module")
def ball() -> Mesh:
    return icosphere(3)  # 642 vertices


@pytest.mark.parametrize(("target", "steps"), [(500, 0), (2000, 1)])
def test_counts_topology_and_shape(ball, target, steps):
    result = upsample(ball, BuildOptions(target_vertices=target))
    mesh = result.mesh
    assert result.ls3_steps == steps and 0.9 * target <= mesh.n <= 1.1 * target
    assert mesh.is_closed and mesh.is_manifold and mesh.is_oriented and mesh.topology == ball.topology
    assert mesh.volume == pytest.approx(4 / 3 * np.pi, rel=0.03)
    length = np.linalg.norm(mesh.V[mesh.edges[:, 0]] - mesh.V[mesh.edges[:, 1]], axis=1)
    assert length.mean() == pytest.approx(result.edge_length, rel=0.1)
    assert length.std() / length.mean() < 0.2


@pytest.mark.skipif(sys.platform != "linux", reason="the variable is for the C library of Linux")
def test_what_memory_held_before_changes_nothing():
    code = "from defaust.build.upsample import *; from tests.shapes import bumpy; import sys; " + (
        "sys.stdout.buffer.write(upsample(bumpy(4), BuildOptions(target_vertices=500)).mesh.V.tobytes())"
    )
    environment = os.environ | {"MALLOC_PERTURB_": "255"}
    found = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, check=True)
    expected = upsample(bumpy(4), BuildOptions(target_vertices=500)).mesh.V
    assert np.array_equal(np.frombuffer(found.stdout).reshape(-1, 3), expected)


def test_every_edge_is_split(ball):
    # LS3's default threshold would leave edges under 1 % of the diagonal alone.
    fine = subdivide(ball, steps=3)
    assert fine.m == 64 * ball.m
    assert fine.volume == pytest.approx(4 / 3 * np.pi, rel=0.01)
    assert subdivide(ball, steps=0) is ball


def test_unfit_surfaces_are_refused(ball):
    two = beside(ball, shifted(ball, 3))
    for mesh, message in ((Mesh(ball.V, ball.F[1:]), "3 boundary edges"), (two, "2 components")):
        with pytest.raises(InputError, match=message):
            upsample(mesh, BuildOptions(target_vertices=500))


def test_a_library_of_the_system_that_is_missing_is_named(monkeypatch, tmp_path):
    (tmp_path / "pymeshlab.py").write_text("raise ImportError('libGL.so.1: cannot open shared object file')")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "pymeshlab", raising=False)
    with pytest.raises(InputError, match="pymeshlab, which refines meshes, cannot be loaded .* libgl1"):
        subdivide(torus(), steps=1)


MESHES = {
    "tetrahedron": tetrahedron(),  # valence 3 everywhere
    "icosphere": icosphere(1),  # valences 5 and 6
    "double torus": double_torus(cells=1),  # valences up to 8
}


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("method", ["pymeshlab", "split"])
def test_positions_are_those_of_libigl(name, method):
    mesh = MESHES[name]
    fine = subdivide(mesh, steps=2) if method == "pymeshlab" else split(split(mesh))
    L = loop_matrix(mesh, fine, steps=2)
    V, F = igl.loop(np.array(mesh.V), np.array(mesh.F), 2)
    np.testing.assert_allclose(L.sum(axis=1), 1)
    assert L.data.min() > 0
    distance, place = cKDTree(V).query(L @ mesh.V)
    assert distance.max() < 1e-12
    assert len(np.unique(place)) == len(V) == fine.n
    # The same triangles: each vertex is where libigl has it, not only some vertex.
    assert {tuple(sorted(f)) for f in place[fine.F].tolist()} == {tuple(sorted(f)) for f in F.tolist()}
