"""Isometric reconstruction and pose transfer."""

from __future__ import annotations

import numpy as np
import pytest

from sshade import InputError, bind, reconstruct, transfer_pose
from sshade.cli.main import main
from sshade.io.meshes import read_mesh, write_mesh
from tests.shapes import bent, bumpy, rotation

ROUNDING = 1e-12


@pytest.fixture(scope="module")
def mesh():
    return bumpy(4)


def test_the_rest_pose_comes_back(mesh):
    result = reconstruct(mesh, mesh.V, vertices=200, samplings=3)
    assert np.abs(result.vertices - mesh.V).max() < ROUNDING * mesh.diagonal


def test_a_rigid_pose_is_exact_for_the_shape_and_its_edit(mesh):
    R, t = rotation(3), np.array([1.0, -2, 0.5])
    edited = mesh.V * [1, 1.2, 1] + 0.05 * np.sin(5 * mesh.V)
    posed = mesh.V @ R.T + t
    result = transfer_pose(mesh, posed, edited, vertices=200, samplings=2)
    assert np.abs(result.vertices - (edited @ R.T + t)).max() < ROUNDING * mesh.diagonal


def test_only_the_rows_of_samples_are_used(mesh):
    posed = bent(mesh.V)
    samples = bind(mesh, 200, seed=(7, 0)).remesh.samples
    blind = np.zeros_like(posed)
    blind[samples] = posed[samples]
    a, b = (reconstruct(mesh, V, vertices=200, samplings=1, seed=7) for V in (posed, blind))
    assert np.array_equal(a.vertices, b.vertices)


@pytest.mark.parametrize("frames", ["triangle", "blended_affine"])
def test_with_the_residual_frames_carry_the_edit_alone(mesh, frames):
    posed, edited = bent(mesh.V), np.array(mesh.V)
    region = mesh.V[:, 2] > 1
    edited[region] *= 1.1
    options = {"vertices": 200, "samplings": 2, "frames": frames}
    plain = transfer_pose(mesh, posed, edited, **options).vertices
    found = transfer_pose(mesh, posed, edited, residual=True, **options).vertices
    expected = plain - reconstruct(mesh, posed, **options).vertices + posed
    assert np.abs(found - expected).max() < ROUNDING * mesh.diagonal
    assert np.abs(found - posed)[~region].max() < ROUNDING * mesh.diagonal
    truth = bent(edited)
    assert np.abs(found - truth).mean() < np.abs(plain - truth).mean()


def test_more_samples_and_samplings_come_nearer(mesh):
    posed = bent(mesh.V)

    def error(**parameters):
        result = reconstruct(mesh, posed, **parameters)
        return np.linalg.norm(result.vertices - posed, axis=1).mean()

    coarse, fine = error(vertices=100, samplings=1), error(vertices=800, samplings=1)
    assert fine < 0.5 * coarse
    assert error(vertices=100, samplings=8) < coarse


def test_threads_and_repeats_change_no_bit(mesh):
    posed = bent(mesh.V)
    a, b = (reconstruct(mesh, posed, vertices=150, samplings=3, workers=w).vertices for w in (1, 3))
    assert np.array_equal(a, b)


def test_bad_input_is_refused(mesh):
    with pytest.raises(InputError, match="must correspond"):
        reconstruct(mesh, mesh.V[1:])
    with pytest.raises(InputError, match="edited shape has a NaN"):
        transfer_pose(mesh, mesh.V, np.full_like(mesh.V, np.nan))
    with pytest.raises(InputError, match="at least one is needed"):
        reconstruct(mesh, mesh.V, samplings=0)
    with pytest.raises(InputError, match="at least one is needed"):
        reconstruct(mesh, mesh.V, workers=0)


def test_the_commands_write_the_same_as_the_functions(mesh, tmp_path, capsys):
    posed, edited = bent(mesh.V), mesh.V + 0.02 * np.cos(4 * mesh.V)
    files = {name: str(tmp_path / f"{name}.ply") for name in ("rest", "posed", "edited", "out")}
    for name, V in (("rest", mesh.V), ("posed", posed), ("edited", edited)):
        write_mesh(files[name], V, mesh.F)
    end = ["-o", files["out"], "--vertices", "150", "--samplings", "2"]
    assert main(["reconstruct", files["rest"], files["posed"], *end]) == 0
    assert "% of the diagonal in the mean" in capsys.readouterr().err
    rebuilt = reconstruct(mesh, posed, vertices=150, samplings=2).vertices
    assert np.array_equal(read_mesh(files["out"]).V, rebuilt)
    assert main(["transfer-pose", files["rest"], files["posed"], files["edited"], *end]) == 0
    moved = transfer_pose(mesh, posed, edited, vertices=150, samplings=2).vertices
    assert np.array_equal(read_mesh(files["out"]).V, moved)
    end += ["--residual", "--frames", "blended_affine"]
    assert main(["transfer-pose", files["rest"], files["posed"], files["edited"], *end]) == 0
    options = {"vertices": 150, "samplings": 2, "residual": True, "frames": "blended_affine"}
    moved = transfer_pose(mesh, posed, edited, **options).vertices
    assert np.array_equal(read_mesh(files["out"]).V, moved)


def test_the_command_refuses_another_mesh(mesh, tmp_path, capsys):
    write_mesh(tmp_path / "rest.ply", mesh.V, mesh.F)
    other = bumpy(3)
    write_mesh(tmp_path / "other.ply", other.V, other.F)
    out = tmp_path / "out.ply"
    assert main(["reconstruct", str(tmp_path / "rest.ply"), str(tmp_path / "other.ply"), "-o", str(out)]) == 2
    assert "must correspond" in capsys.readouterr().err and not out.exists()
