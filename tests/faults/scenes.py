"""What is disturbed: a dataset build and a sweep, and what of their results must be equal."""

from __future__ import annotations

import importlib
import json
import multiprocessing
import os
import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from multiprocessing.context import ForkServerContext
from multiprocessing.process import BaseProcess
from pathlib import Path
from time import perf_counter, sleep
from typing import Any, NamedTuple

from defaust.build.dataset import build
from defaust.folder.verify import verify
from eval.rows.store import read_row, run_folders
from sshade.io.meshes import write_mesh
from tests.defaust.toy import OPTIONS, Balls
from tests.shapes import bent, bumpy

ROOT = Path(__file__).parents[2]
#: Columns that tell of the time and the place of a run, not of its result.
VARYING = ("seconds.", "date", "env.")

Result = dict[str, Any]


@dataclass(frozen=True)
class Scene:
    """Something that takes a while and leaves files.

    Parameters
    ----------
    name : str
    command : sequence of str
        Of ``defaust`` or ``eval``, run in the scene's folder.
    prepare : callable
        Writes the input into a folder.
    out : str
        What the command makes, inside the folder; once it is there, the work has begun.
    check : callable
        AssertionError where something of what is there is half written.
    result : callable
        What must be equal to an undisturbed run's.
    """

    name: str
    command: Sequence[str]
    prepare: Callable[[Path], None]
    out: str
    check: Callable[[Path], None]
    result: Callable[[Path], Result]

    def start(self, folder: Path, log: str = "log") -> Run:
        """Start the command in a process of its own, that leads a group, with its output in a file."""
        log = folder / log
        process = _context().Process(target=_work, args=(self.command, folder, log))
        process.start()
        return Run(process, log)

    def run(self, folder: Path) -> float:
        """Run the command to its end; seconds of its work."""
        run = self.start(folder)
        while not (folder / self.out).exists() and run.process.is_alive():
            sleep(0.001)
        begin = perf_counter()
        run.end()
        assert run.process.exitcode == 0, f"{self.name}: exit code {run.process.exitcode}: {run.output}"
        return perf_counter() - begin


class Run(NamedTuple):
    """A started command, and the file that it writes its output to."""

    process: BaseProcess
    log: Path

    def end(self) -> None:
        """Wait for it."""
        self.process.join(600)
        assert self.process.exitcode is not None, "it does not end"

    @property
    def output(self) -> str:
        """What it printed."""
        return self.log.read_text()


@cache
def _context() -> ForkServerContext:
    """Processes that begin with everything imported, and without threads."""
    os.environ["PYTHONPATH"] = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(
        [
            "tests.faults.scenes",
            "eval.configure.app",
            "eval.run.attempt",
            "defaust.cli",
            "sshade.pipeline.fine",
        ]
    )
    return context


def _work(command: Sequence[str], folder: Path, log: Path) -> None:
    """The process: a command line, and its exit code."""
    os.setsid()
    os.chdir(folder)
    output = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(output, 1)
    os.dup2(output, 2)
    program, *sys.argv[1:] = command
    modules = {"sshade": "sshade.cli.main", "defaust": "defaust.cli", "sshade-eval": "eval.main"}
    main = importlib.import_module(modules[program]).main
    sys.exit(main())


def files(folder: Path) -> dict[str, bytes]:
    """Every file below a folder."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def _shapes(folder: Path) -> None:
    """Four classes of three meshes."""
    body = bumpy(3)
    (folder / "meshes").mkdir()
    for number, name in enumerate(("ant", "bee", "cow", "dog")):
        for k in range(3):
            write_mesh(folder / f"meshes/{name}{k}.ply", bent(body.V * (1 + 0.1 * number), 0.1 * k), body.F)


def _check_build(out: Path) -> None:
    """Subjects appear whole, and the record last."""
    for subject in out.glob("subject_*"):
        assert len(list(subject.iterdir())) == 6, f"{subject} is not complete"
    if (out / "dataset.json").is_file():
        assert verify(out) == []


def _dataset(folder: Path) -> None:
    build(Balls(subjects=(0, 1)), folder / "balls", options=OPTIONS, workers=1)


def _check_rows(out: Path) -> None:
    """A folder with a row has what the row says."""
    for folder in run_folders(out):
        row = read_row(folder)
        assert row["status"] in ("ok", "not_converged") and (folder / "vertices.npy").is_file(), folder


def _rows(out: Path) -> Result:
    """Each run's row without what varies, and its vertices; nothing half written beside them."""
    found: Result = {}
    for folder in run_folders(out):
        row = {name: value for name, value in read_row(folder).items() if not name.startswith(VARYING)}
        names = sorted(path.name for path in folder.iterdir())
        found[folder.name] = json.dumps(row, sort_keys=True), (folder / "vertices.npy").read_bytes(), names
    return found


BUILD = ["defaust", "build", "source=tosca", "source.root=meshes", "out=out", "source.landmarks=4"]
BUILD += ["handles_per_landmark=10", "neighbourhood=20"]
SWEEP = ["sshade-eval", "run", "-m", "dataset=defaust", "dataset.root=balls", "subject=0,1", "pose=1,2"]
SWEEP += ["method=identity,sshade,sshade_fast", "proxy.vertices=60", "solver.max_iterations=30"]
SWEEP += ["run.folder=out", "paths.runs=."]

SCENES = {
    "build": Scene("build", [*BUILD, "workers=1"], _shapes, "out", _check_build, files),
    "build of two": Scene("build of two", [*BUILD, "workers=2"], _shapes, "out", _check_build, files),
    "sweep": Scene("sweep", SWEEP, _dataset, "out", _check_rows, _rows),
}


def clear(scene: Scene, folder: Path) -> None:
    """Remove what a scene made."""
    shutil.rmtree(folder / scene.out, ignore_errors=True)
