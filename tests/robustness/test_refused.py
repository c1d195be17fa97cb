"""Damaged datasets and runs are refused, and nothing is written."""

import pickle
import shutil
from pathlib import Path

import numpy as np
import pytest

from eval.rows.frame import read_csv, write_csv
from tests.robustness.case import assert_refused, check_refusal, run
from tests.robustness.working import RUN, cut, dataset, runs

REST = Path("balls/subject_00/rest.ply")


@pytest.mark.parametrize(
    ("damage", "words"), [(REST.unlink, "is missing; run the same"), (lambda: cut(REST), "not the file that")]
)
def test_a_damaged_dataset(here, damage, words):
    dataset()
    damage()
    assert_refused("sshade-eval", RUN, words)


def in_run(name: str) -> Path:
    """Return a file of the first run."""
    return min(Path("out/runs").rglob(name))


def of_another_function() -> None:
    rows = read_csv("out/rows/tiny.csv")
    write_csv("out/rows/tiny.csv", rows.assign(**{"task.source": '{"_target_": "os.getcwd"}'}))


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda: cut(in_run("vertices.npy")), "vertices.npy: not the file of a run"),
        (lambda: in_run("vertices.npy").write_bytes(pickle.dumps([1])), "not the file of a run"),
        (lambda: np.save(in_run("vertices.npy"), np.zeros((5, 3))), "5"),
        (lambda: shutil.rmtree("balls"), "balls"),
        (of_another_function, "and no task"),
    ],
)
def test_figures_of_a_damaged_run(here, damage, words):
    """Figures read the files and the source that a row names."""
    runs()
    damage()
    check_refusal(run("sshade-eval figures tiny"), words)


def test_outputs_of_tables(sound):
    runs()
    assert_refused("sshade-eval", "tables tiny -o body.ply", "body.ply: the folder cannot be created")
    assert_refused("sshade-eval", "tables tiny -o out/rows", "holds the rows")
