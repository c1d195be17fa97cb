"""Pictures of stored runs: cases, rows of panels, colours, views, and the chart of time against truth."""

import re
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pandas as pd
import pytest
from eval_cases import bumpy_task

from eval.main import call
from eval.publish import figures, panels, report
from eval.publish.figures import of_one_error, read_cases
from eval.publish.panels import Camera, Case, error_of, row_of
from eval.publish.report import scales_of
from eval.rows.collect import Experiment
from eval.rows.frame import read_csv, records
from eval.rows.store import read_row, run_folders
from sshade import DeformationTask, Mesh, TransferTask
from sshade.core.progress import silent
from sshade.plotting.pictures import edge_error
from tests.shapes import bent, bumpy


@pytest.fixture
def experiment(tiny) -> Experiment:
    return Experiment("tiny", read_csv(tiny), tiny.parents[1] / "runs/tiny")


def test_cases_come_from_the_run_folders(experiment):
    every = ["arap", "learned", "stretching"]
    cases = read_cases(experiment, names=[], methods=[])
    assert {case.task.name: list(case.results) for case in cases} == {"bumpy_10": every, "bumpy_40": every}
    row = next(one for one in records(experiment.rows) if one["method.name"] == "arap")
    assert experiment.vertices(row) is not None
    assert experiment.vertices(row | {"date": "2020-01-01"}) is None  # another run of the same key
    only = read_cases(experiment, names=["bumpy_40"], methods=["stretching"])
    assert only[0].results["stretching"] == pytest.approx(1.5 * only[0].task.mesh.V, rel=1e-6)


def test_a_method_without_a_result_has_its_reason_in_its_place(experiment):
    methods = ["stretching", "failing", "arap"]
    (case,) = read_cases(experiment, names=["bumpy_10"], methods=methods)
    (reason,) = {row["reason"] for row in map(read_row, run_folders(experiment.runs / "failing"))}
    assert reason.endswith(case.results["failing"]) and not re.match(r"\w+Error: ", case.results["failing"])
    again = experiment.rows.assign(status="failed", date="2999-01-01")  # after runs with a result
    repeated = experiment._replace(rows=pd.concat([experiment.rows, again]))
    (later,) = read_cases(repeated, names=["bumpy_10"], methods=methods)
    np.testing.assert_array_equal(later.results["stretching"], case.results["stretching"])


def test_colours_mean_the_same_in_all_rows_of_a_picture():
    rest = bumpy_task(level=1)
    known = replace(rest, truth=rest.mesh.V)
    same, mixed = ([Case(task, {}, {}) for task in tasks] for tasks in ((known, known), (known, rest)))
    assert of_one_error(same) is same
    for cases in (of_one_error(mixed), of_one_error(same, "edge")):
        assert [case.task.truth for case in cases] == [None, None]


def test_the_scale_of_a_report_keeps_one_number_of_each_shape(monkeypatch):
    rest = bumpy_task(level=1)
    case = Case(rest, {"a": 1.1 * rest.mesh.V, "b": bent(rest.mesh.V)}, {})
    monkeypatch.setattr(report, "colour_range", lambda own: [np.size(values) for values in own])
    assert list(scales_of([case, case]).values()) == [[1, 1, 1, 1]]


def test_a_report_loads_one_shape_after_another(experiment, monkeypatch):
    def first_alone(cases) -> dict[str, float]:
        next(iter(cases))
        raise InterruptedError

    load = Mock(wraps=report.stored_case)
    monkeypatch.setattr(report, "stored_case", load)
    monkeypatch.setattr(report, "scales_of", first_alone)
    with pytest.raises(InterruptedError):
        report.write_page([experiment], cases=[], progress=silent)
    assert load.call_count == 1


def test_the_picture_of_an_experiment_is_that_of_the_configuration(tiny, tmp_path, monkeypatch):
    told = {"tasks": ["bumpy_40"], "methods": ["failing", "stretching"], "up": [0.0, 0.0, 1.0], "title": "T"}
    monkeypatch.setattr(figures, "read_picture", {"tiny": told}.get)
    drawn = {}
    monkeypatch.setattr(panels, "draw", lambda rows, **options: drawn.update(rows=rows, **options))
    monkeypatch.setattr(figures, "save", lambda *args, **options: None)
    monkeypatch.chdir(tiny.parents[2])
    assert call("figures", ["tiny", "-o", str(tmp_path / "a.png")]) == 0
    (shown_row,) = drawn["rows"]
    assert [panel.name for panel in shown_row.panels] == ["rest", "failing", "stretching"]
    assert drawn["title"].startswith("T\nThe lighter, the less edges") and "change of edge" in drawn["label"]
    assert shown_row.panels[0].view.axes[1].argmax() == 2


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
