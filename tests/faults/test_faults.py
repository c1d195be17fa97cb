"""Builds and sweeps are killed at random moments and run twice at once."""

import importlib
import json
import multiprocessing
import os
import shutil
import signal
import sys
from contextlib import suppress
from multiprocessing.process import BaseProcess
from pathlib import Path
from time import perf_counter, sleep
from typing import Any

import numpy as np
import pytest

from defaust.build.dataset import build
from defaust.build.verify import verify
from sshade.files.meshes import write_mesh
from tests.defaust.toy import OPTIONS, Balls
from tests.files import contents
from tests.shapes import bent, bumpy

BUILD = ["defaust", "build", "source=tosca", "source.root=meshes", "out=out", "source.landmarks=4"]
BUILD += ["handles_per_landmark=10", "neighbourhood=20"]
SWEEP = ["sshade-eval", "run", "-m", "dataset=defaust", "dataset.root=balls", "subject=0", "pose=1,2"]
SWEEP += ["method=identity,fast", "proxy.vertices=60", "solver.max_iterations=30"]
SWEEP += ["run.folder=out", "paths.runs=."]
#: Commands that take a while and make the folder `out`.
COMMANDS = {"build": [*BUILD, "workers=1"], "build of two": [*BUILD, "workers=2"], "sweep": SWEEP}
MAINS = {"defaust": "defaust.cli", "sshade-eval": "eval.main"}
#: Beginnings of the names of columns that record the time and place of a run, not its result.
VARYING = ("seconds.", "date", "env.")
MANY = [pytest.param(name, 12, seed, marks=pytest.mark.full) for name in COMMANDS for seed in (1, 2, 3)]

#: Its processes begin with all modules imported and without threads.
CONTEXT = multiprocessing.get_context("forkserver")
CONTEXT.set_forkserver_preload([__name__, *MAINS.values(), "eval.run.attempt", "sshade.method.deform"])


def work(command: list[str], folder: Path) -> None:
    """Run a command line in a new process, which leads a process group; exit with its exit code."""
    os.setsid()
    os.chdir(folder)
    log = os.open("log", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    os.dup2(log, 1)
    os.dup2(log, 2)
    program, *sys.argv[1:] = command
    sys.exit(importlib.import_module(MAINS[program]).main())


def start(name: str, folder: Path) -> BaseProcess:
    """Start a command; return its process when the folder `out` exists or the process has ended."""
    process = CONTEXT.Process(target=work, args=(COMMANDS[name], folder))
    process.start()
    while not (folder / "out").exists() and process.is_alive():
        sleep(0.001)
    return process


def end(process: BaseProcess) -> int | None:
    process.join(600)
    assert process.exitcode is not None, "it does not end"
    return process.exitcode


def assert_whole(out: Path) -> None:
    """Assert that every subject has all its files, and every row its vertices."""
    assert all(len(list(subject.iterdir())) == 6 for subject in out.glob("subject_*"))
    for row in out.rglob("row.json"):
        assert json.loads(row.read_text())["status"] in ("ok", "not_converged")
        assert (row.parent / "vertices.npy").is_file()


def taken(out: Path) -> dict[str, Any]:
    """Return the content of all files, rows without varying columns; remove the folder."""
    if (out / "dataset.json").is_file():
        assert verify(out) == []
    found: dict[str, Any] = contents(out)
    for name in (name for name in found if name.endswith("row.json")):
        row = json.loads(found[name])
        found[name] = {column: value for column, value in row.items() if not column.startswith(VARYING)}
    shutil.rmtree(out)
    return found


def prepare(folder: Path) -> None:
    """Write four classes of three meshes each for a build, and a dataset for a sweep."""
    body = bumpy(3)
    (folder / "meshes").mkdir()
    for number, name in enumerate(("ant", "bee", "cow", "dog")):
        for k in range(3):
            write_mesh(folder / f"meshes/{name}{k}.ply", bent(body.V * (1 + 0.1 * number), 0.1 * k), body.F)
    build(Balls(subjects=(0,)), folder / "balls", options=OPTIONS, workers=1)


@pytest.mark.parametrize(("name", "kills", "seed"), [("build", 2, 0), ("sweep", 1, 0), *MANY])
def test_after_kills_a_rerun_gives_what_an_undisturbed_run_gives(name, kills, seed, tmp_path):
    prepare(tmp_path)
    out, log, rng = tmp_path / "out", tmp_path / "log", np.random.default_rng(seed)
    process, begin = start(name, tmp_path), perf_counter()
    assert end(process) == 0, log.read_text()
    seconds, expected = perf_counter() - begin, taken(out)
    assert expected, "it left nothing"
    for number in range(kills):
        process = start(name, tmp_path)
        # A quarter of the kills come before or just after the work begins, when few files exist.
        sleep(float(rng.uniform(0, seconds) if rng.integers(4) else rng.uniform(0, 0.05)))
        with suppress(ProcessLookupError):  # every second kill leaves the workers of the process alive
            (os.killpg if number % 2 == 0 else os.kill)(process.pid, signal.SIGKILL)
        end(process)
        assert_whole(out)
    assert end(start(name, tmp_path)) == 0, log.read_text()
    assert taken(out) == expected
    both = [start(name, tmp_path) for _ in range(2)]
    codes = sorted(end(process) for process in both)
    assert codes == [0, 0] or (name != "sweep" and codes == [0, 2]), log.read_text()
    assert taken(out) == expected
