"""The comparison picture shows stored runs of the chosen cases and methods; it runs no method."""

import re

import numpy as np
import pytest
import yaml
from PIL import Image

from eval.installation import CONFIGURATION
from eval.main import call
from eval.publish import figures, panels
from eval.publish.figures import read_cases, read_picture
from eval.publish.plotting import new_figure, save, style
from eval.rows.files import PUBLISHED
from eval.rows.frame import read_csv
from eval.rows.store import read_row, run_folders
from sshade.core.errors import InputError


def shown(cases):
    return [(case.task.name, list(case.results)) for case in cases]


def test_cases_come_from_the_run_folders(tiny_runs):
    every = ["arap", "learned", "stretching"]
    assert shown(read_cases(tiny_runs, names=[], methods=[])) == [("bumpy_10", every), ("bumpy_40", every)]
    only = read_cases(tiny_runs, names=["bumpy_40"], methods=["stretching"])
    assert shown(only) == [("bumpy_40", ["stretching"])]
    assert only[0].results["stretching"] == pytest.approx(1.5 * only[0].task.mesh.V, rel=1e-6)


def test_the_case_where_a_metric_is_largest(tiny_runs):
    (case,) = read_cases(tiny_runs, names=[], methods=["stretching"], worst="handle")
    assert case.task.name == "bumpy_40"
    named = read_cases(tiny_runs, names=["bumpy_10"], methods=[], worst="handle")
    assert [case.task.name for case in named] == ["bumpy_10"]


def test_a_method_without_a_result_has_its_reason_in_its_place(tiny_runs):
    methods = ["stretching", "failing", "arap"]
    (case,) = read_cases(tiny_runs, names=["bumpy_10"], methods=methods)
    assert list(case.results) == methods
    (reason,) = {row["reason"] for row in map(read_row, run_folders(tiny_runs / "failing"))}
    assert reason.endswith(case.results["failing"]) and not re.match(r"\w+Error: ", case.results["failing"])
    assert case.task.name == "bumpy_10"


def test_what_the_configuration_says_of_pictures_names_published_runs():
    """A picture can be made from published runs only if the rows have its cases and methods."""
    told = yaml.safe_load((CONFIGURATION / "pictures.yaml").read_text())
    for name, picture in told.items():
        assert set(picture) <= {"title", "tasks", "methods", "towards", "up"}
        assert picture == read_picture(name)
        path = PUBLISHED / "rows" / f"{name}.csv"
        if path.is_file():
            rows = read_csv(path)
            assert set(picture["tasks"]) <= set(rows["task.name"])
            assert set(picture["methods"]) <= set(rows["method.name"])
    assert read_picture("nothing") == {}


def test_the_picture_of_an_experiment_is_that_of_the_configuration(tiny_runs, tmp_path, monkeypatch):
    told = {"tasks": ["bumpy_40"], "methods": ["failing", "stretching"], "up": [0.0, 0.0, 1.0], "title": "T"}
    monkeypatch.setattr(figures, "read_picture", lambda name: told if name == tiny_runs.name else {})
    drawn = {}
    monkeypatch.setattr(panels, "draw", lambda rows, **options: drawn.update(rows=rows, **options))
    monkeypatch.setattr(figures, "save", lambda *args, **options: None)
    assert call("figures", [str(tiny_runs), "-o", str(tmp_path / "a.png")]) == 0
    (row,) = drawn["rows"]
    assert [panel.name for panel in row.panels] == ["rest", "failing", "stretching"]
    assert drawn["title"].startswith("T\nThe lighter, the less edges") and "change of edge" in drawn["label"]
    assert row.panels[0].view.axes[1].argmax() == 2
    assert call("figures", [str(tiny_runs), "--cases", "bumpy_10", "--up", "0", "1", "0"]) == 0
    (row,) = drawn["rows"]
    assert row.name == "bumpy_10" and row.panels[0].view.axes[1].argmax() == 1


def test_pictures_have_few_colours_and_keep_the_rare_ones(tmp_path):
    with style():
        figure = new_figure(4, 3)
        axes = figure.add_subplot()
        axes.set_axis_off()
        gradient = np.linspace(0, 1, 400)[None] * np.ones((300, 1))
        pixels = np.stack([gradient, 0.4 * gradient, 0.3 - 0.2 * gradient], axis=-1)
        pixels[:6, :6] = [0.13, 0.40, 0.67]
        axes.imshow(pixels, aspect="auto", interpolation="nearest")
    save(figure, tmp_path / "whole.png")
    save(figure, tmp_path / "small.png", small=True)
    with Image.open(tmp_path / "small.png") as image:
        few = np.asarray(image.convert("RGB")).astype(int)
    assert len(np.unique(few.reshape(-1, 3), axis=0)) <= 256
    assert np.abs(few - [33, 102, 171]).max(axis=-1).min() <= 8
    with Image.open(tmp_path / "whole.png") as image:
        assert image.width > few.shape[1]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"names": ["bumpy_99"]}, "no case 'bumpy_99'; there are bumpy_10, bumpy_40"),
        ({"methods": ["failing"]}, "case 'bumpy_10' has no result of failing"),
        ({"methods": ["arap", "nobody"]}, "no run of 'nobody'"),
        ({"worst": "beauty"}, "no case has the metric 'beauty'"),
    ],
)
def test_what_was_not_run_is_a_clear_error(tiny_runs, options, message):
    with pytest.raises(InputError, match=message):
        read_cases(tiny_runs, **{"names": [], "methods": [], **options})
