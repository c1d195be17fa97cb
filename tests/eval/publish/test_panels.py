"""Rows of panels: their shapes, colours and views."""

import numpy as np
import pytest
from eval_cases import bumpy_task

from eval.publish.panels import draw, error_label, error_of, rows_of
from sshade.core.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.plotting.pictures import edge_error
from sshade.problem.task import TransferTask
from tests.shapes import bumpy

CAMERA = {"towards": np.array([1.0, 0, 0.2]), "up": np.array([0.0, 0, 1])}


def transfer(edited=True, known=True) -> TransferTask:
    rest = bumpy(3)
    mesh = Mesh(rest.V * [1.3, 1, 1], rest.F) if edited else rest
    posed, truth = (V + np.array([0.2, 0, 0]) * V[:, 2:] ** 2 for V in (rest.V, mesh.V))
    return TransferTask("t", mesh, rest, posed, truth=truth if known else None)


def assert_fits(row):
    """Assert that all panels of a row have one scale, and that every shape fits into its panel."""
    assert len({tuple(view.size) for view in row.views}) == 1
    for V, view in zip(row.shapes.values(), row.views, strict=True):
        assert (np.abs((V - view.centre) @ view.axes.T) < view.size / 2).all()


def test_error_is_the_distance_to_the_truth_or_else_the_change_of_edges():
    known, unknown = transfer(), transfer(known=False)
    V = known.truth + [0, 0.03, 0.04]
    np.testing.assert_allclose(error_of(known, V), 100 * 0.05 / known.mesh.diagonal)
    np.testing.assert_array_equal(error_of(unknown, V), edge_error(unknown.mesh, V))
    assert "ground truth" in error_label(known)
    assert error_label(unknown) == error_label(bumpy_task(level=1)) and "edge" in error_label(unknown)


def test_a_deformation_shows_the_rest_shape_with_its_handles_and_each_result():
    task = bumpy_task(level=2)
    (row,) = rows_of(task, {"far": task.mesh.V + [0, 0, 3.0]}, **CAMERA)
    assert list(row.shapes) == ["rest", "far"] and list(row.errors) == ["far"]
    assert row.handles is task.handles and row.views[0].axes[1, 2] > 0.9
    assert_fits(row)
    with pytest.raises(InputError, match="upward direction"):
        rows_of(task, {}, towards=np.array([0.0, 0, 1]), up=np.array([0.0, 0, 1]))


def test_a_method_without_a_result_has_a_panel_that_says_why():
    task = bumpy_task(level=1)
    (row,) = rows_of(task, {"lost": "it ran out of time", "far": task.mesh.V + [0, 0, 3.0]}, **CAMERA)
    case = transfer()
    for found in (row, *rows_of(case, {"lost": "no", "far": case.posed}, **CAMERA)):
        assert list(found.shapes)[-2:] == ["lost", "far"] and len(found.views) == len(found.shapes)
        assert isinstance(found.shapes["lost"], str) and "lost" not in found.errors
    figure = draw([row], title="t", top=100.0, label="error")
    lost, far = figure.axes[1:3]
    assert lost.get_title() == "lost" and not lost.images and far.images
    assert [text.get_text() for text in lost.texts] == ["it ran out of time"]


@pytest.mark.parametrize(
    ("edited", "known", "expected"),
    [
        (True, True, ["rest", "edited", "pose", "truth", "m"]),
        (True, False, ["rest", "edited", "pose", "m"]),
        (False, True, ["rest", "pose", "m"]),
    ],
)
def test_a_transfer_shows_what_is_given_what_is_true_and_what_was_found(edited, known, expected):
    case = transfer(edited, known)
    whole, close = rows_of(case, {"m": case.posed}, **CAMERA)
    for row in (whole, close):
        assert list(row.shapes) == expected and list(row.errors) == ["m"]
        assert_fits(row)


def test_the_close_up_shows_the_largest_error_from_outside():
    case = transfer(edited=False)
    V = case.truth.copy()
    V[17] += 0.3
    _, close = rows_of(case, {"good": case.truth, "bad": V}, **CAMERA)
    assert close.errors["bad"].max() == error_of(case, V)[17] > 0
    assert (close.mesh.face_normals @ close.views[0].axes[2]).min() > 0.3
