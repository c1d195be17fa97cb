"""The benchmark command on a small mesh: every kind writes its rows, and a mistake gives one sentence."""

import shlex
from pathlib import Path

import numpy as np
import pytest

from eval.bench import jobs
from eval.main import call, main
from eval.rows.frame import numbers, read_csv
from eval.run.warmup import tiny_transfer
from sshade.core.errors import InputError

ONE = "paper-1=paper samplings=1 vertices=150"
TOTAL = "seconds.total"


def bench(kind, *arguments):
    assert call("bench", [kind, *arguments]) == 0
    return read_csv(f"out/timing/{kind}.csv")


def test_a_line_a_repeat(machine, case):
    machine(0.0, 0.0, 0.2, 0.0)
    rows = bench("speed", "--methods", "elastic max_iterations=20", ONE, "--cases", case, "--rounds", "2")
    assert rows["method.name"].tolist() == ["elastic", "elastic", "paper-1", "elastic", "paper-1"]
    assert rows["kept"].tolist() == [False, True, True, True, True]
    assert rows["round"].tolist() == [1, 1, 1, 2, 2] and (rows["task.vertices"] == 642).all()
    assert (rows["method.samplings"].dropna() == 1).all() and "extrapolated_to" not in rows
    stages, whole = numbers(rows, "seconds.precompute") + numbers(rows, "seconds.solve"), numbers(rows, TOTAL)
    own = rows["method.name"] == "elastic"
    assert (stages[own] <= whole[own]).all() and (whole <= numbers(rows, "seconds.repeat")).all()


def test_iterations_are_extrapolated(machine, case):
    rows = bench("speed", "--methods", "arap", "--extrapolate", "arap", "--cases", case)
    assert (rows["iterations"] == 10).all() and (rows["extrapolated_to"] == 1000).all()
    rest = numbers(rows, TOTAL) - numbers(rows, "seconds.solve")
    assert (rest >= numbers(rows, "seconds.precompute")).all()
    measured = (rest + numbers(rows, "seconds.solve") * 10 / 1000) * numbers(rows, "calls")
    assert (measured / numbers(rows, "seconds.repeat")).between(0.3, 1.0).all()


def test_a_drag(machine, case):
    rows = bench("drag", "--methods", f"{ONE} solver.start=rest", "--cases", case, "--rounds", "1")
    (row,) = rows.to_dict("records")
    assert 0 < row["seconds.step"] <= row["seconds.step_95"] and row["seconds.settle"] > 0
    assert row["seconds.bind"] + row["seconds.first"] + 60 * row["seconds.step"] < row[TOTAL]
    parts = [row[f"seconds.step_{name}"] for name in ("solve", "carry", "output")]
    assert min(parts) > 0 and max(parts) < row["seconds.step_95"] and row["seconds.rebind"] > 0
    assert 0 <= row["drag.settled"] < 0.1 and 0 <= row["drag.return"] < 1 and 0 < row["drag.last"] < 10


def test_subdivisions_and_their_memory(machine, case):
    sizes = ["--sizes", "600", "2500", "2600"]
    rows = bench("scaling", "--methods", ONE, "--cases", case, *sizes, "--rounds", "1")
    assert rows["task.vertices"].tolist() == [642, 2562]  # 2500 and 2600 give the same mesh
    assert np.isfinite(numbers(rows, "peak_mib")).all() and rows["task.checksum"].nunique() == 2


def test_the_command_line(machine):
    rows = bench("whole", "--methods", "paper", "--rounds", "1")
    assert rows["method.name"].tolist() == ["sshade deform --method paper"]
    assert (numbers(rows, "seconds.method") > 0).all() and (numbers(rows, "peak_mib") > 50).all()
    assert (numbers(rows, "seconds.method") < numbers(rows, TOTAL)).all()


CASE = "'mesh mesh=rest.ply handles=pose.json'"
ARAP, DRAG = f"speed --cases {CASE} --methods arap", f"drag --cases {CASE} --methods"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (f"speed --methods elastik --cases {CASE}", "there is no method 'elastik'"),
        (f"{ARAP} 'arap start=rigid'", "two methods are named 'arap'"),
        (f"speed --methods transfer/paper --cases {CASE}", "takes a TransferTask"),
        ("whole --methods paper --sizes 9", "whole needs --cases"),
        (f"{ARAP} --extrapolate x", "none of the methods"),
        (f"{DRAG} '{ONE}' --extrapolate paper-1", "drag takes no --extrapolate"),
        (f"{DRAG} arap", "sshade.Deformer binds the methods paper and fast"),
        (f"{ARAP} --rounds 0", "take numbers from 1"),
        (f"{ARAP} --name ../x", "no name of a file"),
    ],
)
def test_mistakes_are_told_in_a_sentence(machine, case, capsys, arguments, words):
    assert main(["bench", *shlex.split(arguments)]) == 2
    told = capsys.readouterr().err.splitlines()[-1]
    assert told.startswith("error: ") and words in told
    assert not Path("out").exists()


def test_pose_transfers_are_neither_subdivided_nor_deformed_by_the_command(monkeypatch):
    monkeypatch.setattr(jobs, "task_of", lambda *_, **__: tiny_transfer())
    with pytest.raises(InputError, match="icosphere is a pose transfer"):
        jobs.TimedCase({}, level=1).load()
    with pytest.raises(InputError, match="icosphere is a pose transfer"):
        jobs.time_commands(["fast"], [jobs.TimedCase({})], rounds=1)
