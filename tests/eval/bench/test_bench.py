"""The benchmark command on a small mesh: every kind writes its rows, and a mistake gives one sentence."""

from itertools import count, repeat
from pathlib import Path
from time import sleep
from types import SimpleNamespace

import numpy as np
import pytest

from baselines import arap
from eval.bench import calls, jobs, quality, turns
from eval.bench.bench import read_cases, write_tables
from eval.bench.cases import moved
from eval.bench.turns import ATTEMPTS, Job, Reading, take_turns, used_by_others
from eval.main import call, main
from eval.rows.frame import numbers, read_csv, write_csv
from eval.run.attempt import attempt
from eval.run.warmup import tiny_transfer
from sshade import InputError

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


def test_no_call_can_use_what_another_one_left(machine, case, monkeypatch):
    """The meshes and the targets of calls differ, and no name tells which case it is."""
    given, original = [], arap.arap

    def seen(task, **options):
        given.append(task)
        return original(task, **options)

    monkeypatch.setattr(arap, "arap", seen)
    bench("speed", "--methods", "arap max_iterations=2 warm_up=null", "--cases", case, "--rounds", "2")
    assert len(given) == 3 and len({id(task.mesh) for task in given}) == 3
    assert {task.name for task in given}.isdisjoint({"rest", "pose", "rest.ply"})
    first, second, _ = (task.handles for task in given)
    gaps = np.linalg.norm(first.target - second.target, axis=1) / given[0].mesh.diagonal
    assert (gaps[first.dynamic] > 1e-8).all() and gaps.max() <= 2e-6 and (gaps[~first.dynamic] == 0).all()


def test_calls_of_a_transfer_have_poses_of_their_own():
    first, second = (moved(tiny_transfer(), number).posed for number in (1, 2))
    assert 0 < np.abs(first - second).max() < 1e-5


def test_a_method_that_remembers_is_refused(machine, case, monkeypatch, capsys):
    remembered, original = [], arap.arap

    def remembering(task, **options):
        remembered.append(original(task, **options))
        return remembered[0]

    monkeypatch.setattr(arap, "arap", remembering)
    assert main(["bench", "speed", "--methods", "arap warm_up=null", "--cases", case]) == 2
    assert "it gives the same shape for other targets" in capsys.readouterr().err


def test_measures_are_compared_with_rows_of_the_same_method_and_data(machine, case, capsys):
    dataset = ["dataset=mesh", "dataset.mesh=rest.ply", "dataset.handles=pose.json"]
    assert call("run", ["method=arap", *dataset, "run.experiment=mine"]) == 0
    assert call("collect", ["mine_mesh"]) == 0
    rows = bench("speed", "--methods", "arap", "elastic", "--cases", case, "--rounds", "1")
    assert rows["quality"].tolist() == ["out/rows/mine_mesh.csv", "no row"]
    assert (numbers(rows, "metric.edge") > 0).all()
    table = Path("out/tables/speed.md").read_text()
    assert "measures agree: arap out/rows/mine_mesh.csv; elastic no row." in table
    assert "- Each call has new meshes, and targets moved by 1e-06 of the diagonal." in table
    edge = {"metric.edge": numbers(rows, "metric.edge")[0] * 1.1}
    changed = read_csv("out/rows/mine_mesh.csv").assign(**edge)
    write_csv("out/rows/mine_mesh.csv", changed)
    quality._rows.cache_clear()
    assert main(["bench", "speed", "--methods", "arap", "--cases", case, "--rounds", "1"]) == 2
    told = capsys.readouterr().err
    assert "metric.edge is" in told and "out/rows/mine_mesh.csv: the rows are of other code" in told


def test_iterations_are_extrapolated(machine, case, monkeypatch):
    def timed(*given, **more):
        done = attempt(*given, **more)
        return done._replace(facts=done.facts | {"seconds.solve": 2.0, "seconds.total": 5.0})

    monkeypatch.setattr(calls, "attempt", timed)
    rows = bench("speed", "--methods", "arap", "--extrapolate", "arap", "--cases", case)
    assert (rows["iterations"] == 10).all() and (rows["extrapolated_to"] == 1000).all()
    assert (numbers(rows, "seconds.solve") == 200).all() and (numbers(rows, TOTAL) == 203).all()


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
    assert [one.level for one in read_cases([case], sizes=[1300])] == [1]  # 1300 is less than twice 642 off
    assert np.isfinite(numbers(rows, "peak_mib")).all() and rows["task.checksum"].nunique() == 2


