"""The study of splats on a deformed mesh: its ground truth along normals, and its tables."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eval.main import main
from eval.timing.carried import _along_normals, compare_poses, places, truth_along_normals
from sshade.io.meshes import write_mesh
from tests.shapes import bent, icosphere

BALL = icosphere(3)


def test_the_truth_along_normals_is_exact_for_rigid_motions_and_grows_with_a_ball():
    place = places(BALL, 200, 0.02, seed=1)
    X, _ = _along_normals(BALL.V, BALL.F, place)
    R = Rotation.from_rotvec([0.4, 1.0, -2.0]).as_matrix()
    true = truth_along_normals(BALL, BALL.V @ R.T + [1, 2, 3], place)
    assert true.positions == pytest.approx(X @ R.T + [1, 2, 3]) and abs(true.maps - R).max() < 1e-9
    grown = truth_along_normals(BALL, 2 * BALL.V, place)
    assert np.linalg.norm(grown.positions - 2 * X, axis=1) == pytest.approx(abs(place.height))
    across = np.einsum("nij,nj->ni", grown.maps, X / np.linalg.norm(X, axis=1, keepdims=True))
    assert np.linalg.norm(across, axis=1) == pytest.approx(np.ones(200), abs=0.02)


def test_splats_on_a_bend_are_nearest_to_the_truth_with_sshade():
    ball = icosphere(4)
    table = compare_poses(ball, {"bent": bent(ball.V)}).splitlines()
    ours, handle, blend = ([float(cell) for cell in row.split("|")[3:6]] for row in table[2:5])
    assert all(a < b and a < c for a, b, c in zip(ours, handle, blend, strict=True))


def test_other_faces_two_poses_of_a_name_and_a_negative_number_are_refused(tmp_path, capsys):
    write_mesh(tmp_path / "rest.ply", BALL.V, BALL.F)
    write_mesh(tmp_path / "other.ply", BALL.V, BALL.F[:, [1, 2, 0]])
    assert main(["carried", "--mesh", f"{tmp_path}/rest.ply", "--posed", f"{tmp_path}/other.ply"]) == 2
    assert "other.ply has other faces than the mesh at rest" in capsys.readouterr().err
    assert main(["carried", "--mesh", f"{tmp_path}/rest.ply", "--posed", *2 * [f"{tmp_path}/rest.ply"]]) == 2
    assert "two poses are named rest" in capsys.readouterr().err
    assert main(["carried", "--points", "-3"]) == 2
    assert "--points takes a whole number from 0, not -3" in capsys.readouterr().err
