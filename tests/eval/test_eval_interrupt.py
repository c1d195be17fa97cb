"""Ctrl-C and the display in a terminal, tested with signals and a pseudo-terminal."""

import os
import pty
import signal
import subprocess
from contextlib import contextmanager, suppress
from time import sleep

import pytest
from eval_program import ENVIRONMENT, RUN
from external_programs import wait_for

from eval.rows.collect import gather
from eval.rows.frame import records
from tests.full import few

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


@pytest.mark.parametrize("fresh", few(["false", "true"], "true"))
def test_ctrl_c_leaves_complete_rows_and_the_same_command_goes_on(tmp_path, fresh):
    overrides = ["-m", "dataset=bumpy", "dataset.level=2", "method=stretching,endless", f"run.fresh={fresh}"]
    for new, kept in ((1, 0), (0, 1)):
        with start_eval(tmp_path, *overrides) as process:
            assert "[1 done, 0 failed, 1 remaining]" in process.stdout.readline()
            sleep(1.0)  # the endless run has then begun
            os.killpg(process.pid, signal.SIGINT)  # a terminal, too, signals every process
            out, err = process.communicate(timeout=60)
        assert process.returncode == 130
        counts = f"{new} new{' (1 not_converged)' * new}, {kept} kept"
        assert (out, err) == (f"2 runs: {counts}, 1 not done; in out/runs/single\n", f"{INTERRUPTED}\n")
        wait_for(lambda group=process.pid: not alive(group))
        assert len(list(tmp_path.rglob("row.json"))) == 1
        assert not list(tmp_path.rglob("sweep.json")) and not list(tmp_path.rglob("*.partial*"))
    rows = records(gather("none", [tmp_path / "out/runs/single"]))
    assert [(row["method.name"], row["task.name"], row["status"]) for row in rows] == [
        ("stretching", "bumpy_30", "not_converged"),
        ("endless", "bumpy_30", "missing"),
    ]


def test_a_killed_sweep_says_so_and_is_listed_once_until_it_is_done(tmp_path):
    overrides = ["-m", "dataset=bumpy", "dataset.level=2", "method=stretching,endless"]
    for _ in range(2):
        with start_eval(tmp_path, *overrides) as process:
            assert "[1 done, 0 failed, 1 remaining]" in process.stdout.readline()
            sleep(1.0)  # the endless run has then begun
            process.terminate()
            _, err = process.communicate(timeout=60)
        assert process.returncode == 143 and "ended by a signal; the same command goes on from there" in err
    done = subprocess.run([*RUN[:3], "status"], cwd=tmp_path, env=ENVIRONMENT, capture_output=True, text=True)
    assert done.stdout.count("single: 1 done, 0 failed, 1 remaining") == 1 and "run.fresh=true" in done.stdout


def test_a_terminal_shows_bars_and_a_file_the_lines(tmp_path):
    ours, theirs = pty.openpty()
    overrides = ["-m", "dataset=bumpy", "dataset.level=2", "method=arap", "seed=0,1", "run.fresh=true"]
    with start_eval(tmp_path, *overrides, stderr=theirs) as process:
        os.close(theirs)
        shown = b""
        while chunk := _read(ours):
            shown += chunk
        out = process.stdout.read()
    os.close(ours)
    assert process.returncode == 0
    for text in ("sweep", "reading", "warm-up", "iterations", "residual", "0 failed, 1 remaining", "2/2"):
        assert text in shown.decode(), text
    lines = out.splitlines()
    assert len(lines) == 3 and lines[2].startswith("2 runs: 2 new")
    assert all(line.startswith("arap bumpy_30 seed ") and "done" not in line for line in lines[:2])


def _read(terminal):
    try:
        return os.read(terminal, 65536)
    except OSError:  # the program has closed its side of the terminal
        return b""
