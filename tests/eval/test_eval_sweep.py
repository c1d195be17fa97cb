"""The record of a sweep: its files, its counts, and the command `status`."""

import json
import subprocess
import sys
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from time import monotonic, sleep

import pytest
from eval_cases import bumpy_task

from eval.main import call
from eval.rows.plan import read_plans, write_plan
from eval.run.monitor import Monitor
from eval.run.record import RECORDED, Sweep, SweepRecord, records, unfinished
from eval.run.run import run
from sshade.core.errors import InputError

BEGIN = datetime(2026, 5, 1, 12, tzinfo=UTC)


def sweep(*methods, begin=BEGIN):
    return Sweep(begin, [{"pose": "0", "method": method} for method in methods])


def test_the_record_gives_back_what_was_put_in(tmp_path):
    experiment = tmp_path / "quick"
    record = SweepRecord.create(experiment, sweep("arap", "paper"))
    assert record.sweep().runs == [{"pose": "0", "method": "arap"}, {"pose": "0", "method": "paper"}]
    assert record.sweep().begin == BEGIN and record.sweep().host
    assert record.ended() == []
    done = run(bumpy_task(level=2), {"_target_": "eval_cases.stretching"}, name="s", root=experiment)
    told = {name: done.row.get(name) for name in RECORDED}
    record.add(1, row=done.row, found="already there")
    record.add(0, row=None, problems=["seed=-1 is no seed"])
    for reader in (record, *records(experiment)):
        first, second = reader.ended()
        assert (first.number, first.row, first.found) == (1, told, "already there")
        assert (second.number, second.row, second.problems) == (0, None, ["seed=-1 is no seed"])
    record.remove()
    record.add(0, row=None)  # a worker may outlive its sweep
    assert records(experiment) == []


def test_a_killed_sweep_is_told_from_one_that_may_be_under_way(tmp_path, capsys):
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    facts = {"a": {}, "b": {}, "c": {"host": "elsewhere"}, "d": {"launcher": "slurm"}}
    made = [
        SweepRecord.create(tmp_path, replace(sweep(name, begin=BEGIN + timedelta(seconds=i)), **facts[name]))
        for i, name in enumerate(facts)
    ]
    records_of = [made[0], *(_of_process(record, dead.pid) for record in made[1:])]
    assert [record.given_up() for record in records_of] == [False, True, False, False]
    assert sorted(one.runs[0]["method"] for one in unfinished(tmp_path)) == ["a", "c", "d"]
    assert call("status", [str(tmp_path)]) == 0
    assert capsys.readouterr().out.count("its process is gone") == 1


def _of_process(record, pid):
    """Return the record under the name that the process `pid` would have given it."""
    begun, _, _ = record.folder.name.rpartition("_")
    return SweepRecord(record.folder.rename(record.folder.with_name(f"{begun}_{pid}")))


def test_runs_come_in_the_order_of_discovery(tmp_path):
    """A slow clock on another machine must not change the order of runs that are already reported."""
    record = SweepRecord.create(tmp_path, sweep("a", "b", "c"))
    record.add(2, row=None)
    assert [run.number for run in record.ended()] == [2]
    record.add(0, row=None)
    path = record.folder / "0.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"end": BEGIN.isoformat()}))
    assert [run.number for run in record.ended()] == [2, 0]


MOST_PROCESSES = 2**22  # of Linux; no process has a larger number


def test_a_complete_sweep_takes_unfinished_records_of_the_same_runs_along(tmp_path):
    begins = [BEGIN + timedelta(seconds=i) for i in range(4)]
    killed, other, record, later = (
        SweepRecord.create(tmp_path, sweep("a", second, begin=begin))
        for begin, second in zip(begins, "bcbb", strict=True)
    )
    names = [r.folder.name for r in (killed, other, record, later)]
    assert names == sorted(names) == [r.folder.name for r in records(tmp_path)]
    record.complete()  # the first sweep goes on: its process, this one, exists
    assert [r.folder.name for r in records(tmp_path)] == [names[0], names[1], names[3]]
    _of_process(killed, MOST_PROCESSES + 1)
    later.complete()
    assert [r.folder.name for r in records(tmp_path)] == [other.folder.name]


def test_the_monitor_tells_of_runs_of_other_processes(tmp_path, capsys):
    record = SweepRecord.create(tmp_path, sweep("a", "b"))
    monitor = Monitor(SweepRecord(record.folder), watch=True)
    record.add(1, row=None, problems=["no"])
    told, end = "", monotonic() + 20
    while not told and monotonic() < end:
        sleep(0.05)
        told = capsys.readouterr().out
    assert told == "run 1: no [1 done, 1 failed, 1 remaining]\n"
    record.add(0, row=None, problems=["no"])
    monitor.close()  # reports the last run, and no run twice
    assert capsys.readouterr().out == "run 0: no [2 done, 2 failed, 0 remaining]\n"


def test_the_command_tells_of_sweeps_under_way(here, capsys):
    assert call("status", []) == 0
    assert capsys.readouterr().out == "no sweep is under way\n"
    folder = here / "out/runs/quick"
    record = SweepRecord.create(folder, sweep("a", "b"))
    record.add(0, row=None, problems=["no"])
    for arguments in ([], ["quick"], [str(folder)]):
        assert call("status", arguments) == 0
        out = capsys.readouterr().out
        assert out.startswith("quick: 1 done, 1 failed, 1 remaining (launcher basic, begun ")
        assert out.count("\n") == 1
    with pytest.raises(InputError, match="nothing_here"):
        call("status", ["nothing_here"])
    write_plan(folder, [{"method.name": "a", "seed": 0, "task.source": "{}"}])
    assert len(read_plans(folder)) == 1
    assert call("status", ["--forget"]) == 0
    assert records(folder) == [] and read_plans(folder) == []
