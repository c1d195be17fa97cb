"""Subdivision and remeshing: counts, topology, shape, and refused meshes."""

import sys

import numpy as np
import pytest

from defaust.build.options import BuildOptions
from defaust.build.upsample import subdivide, upsample
from sshade import InputError, Mesh
from tests.shapes import beside, icosphere, shifted, torus


@pytest.fixture(scope="module")
def ball() -> Mesh:
    return icosphere(3)  # 642 vertices


@pytest.mark.parametrize(("target", "steps"), [(500, 0), (2000, 1)])
def test_counts_topology_and_shape(ball, target, steps):
    result = upsample(ball, BuildOptions(target_vertices=target))
    mesh = result.mesh
    assert result.ls3_steps == steps
    assert 0.9 * target <= mesh.n <= 1.1 * target
    assert mesh.is_closed and mesh.is_manifold and mesh.is_oriented
    assert mesh.topology == ball.topology
    assert mesh.volume == pytest.approx(4 / 3 * np.pi, rel=0.03)
    length = np.linalg.norm(mesh.V[mesh.edges[:, 0]] - mesh.V[mesh.edges[:, 1]], axis=1)
    assert length.mean() == pytest.approx(result.edge_length, rel=0.1)
    assert length.std() / length.mean() < 0.2


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
