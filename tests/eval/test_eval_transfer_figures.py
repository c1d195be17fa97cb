"""The picture of pose transfers: what it shows, coloured by which error, and from where."""

from __future__ import annotations

import numpy as np
import pytest
from eval_cases import bumpy_sphere

from eval.main import call
from eval.publish.figures import read_cases
from eval.publish.transfer_figures import error_of, rows_of, surroundings
from eval.run.run import run
from sshade.errors import InputError
from sshade.figures import edge_error
from sshade.mesh.mesh import Mesh
from sshade.pipeline.transfer_task import TransferTask

CAMERA = {"towards": np.array([1.0, 0, 0.2]), "up": np.array([0.0, 0, 1])}


def task(edited=True, known=True, *, bend=0.2, name="t") -> TransferTask:
    """What the rows of the fixture load again."""
    rest = bumpy_sphere(3)
    mesh = Mesh(rest.V * [1.3, 1, 1], rest.F) if edited else rest
    posed, truth = (V + bend * np.array([1.0, 0, 0]) * V[:, 2:] ** 2 for V in (rest.V, mesh.V))
    return TransferTask(name, mesh, rest, posed, truth=truth if known else None)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "bends"
    for bend in (0.1, 0.4):
        for name, target in (
            ("vertex", "baselines.vertex_frames"),
            ("sshade", "sshade.pipeline.transfer_task"),
        ):
            method = {"_target_": f"{target}.transfer"} | ({"vertices": 100} if name == "sshade" else {})
            source = {"_target_": "test_eval_transfer_figures.task", "bend": bend, "name": f"bend {bend}"}
            run(task(bend=bend, name=f"bend {bend}"), method, name=name, root=folder, source=source)
    return folder


def test_error_is_the_distance_to_the_truth_or_else_the_change_of_edges():
    known, unknown = task(), task(known=False)
    V = known.truth + [0, 0.03, 0.04]
    np.testing.assert_allclose(error_of(known, V), 100 * 0.05 / known.mesh.diagonal)
    np.testing.assert_array_equal(error_of(unknown, V), edge_error(unknown.mesh, V))


def test_rows_show_what_is_given_what_is_true_and_what_was_found():
    for edited, known, expected in (
        (True, True, ["rest", "edited", "pose", "truth", "m"]),
        (True, False, ["rest", "edited", "pose", "m"]),
        (False, True, ["rest", "pose", "m"]),
    ):
        case = task(edited, known)
        whole, close = rows_of(case, {"m": case.posed}, **CAMERA)
        assert list(whole.shapes) == list(close.shapes) == expected
        assert list(whole.errors) == list(close.errors) == ["m"]
        # One scale in all panels of a row, and every shape fits.
        for row in (whole, close):
            assert len({(view.width, view.height) for view in row.views}) == 1
            for V, view in zip(row.shapes.values(), row.views, strict=True):
                assert (np.abs((V - view.centre) @ view.right) < view.width / 2).all()
                assert (np.abs((V - view.centre) @ view.up) < view.height / 2).all()


def test_the_close_up_shows_the_largest_error_from_outside():
    case = task(edited=False)
    V = case.truth.copy()
    V[17] += 0.3
    _, close = rows_of(case, {"good": case.truth, "bad": V}, **CAMERA)
    assert close.errors["bad"].max() == error_of(case, V)[17] > 0
    assert (close.mesh.face_normals @ close.views[0].towards).min() > 0.3


def test_surroundings_hang_together():
    mesh = bumpy_sphere(3)
    two = Mesh(np.concatenate([mesh.V, mesh.V + [0.01, 0, 0]]), np.concatenate([mesh.F, mesh.F + mesh.n]))
    ids, patch = surroundings(two, 5, 0.6)
    assert 5 in ids and ids.max() < mesh.n and 10 < patch.m < 200
    np.testing.assert_array_equal(patch.V, mesh.V[ids])
    assert (np.linalg.norm(patch.V - mesh.V[5], axis=1) <= 0.6).all()
    assert patch.topology.components == 1
    ids, patch = surroundings(mesh, 5, 1e-6)
    assert patch.m == (mesh.F == 5).any(axis=1).sum() and 5 in ids


def test_the_worst_case_by_a_metric(runs):
    cases = read_cases(runs, names=[], methods=["vertex", "sshade"], worst="hausdorff")
    assert [case.task.name for case in cases] == ["bend 0.4"]
    assert list(cases[0].results) == ["vertex", "sshade"]
    named = read_cases(runs, names=["bend 0.1"], methods=[], worst="hausdorff")
    assert [case.task.name for case in named] == ["bend 0.1"]
    with pytest.raises(InputError, match="no case has the metric 'beauty'"):
        read_cases(runs, names=[], methods=[], worst="beauty")


def test_the_picture_is_drawn(runs, tmp_path):
    pytest.importorskip("pyvista")
    pyplot = pytest.importorskip("matplotlib.pyplot")
    out = tmp_path / "transfers.png"
    camera = ["--towards", "1", "0", "0.2", "--up", "0", "0", "1"]
    assert (
        call("figures", [str(runs), "--worst", "chamfer", "--methods", "sshade", "-o", str(out), *camera])
        == 0
    )
    picture = pyplot.imread(out)
    height, width = picture.shape[:2]
    assert width > 1800 and height > 800
    # Something in each of the two rows of five panels; the given shapes are grey, the result is not.
    for i in range(2):
        for j in range(5):
            panel = picture[int(height * (0.2 + 0.5 * i)) : int(height * (0.4 + 0.5 * i))]
            panel = panel[:, int(width * 0.92 / 5 * j) : int(width * 0.92 / 5 * (j + 1)), :3]
            assert (panel < 0.9).any()
            if i == 0:
                colourful = (np.ptp(panel, axis=2) > 0.15).mean()
                assert colourful > 0.05 if j == 4 else colourful < 0.02
