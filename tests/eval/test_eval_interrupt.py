"""Ctrl-C and SIGTERM end a sweep in order."""

import os
import signal
import subprocess
from contextlib import contextmanager, suppress
from time import sleep

import pytest
from eval_program import ENVIRONMENT, RUN, run_eval
from external_programs import wait_for

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
