"""Runs of external programs: rows, versions, time limits, sweeps and times."""

import os
import signal
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from eval_cases import bumpy_task, run
from eval_program import run_eval
from external_programs import COPYING, TEXTS, ended, program, wait_for
from test_eval_interrupt import alive, start_eval

from eval.main import call
from eval.rows.collect import collect
from eval.rows.frame import read_csv
from eval.rows.store import read_vertices
from tests.full import few

pytestmark = pytest.mark.skipif(os.name != "posix", reason="the programs of these tests are for a shell")

SETTINGS = " ".join(f"method.{name}={value}" for name, value in TEXTS.items())


@pytest.fixture
def task():
    return bumpy_task(level=2)


@pytest.mark.parametrize("fresh", [False, True])
def test_a_row_of_a_program_holds_what_every_row_holds(task, tmp_path, fresh):
    count = 't=$(awk "BEGIN { for (i = 0; i < 3000000; i++) s += i; print s }")\n'
    method = program(tmp_path, count + COPYING)
    done = run(task, method, name="p", root=tmp_path / "runs", fresh=fresh)
    row = done.row
    assert row["status"] == "ok" and row["env.warmed_up"]
    np.testing.assert_allclose(read_vertices(done.folder, n=task.mesh.n), task.mesh.V, atol=1e-6)
    assert row["method.command"] == str(method["command"]) and row["method.mesh_format"] == "off"
    assert row["seconds.startup"] > 0 and 0 < row["seconds.program"] < row["seconds.total"]
    assert row["seconds.cpu"] > 0 and row["env.cores_used"] > 0  # CPU time of the program
    assert 0.1 < row["peak_mib"] < 50, "not of our own process, which is larger"
    assert row["metric.edge"] == pytest.approx(0, abs=1e-9) and "extra.peak_mib" not in row
    assert run(task, method, name="p", root=tmp_path / "runs", fresh=fresh).found


def test_the_time_limit_ends_a_program_and_its_children(task, tmp_path):
    pids = tmp_path / "pids"
    slow = f'[ "$EVAL_TIME_LIMIT" ] && {{ echo still at it >&2; sleep 99 & echo $! $$ > {pids}; wait; }}\n'
    method = program(tmp_path, slow + COPYING)
    row = run(task, method, name="p", root=tmp_path / "runs", time_limit=0.5).row
    reason = "no result within 0.5 s; its last line was: still at it"
    assert (row["status"], row["reason"]) == ("timeout", reason)
    wait_for(lambda: ended(pids))


def test_a_program_runs_on_its_case_and_on_the_mesh_of_its_startup_alone(task, tmp_path):
    seen = tmp_path / "seen"
    method = program(tmp_path, f'sed -n 2p "$1" >> {seen}\n' + COPYING)
    assert run(task, method, name="p", root=tmp_path / "runs").row["status"] == "ok"
    counts = {int(line.split()[0]) for line in seen.read_text().splitlines()}
    assert counts == {4, task.mesh.n}


def test_a_result_after_the_limit_is_a_timeout(task, tmp_path, monkeypatch):
    """A method may exceed its limit without noticing; its row must still be a timeout."""
    monkeypatch.setattr("eval.run.attempt.LAST_WORDS", 30.0)
    method = {"_target_": "eval_cases.sleeping", "seconds": 0.3, "warm_up": {"seconds": 0.0}}
    row = run(task, method, name="s", root=tmp_path, time_limit=0.2).row
    assert (row["status"], row["reason"]) == ("timeout", "no result within 0.2 s")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"command": ["nowhere-to-be-found"]}, "there is no program 'nowhere-to-be-found'"),
    ],
)
def test_files_that_are_missing_are_told(task, here, changes, words):
    row = run(task, program(here) | changes, name="p", root=here / "runs").row
    assert row["status"] == "failed" and row["reason"].startswith("InputError: ")


# The command line


def test_a_sweep_over_commands_goes_on_after_a_failure(here):
    program(here)
    program(here, "echo no >&2; exit 1", name="failing.sh")
    commands = "method.command=[sh,failing.sh],[sh,program.sh]"
    ended = run_eval(here, "-m", "dataset=bumpy", "dataset.level=2", "method=external", commands, "label=p",
                     "seed=0,1", *SETTINGS.split())  # fmt: skip
    assert ended.returncode == 1, ended.stderr
    assert "the program ended with exit code 1; its last line was: no" in ended.stdout
    assert " with a start-up of " in ended.stdout
    rows = collect(here / "out/runs/single")
    found = sorted(zip(rows["seed"], rows["status"], strict=True))
    assert found == [(0, "failed"), (0, "ok"), (1, "failed"), (1, "ok")]


@contextmanager
def sleeping(folder, fresh):
    """Yield a run whose program sleeps with a child process; then wait until both have ended."""
    program(folder, "sleep 99 & echo $! $$ > pids; wait")
    overrides = ["dataset=bumpy", "method=external", "method.command=[sh,program.sh]", f"run.fresh={fresh}"]
    pids = folder / "pids"
    with start_eval(folder, *overrides) as process:
        wait_for(lambda: pids.exists() and len(pids.read_text().split()) == 2)
        yield process
    wait_for(lambda: ended(pids))


@pytest.mark.parametrize("fresh", few(["false", "true"], "true"))
def test_ctrl_c_ends_the_program(tmp_path, fresh):
    with sleeping(tmp_path, fresh) as process:
        os.killpg(process.pid, signal.SIGINT)
        _, err = process.communicate(timeout=60)
        assert process.returncode == 130 and err.startswith("interrupted")


@pytest.mark.parametrize("fresh", few(["false", "true"], "true"))
def test_a_killed_command_takes_its_program_and_the_process_of_its_run_along(tmp_path, fresh):
    with sleeping(tmp_path, fresh) as process:
        process.kill()
        process.communicate(timeout=60)
        wait_for(lambda: not alive(process.pid))
    assert not list(tmp_path.rglob("row.json"))


def test_bench_times_a_program(here, monkeypatch, case):
    from eval.bench import turns

    monkeypatch.setattr(turns, "used_by_others", lambda *_: 0.0)
    program(here)
    method = "p=external 'command=[sh,program.sh]' " + SETTINGS.replace("method.", "")
    monkeypatch.setattr(turns, "SHORTEST", 1e-3)
    assert call("bench", ["speed", "--methods", method, "--cases", case, "--rounds", "2"]) == 0
    rows = read_csv("out/timing/speed.csv")
    assert len(rows) == 2 and (rows["seconds.startup"] > 0).all()
    assert "startup" in Path("out/tables/speed.md").read_text()
