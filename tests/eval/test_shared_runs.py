"""Runs that another experiment has made."""

import pytest
from eval_cases import bumpy_task

from eval.rows.store import read_row, run_folders
from eval.run.run import run

STRETCHING, FAILING = ({"_target_": f"eval_cases.{name}"} for name in ("stretching", "failing"))


@pytest.fixture
def make(tmp_path):
    task = bumpy_task(level=2)

    def make(method, experiment, **options):
        return run(task, method, name="m", root=tmp_path / experiment, **options)

    return make


def test_an_equal_run_with_a_result_is_taken_along(make, tmp_path):
    first = make(STRETCHING, "a")
    second = make(STRETCHING, "b", shared=tmp_path / "a")
    assert second.row == first.row == read_row(second.folder) and second.folder != first.folder
    assert (second.folder / "vertices.npy").read_bytes() == (first.folder / "vertices.npy").read_bytes()
    assert make(STRETCHING, "c").row["date"] != first.row["date"]  # which shares nothing
    assert make(STRETCHING, "b", shared=tmp_path / "a", seed=1).row["seed"] == 1
    assert len(run_folders(tmp_path / "b")) == 2
    failed = make(FAILING, "a")
    assert make(FAILING, "b", shared=tmp_path / "a").row["date"] > failed.row["date"]


def test_what_is_there_already_or_asked_for_anew_is_not_replaced(make, tmp_path):
    earlier = make(STRETCHING, "b")
    other = make(STRETCHING, "a")
    assert make(STRETCHING, "b", shared=tmp_path / "a").row == earlier.row
    forced = make(STRETCHING, "b", shared=tmp_path / "a", force=True)
    assert forced.row["date"] > other.row["date"]
