"""The record of a sweep: what its files say, counts, the estimated end, and the command that tells them."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from time import monotonic, sleep

import pytest
from eval_cases import bumpy_task

from eval.main import call
from eval.run.monitor import Monitor
from eval.run.run import run
from eval.run.sweep import (
    Ended,
    Plan,
    SweepRecord,
    estimated_end,
    forget,
    records,
    told_counts,
    told_end,
    told_run,
    told_summary,
)
from sshade.errors import InputError

BEGIN = datetime(2026, 5, 1, 12, tzinfo=UTC)
ROW = {
    "method.name": "arap",
    "task.name": "bumpy",
    "seed": 3,
    "status": "ok",
    "iterations": 40.0,
    "seconds.total": 2.0,
}


def at(seconds):
    return BEGIN + timedelta(seconds=seconds)


def plan(*methods, poses=1, begin=BEGIN):
    """Cases outside, methods inside, as the experiments sweep."""
    runs = [{"pose": str(pose), "method": method} for pose in range(poses) for method in methods]
    return Plan(begin, runs)


def ended(number, end, seconds, **facts):
    return Ended(number, at(end), seconds, **{"row": ROW, **facts})


def test_the_record_gives_back_what_was_put_in(tmp_path):
    experiment = tmp_path / "quick"
    record = SweepRecord.create(experiment, plan("arap", "sshade"))
    assert record.plan().runs == [{"pose": "0", "method": "arap"}, {"pose": "0", "method": "sshade"}]
    assert record.plan().begin == BEGIN and record.plan().host
    assert record.ended() == []
    done = run(bumpy_task(level=2), {"_target_": "eval_cases.stretching"}, name="s", root=experiment)
    record.add(1, seconds=1.5, row_folder=done.folder, kept=True)
    record.add(0, seconds=0.5, row_folder=None, problems=["seed=-1 is no seed"])
    for reader in (record, *records(experiment)):
        first, second = reader.ended()
        assert (first.number, first.row, first.kept, first.seconds) == (1, done.row, True, 1.5)
        assert (second.number, second.row, second.problems) == (0, None, ["seed=-1 is no seed"])
    record.remove()
    assert [path.name for path in experiment.iterdir()] == ["s"]
    record.add(0, seconds=0.5, row_folder=None)  # a worker that outlives its sweep
    assert [path.name for path in experiment.iterdir()] == ["s"]


def test_two_sweeps_in_one_folder_begin_and_end_at_any_time(tmp_path, monkeypatch):
    """Each removes the folder of records when it is the last: the other may be about to use it."""
    one = SweepRecord.create(tmp_path, plan("a"))
    two = SweepRecord.create(tmp_path, plan("b", begin=at(1)))
    one.remove()
    assert two.plan().runs == [{"pose": "0", "method": "b"}]
    real = Path.rmdir

    def gone_already(folder):
        real(folder)
        real(folder)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "rmdir", gone_already)
        two.remove()
    assert not list(tmp_path.iterdir())
    made, calls = Path.mkdir, []

    def made_too_late(folder, *arguments, **options):
        calls.append(folder)
        if len(calls) == 1:
            raise FileNotFoundError(folder)
        made(folder, *arguments, **options)

    monkeypatch.setattr(Path, "mkdir", made_too_late)
    assert SweepRecord.create(tmp_path, plan("c")).plan().runs == [{"pose": "0", "method": "c"}]


def test_runs_come_in_the_order_of_discovery(tmp_path):
    """A clock of another machine that is behind must not shift what has been told."""
    record = SweepRecord.create(tmp_path, plan("a", "b", "c"))
    record.add(2, seconds=1, row_folder=None)
    assert [run.number for run in record.ended()] == [2]
    record.add(0, seconds=1, row_folder=None)
    path = record.folder / "0.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"end": BEGIN.isoformat()}))
    assert [run.number for run in record.ended()] == [2, 0]


def test_a_complete_sweep_takes_unfinished_records_of_the_same_runs_along(tmp_path):
    killed, other, record, later = (
        SweepRecord.create(tmp_path, plan("a", second, begin=at(i))) for i, second in enumerate("bcbb")
    )
    names = [r.folder.name for r in (killed, other, record, later)]
    assert names == sorted(names) == [r.folder.name for r in records(tmp_path)]
    forget(record)
    assert [r.folder.name for r in records(tmp_path)] == [other.folder.name, later.folder.name]


def test_one_run_at_a_time_ends_after_the_means_of_what_is_left():
    sweep = plan("fast", "slow", poses=3)
    done = [ended(0, 1, 1), ended(1, 10, 9), ended(2, 13, 3)]
    # At work 13 of 13 s; left: slow, fast, slow.
    assert estimated_end(sweep, done, now=at(13)) == at(13 + 9 + 2 + 9)
    assert estimated_end(sweep, done, now=at(17)) == at(13 + 9 + 2 + 9)


def test_runs_side_by_side_share_the_work():
    sweep = plan("a", poses=8)
    done = [ended(i, 10, 10) for i in range(4)]
    assert estimated_end(sweep, done, now=at(10)) == at(20)


def test_waits_between_runs_count():
    """A queue that starts a run of 1 s every 10 s."""
    done = [ended(0, 10, 1), ended(1, 20, 1)]
    assert estimated_end(plan("a", poses=4), done, now=at(20)) == at(40)


def test_a_run_that_takes_longer_than_usual_moves_the_end():
    sweep = plan("a", poses=4)
    done = [ended(0, 10, 10)]
    assert estimated_end(sweep, done, now=at(15)) == at(40)
    # The second has been running for 90 s and may end now; two of 10 s are left.
    assert estimated_end(sweep, done, now=at(100)) == at(120)


def test_kept_rows_tell_how_long_their_kind_takes():
    sweep = plan("a", "b", poses=2)
    kept = ended(1, 0, 0.01, kept=True)  # b took 2 s, says its row
    assert estimated_end(sweep, [kept], now=at(0)) is None
    done = [kept, ended(0, 10, 10)]
    assert estimated_end(sweep, done, now=at(10)) == at(10 + 10 + 2)


def test_a_kind_not_met_yet_counts_as_the_mean_of_all():
    done = [ended(0, 4, 4), ended(1, 6, 2)]
    assert estimated_end(plan("a", "b", "c"), done, now=at(6)) == at(9)


def test_only_failures_before_a_row_tell_nothing():
    assert estimated_end(plan("a", "b"), [ended(0, 1, 1, row=None)], now=at(1)) is None


def test_an_end_is_told_in_seconds_then_as_a_time_of_day_then_with_its_day():
    local = BEGIN.astimezone()
    assert told_end(at(-5), BEGIN) == "end any moment"
    assert told_end(at(20.4), BEGIN) == "end in about 20 s"
    assert told_end(at(600), BEGIN) == f"end about {local + timedelta(seconds=600):%H:%M}"
    week = local + timedelta(days=7)
    assert told_end(week, BEGIN) == f"end about {week:%H:%M} on {week.day} {week:%B}"


def test_counts_and_lines():
    sweep = plan("a", poses=3)
    failed = {**ROW, "status": "failed", "reason": "ValueError: no", "seconds.total": None}
    runs = [
        ended(0, 10, 10),
        ended(1, 20, 10, row=failed, problems=["ValueError: no"]),
        ended(2, 20, 0, kept=True, problems=["metric.volume is 9, not in [0, 5]"]),
    ]
    assert told_counts(sweep, [], now=BEGIN) == "0 done, 0 failed, 3 remaining"
    assert told_counts(sweep, runs[:2], now=at(20)) == "2 done, 1 failed, 1 remaining, end in about 10 s"
    assert told_counts(sweep, runs, now=at(20)) == "3 done, 2 failed, 0 remaining"
    assert [told_run(run) for run in runs] == [
        "arap bumpy seed 3: ok, 2.00 s, 40 iterations",
        "arap bumpy seed 3: failed (ValueError: no)",
        "arap bumpy seed 3: ok, 2.00 s, 40 iterations, already there - metric.volume is 9, not in [0, 5]",
    ]
    assert told_run(ended(5, 1, 1, row=None, problems=["no"])) == "run 5: no"
    assert told_summary(sweep, runs) == "3 runs: 2 new (1 failed, 1 ok), 1 kept"
    assert told_summary(sweep, runs[:1]) == "3 runs: 1 new (1 ok), 0 kept, 2 not done"


def test_the_monitor_tells_of_runs_of_other_processes(tmp_path, capsys):
    record = SweepRecord.create(tmp_path, plan("a", "b"))
    monitor = Monitor(SweepRecord(record.folder), watch=True)
    monitor.start()
    record.add(1, seconds=1.0, row_folder=None, problems=["no"])
    told, end = "", monotonic() + 20
    while not told and monotonic() < end:
        sleep(0.05)
        told = capsys.readouterr().out
    assert told == "run 1: no [1 done, 1 failed, 1 remaining]\n"
    record.add(0, seconds=1.0, row_folder=None, problems=["no"])
    monitor.close()  # tells of the last one, and of none twice
    assert capsys.readouterr().out == "run 0: no [2 done, 2 failed, 0 remaining]\n"


def test_the_command_tells_of_sweeps_under_way(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert call("status", []) == 0
    assert capsys.readouterr().out == "no sweep is under way\n"
    folder = tmp_path / "out/runs/quick"
    record = SweepRecord.create(folder, plan("a", "b"))
    record.add(0, seconds=1.0, row_folder=None, problems=["no"])
    for arguments in ([], ["quick"], [str(folder)]):
        assert call("status", arguments) == 0
        out = capsys.readouterr().out
        assert out.startswith("quick: 1 done, 1 failed, 1 remaining (launcher basic, begun ")
        assert out.count("\n") == 1
    with pytest.raises(InputError, match="nothing_here"):
        call("status", ["nothing_here"])
    assert call("status", ["--forget"]) == 0
    assert records(folder) == []