def test_the_command_line(machine):
    rows = bench("whole", "--methods", "paper", "--rounds", "1")
    assert rows["method.name"].tolist() == ["sshade deform --method paper"]
    assert (numbers(rows, "seconds.method") > 0).all() and (numbers(rows, "peak_mib") > 50).all()
    assert (numbers(rows, "seconds.method") < numbers(rows, TOTAL)).all()


ALIKE = repeat(1.0)


def job(name, order, seconds=ALIKE):
    def call():
        order.append(name)
        sleep(2e-3)
        return {TOTAL: next(seconds)}

    return Job({"method.name": name, "method.hash": name, "task.name": "t", "task.checksum": "c"}, call)


def test_several_rejected_repeats_in_a_row_end_the_command(machine):
    machine(0.3)
    order = []
    with pytest.raises(InputError, match="not quiet: 5 repeats of a on t in a row .* used 30% .*nothing was"):
        take_turns([job("a", order)], rounds=3)
    assert order == ["a"] * (1 + ATTEMPTS)


def test_seconds_of_a_repeat_are_the_mean_of_its_calls(machine, monkeypatch):
    monkeypatch.setattr(turns, "SHORTEST", 0.02)
    seconds = map(float, count())
    (row,) = take_turns([job("a", [], seconds)], rounds=1)
    assert row["calls"] > 1 and row[TOTAL] == (1 + row["calls"]) / 2  # call 0 is the warm-up


@pytest.mark.parametrize(("busy", "own", "share"), [(19.0, 18.1, 0.045), (19.0, 17.8, 0.06), (5.0, 5.1, 0.0)])
def test_the_share_of_others(busy, own, share):
    """The system counts whole ticks, so it may count less than the process."""
    before, after = Reading(100.0, 50.0, 40.0), Reading(110.0, 50 + busy, 40 + own)
    assert used_by_others(before, after, cores=2) == pytest.approx(share)


def test_the_peak_of_a_call_is_that_since_the_call_began(monkeypatch):
    told = []
    monkeypatch.setattr(jobs, "reset_peak_memory", lambda: told.append("reset"))
    monkeypatch.setattr(jobs, "process_memory", lambda name: told.append(name) or 3 << 20)
    row = jobs._with_peak(Job({}, lambda: told.append("call") or {"a": 1}), 1 << 20)
    assert told == ["reset", "call", "VmHWM"] and row == {"a": 1, "peak_mib": 2}


def test_the_time_of_children_and_of_their_children_is_our_own(monkeypatch):
    child, grandchild = (SimpleNamespace(cpu_times=lambda own=own: [own, 0, 0, 0]) for own in (1e3, 1e6))
    found = {True: [child, grandchild], False: [child]}
    process = SimpleNamespace(children=lambda recursive=False: found[recursive])
    monkeypatch.setattr(turns.psutil, "Process", lambda: process)
    assert turns.read_machine().own > 1e6 + 1e3


RESULTS = Path(__file__).parents[3] / "results"


PUBLISHED = sorted((RESULTS / "timing").glob("*.csv"))


@pytest.mark.parametrize("path", PUBLISHED, ids=lambda path: path.stem)
def test_published_tables_follow_from_published_rows_of_one_clean_commit_and_machine(path, tmp_path):
    """After a change of tables, write_tables makes the published ones again."""
    found = read_csv(path)
    write_csv(tmp_path / "again.csv", found)
    assert (tmp_path / "again.csv").read_bytes() == path.read_bytes()
    assert not found["env.modified"].any() and found["env.commit"].all()
    assert all(found[column].nunique() == 1 for column in ("env.commit", "env.machine_id"))
    write_tables(found, tmp_path / path.stem)
    for suffix in ("csv", "md"):
        made = (tmp_path / f"{path.stem}.{suffix}").read_bytes()
        assert made == (RESULTS / "tables" / f"{path.stem}.{suffix}").read_bytes()
