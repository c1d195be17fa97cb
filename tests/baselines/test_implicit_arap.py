"""Implicit-ARAP without torch, and its normalisation of meshes."""

import subprocess
import sys

import numpy as np
import pytest

from baselines.implicit_arap import implicit_arap
from baselines.implicit_arap.method import normalised
from eval.run.attempt import attempt
from sshade.mesh.mesh import Mesh
from tests.shapes import bumpy, held_ends


class Absent:
    """Finder of modules that does not find torch. A None in sys.modules would confuse scipy."""

    @staticmethod
    def find_spec(name, path=None, target=None):
        if name.split(".")[0] == "torch":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


@pytest.fixture
def no_torch(monkeypatch):
    for name in [name for name in sys.modules if name.split(".")[0] == "torch"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [Absent, *sys.meta_path])


def test_without_torch_the_error_names_the_extra_and_the_row_is_skipped(no_torch):
    with pytest.raises(ModuleNotFoundError, match="torch"):
        implicit_arap(held_ends(bumpy(2)))
    method = {"_target_": "baselines.implicit_arap.implicit_arap", "_partial_": True}
    done = attempt(method, held_ends(bumpy(2)), seed=0)
    assert done.facts["status"] == "skipped"
    assert "install the extra torch" in done.facts["reason"]
    assert done.vertices is None


def test_an_unknown_distance_is_refused():
    with pytest.raises(ValueError, match="sdf='gird' is unknown; use 'network' or 'grid'"):
        implicit_arap(held_ends(bumpy(1)), sdf="gird")


def test_importing_the_package_leaves_torch_alone():
    code = "import sys, baselines.implicit_arap; assert 'torch' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_normalised_mesh_is_centred_and_fits():
    mesh = bumpy(3)
    V, centre, scale = normalised(mesh)
    assert np.abs(V).max() == pytest.approx(0.8, rel=1e-12)
    centroid = Mesh(V, mesh.F).face_areas @ V[mesh.F].mean(axis=1)
    np.testing.assert_allclose(centroid, 0, atol=1e-12)
    np.testing.assert_allclose(V / scale + centre, mesh.V, atol=1e-12)
