"""Rows of panels: their shapes, colours, titles and views."""

import numpy as np
from eval_cases import bumpy_task

from eval.publish.panels import Camera, Case, error_of, row_of
from sshade import DeformationTask, Mesh, TransferTask
from sshade.plotting.pictures import edge_error
from tests.shapes import bumpy

CAMERA = Camera(towards=np.array([1.0, 0, 0.2]), up=np.array([0.0, 0, 1]))


def transfer(known=True) -> TransferTask:
    rest = bumpy(3)
    mesh = Mesh(rest.V * [1.3, 1, 1], rest.F)
    posed, truth = (V + np.array([0.2, 0, 0]) * V[:, 2:] ** 2 for V in (rest.V, mesh.V))
    return TransferTask("t", mesh, rest, posed, truth=truth if known else None)


def shown(task, **results):
    """Return the row of a case, and assert that its panels have one scale and that every shape fits."""
    row = row_of(Case(task, results, {"far": {"seconds.total": 1.25}}), CAMERA)
    assert len({tuple(panel.view.size) for panel in row.panels}) == 1
    for panel in (panel for panel in row.panels if isinstance(panel.shape, np.ndarray)):
        assert (np.abs((panel.shape - panel.view.centre) @ panel.view.axes.T) < panel.view.size / 2).all()
    return row


def names(row) -> list[str]:
    return [panel.name for panel in row.panels]


def test_error_is_the_distance_to_the_truth_or_else_the_change_of_edges():
    known, unknown = transfer(), transfer(known=False)
    V = known.truth + [0, 0.03, 0.04]
    np.testing.assert_allclose(error_of(known, V), 100 * 0.05 / known.mesh.diagonal)
    np.testing.assert_array_equal(error_of(unknown, V), edge_error(unknown.mesh, V))


def test_a_deformation_shows_the_rest_shape_the_true_pose_and_each_result():
    task = bumpy_task(level=2)
    true = DeformationTask(task.name, task.mesh, task.handles, truth=task.mesh.V + [0, 0, 0.1])
    row = shown(true, far=task.mesh.V + [0, 0, 3.0], lost="it ran out of time", near=true.truth)
    assert names(row) == ["rest", "true pose", "far", "lost", "near"] and row.nearest == "near"
    rest, _, far, lost, _ = row.panels
    assert rest.handles is task.handles and far.handles is None and rest.view.axes[1, 2] > 0.9
    assert lost.shape == "it ran out of time" and lost.error is None
    assert far.caption == f"{100 * 2.9 / task.mesh.diagonal:.2g} %, 1.2 s"
    row = shown(task, far=task.mesh.V)
    assert names(row) == ["rest", "far"]


def test_a_transfer_shows_what_is_given_what_is_true_and_what_was_found():
    case = transfer()
    row = shown(case, m=case.posed, lost="no")
    assert names(row) == ["rest", "edited", "pose", "true pose", "m", "lost"]
    assert [panel.name for panel in row.panels if panel.error is not None] == ["m"]
