"""Run builds and sweeps in separate processes: kill them at random moments, and run two at once."""

import importlib
import json
import multiprocessing
import os
import shutil
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from multiprocessing.context import ForkServerContext
from pathlib import Path
from time import perf_counter, sleep
from typing import Any

import numpy as np

from defaust.build.dataset import build
from defaust.build.verify import verify
from eval.rows.store import read_row, run_folders
from sshade.files.meshes import write_mesh
from tests.defaust.toy import OPTIONS, Balls
from tests.files import contents
from tests.shapes import bent, bumpy

#: Beginnings of the names of columns that record the time and place of a run, not its result.
VARYING = ("seconds.", "date", "env.")
#: Number of kills before a rerun goes to the end.
IN_A_ROW = 5

Result = dict[str, Any]


@dataclass(frozen=True)
class Scene:
    """A command that takes a while and makes the folder ``out``.

    Parameters
    ----------
    command : sequence of str
        Words of a command line of ``defaust`` or ``sshade-eval``.
    prepare : callable
        Writes the input into a folder.
    check : callable
        Raises AssertionError if ``out`` holds something half written.
    result : callable
        Returns the content of ``out`` that must equal the content from an undisturbed run.
    """

    command: Sequence[str]
    prepare: Callable[[Path], None]
    check: Callable[[Path], None]
    result: Callable[[Path], Result]


class Run:
    """A process that runs a scene's command, leads a process group, and writes its output to a file."""

    def __init__(self, scene: Scene, folder: Path, log: str = "log") -> None:
        self.out, self.log = folder / "out", folder / log
        self.process = _context().Process(target=_work, args=(scene.command, folder, self.log))
        self.process.start()

    def wait_for_work(self) -> None:
        """Wait until the output folder exists or the process has ended."""
        while not self.out.exists() and self.process.is_alive():
            sleep(0.001)

    def end(self) -> int | None:
        """Wait for the process and return its exit code."""
        self.process.join(600)
        assert self.process.exitcode is not None, "it does not end"
        return self.process.exitcode

    def kill(self, *, workers: bool) -> None:
        """Kill the process at once, alone or with the processes that it started."""
        if workers:
            with suppress(ProcessLookupError):  # a new process leads no group yet
                os.killpg(self.process.pid, signal.SIGKILL)
                return
        os.kill(self.process.pid, signal.SIGKILL)


def run_to_the_end(scene: Scene, folder: Path) -> tuple[Result, float]:
    """Run a scene; return its result and the seconds of its work, and remove its files."""
    run = Run(scene, folder)
    run.wait_for_work()
    begin = perf_counter()
    assert run.end() == 0, run.log.read_text()
    return taken(scene, folder), perf_counter() - begin


def taken(scene: Scene, folder: Path) -> Result:
    """Return the result of a run and remove its files."""
    result = scene.result(folder / "out")
    shutil.rmtree(folder / "out")
    return result


def kill_at_random(
    scene: Scene, folder: Path, *, kills: int, expected: Result, seconds: float, seed: int
) -> None:
    """Kill a scene `kills` times. Assert that its files are whole, and that a rerun gives `expected`.

    The first kill and every second kill after it also kill the workers of the process.
    """
    rng, done, since = np.random.default_rng(seed), 0, 0
    while done < kills:
        run = Run(scene, folder)
        run.wait_for_work()
        # A quarter of the kills come before or just after the work begins, when few files exist.
        sleep(float(rng.uniform(0, seconds) if rng.integers(4) else rng.uniform(0, 0.05)))
        if run.process.is_alive():
            run.kill(workers=done % 2 == 0)
            done, since = done + 1, since + 1
        code = run.end()
        scene.check(folder / "out")
        if since >= IN_A_ROW or done == kills or code == 0:
            result, _ = run_to_the_end(scene, folder)
            assert result == expected, "another result after kills"
            since = 0


def two_at_once(scene: Scene, folder: Path, *, expected: Result) -> list[int | None]:
    """Run a scene twice at once, assert that the result is `expected`, and return both exit codes."""
    runs = [Run(scene, folder, log) for log in ("one", "two")]
    codes = [run.end() for run in runs]
    for run, code in zip(runs, codes, strict=True):
        assert code == 0 or "builds there; wait until it is done" in run.log.read_text(), run.log.read_text()
    assert taken(scene, folder) == expected, "another result of two at once"
    return codes


@cache
def _context() -> ForkServerContext:
    """Return a context whose processes begin with all modules imported and without threads."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__, *MAINS.values(), "eval.run.attempt", "sshade.method.deform"])
    return context


MAINS = {"defaust": "defaust.cli", "sshade-eval": "eval.main"}


def _work(command: Sequence[str], folder: Path, log: Path) -> None:
    """Run a command line in the new process, and exit with its exit code."""
    os.setsid()
    os.chdir(folder)
    output = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(output, 1)
    os.dup2(output, 2)
    program, *sys.argv[1:] = command
    sys.exit(importlib.import_module(MAINS[program]).main())


def _shapes(folder: Path) -> None:
    """Write four classes of three meshes each."""
    body = bumpy(3)
    (folder / "meshes").mkdir()
    for number, name in enumerate(("ant", "bee", "cow", "dog")):
        for k in range(3):
            write_mesh(folder / f"meshes/{name}{k}.ply", bent(body.V * (1 + 0.1 * number), 0.1 * k), body.F)


def _check_build(out: Path) -> None:
    """Check that every subject is complete, and that a dataset with a record has no faults."""
    for subject in out.glob("subject_*"):
        assert len(list(subject.iterdir())) == 6, f"{subject} is not complete"
    if (out / "dataset.json").is_file():
        assert verify(out) == []


def _balls(folder: Path) -> None:
    build(Balls(subjects=(0,)), folder / "balls", options=OPTIONS, workers=1)


def _check_rows(out: Path) -> None:
    """Check that every folder with a row has the files that the row names."""
    for folder in run_folders(out):
        row = read_row(folder)
        assert row["status"] in ("ok", "not_converged") and (folder / "vertices.npy").is_file(), folder


def _rows(out: Path) -> Result:
    """Return the row of each run without the varying columns, its vertices, and the names of its files.

    The names would reveal a half-written file.
    """
    found: Result = {}
    for folder in run_folders(out):
        row = {name: value for name, value in read_row(folder).items() if not name.startswith(VARYING)}
        names = sorted(path.name for path in folder.iterdir())
        found[folder.name] = json.dumps(row, sort_keys=True), (folder / "vertices.npy").read_bytes(), names
    return found


BUILD = ["defaust", "build", "source=tosca", "source.root=meshes", "out=out", "source.landmarks=4"]
BUILD += ["handles_per_landmark=10", "neighbourhood=20"]
SWEEP = ["sshade-eval", "run", "-m", "dataset=defaust", "dataset.root=balls", "subject=0", "pose=1,2"]
SWEEP += ["method=identity,fast", "proxy.vertices=60", "solver.max_iterations=30"]
SWEEP += ["run.folder=out", "paths.runs=."]

SCENES = {
    "build": Scene([*BUILD, "workers=1"], _shapes, _check_build, contents),
    "build of two": Scene([*BUILD, "workers=2"], _shapes, _check_build, contents),
    "sweep": Scene(SWEEP, _balls, _check_rows, _rows),
}
