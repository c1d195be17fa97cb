"""Rows of a sweep: launchers, programs, time limits, and interrupts, which end a sweep in order."""

import os
import signal
import subprocess
import sys
from contextlib import contextmanager, suppress
from time import sleep

import numpy as np
import pytest
from eval_cases import bumpy_task, run
from eval_program import ENVIRONMENT, RUN, run_eval
from external_programs import COPYING, ended, program, wait_for

from eval.rows.store import require_vertices

INTERRUPTED = "interrupted; the same command goes on from there"


@contextmanager
def start_eval(folder, *arguments, **streams):
    """Start the program as the leader of a new process group; kill the group at the end.

    The program reacts to Ctrl-C even if the tests ignore it, for example in the background of a shell.
    """
    environment = {**ENVIRONMENT, "TERM": "xterm", "COLUMNS": "120", "TMPDIR": str(folder)}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **streams}
    process = subprocess.Popen(
        [*RUN, *arguments],
        cwd=folder,
        env=environment,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        **pipes,
    )
    try:
        yield process
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        for pipe in (process.stdout, process.stderr):
            if pipe is not None:
                pipe.close()


def alive(group):
    """Return whether any process of a group exists."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize(
    ("name", "code"), [("SIGINT", 130), pytest.param("SIGTERM", 143, marks=pytest.mark.full)]
)
@pytest.mark.usefixtures("in_process")
def test_an_interrupt_or_the_end_leaves_complete_rows_and_the_same_command_goes_on(tmp_path, name, code):
    sweep = ["-m", "dataset=bumpy", "dataset.level=2"]
    assert run_eval(tmp_path, *sweep, "method=stretching").returncode == 0
    with start_eval(tmp_path, *sweep, "method=stretching,endless") as process:
        line = process.stdout.readline()
        assert line.startswith("[1/2] stretching on bumpy_30: not_converged, ") and "already there" in line
        sleep(1.0)  # the endless run has then begun
        os.killpg(process.pid, signal.Signals[name])  # a terminal, too, signals every process
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (code, "", f"{INTERRUPTED}\n")
    wait_for(lambda: not alive(process.pid))
    assert len(list(tmp_path.rglob("row.json"))) == 1 and not list(tmp_path.rglob("*.partial*"))


pytestmark = pytest.mark.skipif(os.name != "posix", reason="the programs of these tests are for a shell")


@pytest.fixture
def task():
    return bumpy_task(level=2)


def test_a_row_of_a_program_holds_what_every_row_holds(task, tmp_path):
    """The memory is that of a process of the program, and not that of our own process, which is larger."""
    busy = f"{sys.executable} -c 'import time; x = bytearray(80 << 20); del x; time.sleep(0.5)'; true"
    method = program(tmp_path, f'sh -c "{busy}; true"\n{COPYING}')
    done = run(task, method, name="p", root=tmp_path / "runs", fresh=True)
    row = done.row
    assert row["status"] == "ok"
    np.testing.assert_allclose(require_vertices(done.folder, n=task.mesh.n), task.mesh.V, atol=1e-6)
    assert row["method.command"] == str(method["command"]) and row["method.mesh_format"] == "off"
    assert 0 < row["seconds.program"] < row["seconds.total"]
    assert row["seconds.cpu"] > 0 and row["env.cores_used"] > 0  # CPU time of the program
    assert 80 < row["peak_mib"] < 110


def test_a_program_in_python_may_import_a_file_beside_it(task, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONSAFEPATH", "1")  # for workers of launchers
    method = program(tmp_path, '[ "$PYTHONSAFEPATH" ] && exit 3\n' + COPYING)
    assert run(task, method, name="p", root=tmp_path / "runs").row["status"] == "ok"


def test_the_time_limit_ends_a_program_and_its_children(task, tmp_path):
    pids = tmp_path / "pids"
    slow = f'[ "$EVAL_TIME_LIMIT" ] && {{ echo still at it >&2; sleep 99 & echo $! $$ > {pids}; wait; }}\n'
    method = program(tmp_path, slow + COPYING)
    row = run(task, method, name="p", root=tmp_path / "runs", time_limit=0.5).row
    reason = "no result within 0.5 s; its last line was: still at it"
    assert (row["status"], row["reason"]) == ("timeout", reason)
    wait_for(lambda: ended(pids))


def test_a_result_after_the_limit_is_a_timeout(task, tmp_path, monkeypatch):
    """A method may exceed its limit without noticing; its row must still be a timeout."""
    monkeypatch.setattr("eval.run.fresh.LAST_WORDS", 30.0)
    method = {"_target_": "eval_cases.sleeping", "seconds": 0.3, "warm_up": {"seconds": 0.0}}
    row = run(task, method, name="s", root=tmp_path, time_limit=0.2).row
    assert (row["status"], row["reason"]) == ("timeout", "no result within 0.2 s")


def test_a_kill_ends_the_program_and_the_process_of_its_run(tmp_path):
    program(tmp_path, "sleep 99 & echo $! $$ > pids; wait")
    pids, run_of = tmp_path / "pids", ["dataset=bumpy", "method=external", "method.command=[sh,program.sh]"]
    with start_eval(tmp_path, *run_of, "run.fresh=true") as process:
        wait_for(lambda: pids.exists() and len(pids.read_text().split()) == 2)
        process.kill()
        process.communicate(timeout=60)
        wait_for(lambda: ended(pids) and not alive(process.pid))
    assert not list(tmp_path.rglob("row.json"))
