"""Cases: running methods, and everything made from rows."""

import json
import pickle
import shutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import chdir
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from tests.files import contents, scratch
from tests.robustness.case import Case, check_refusal, limited, on_a_full_disk, run
from tests.robustness.datasets import RUN, dataset
from tests.robustness.inputs import Given, both, cut, data, text

RUNS = "out/runs"
CASES_OF_TWO = "dataset=defaust dataset.root=balls subject=0 pose=1,2"
SWEEP = f"sshade-eval run -m {CASES_OF_TWO} method=identity run.experiment=tiny"


@cache
def _done() -> Path:
    """A working folder with a dataset, two runs and their rows."""
    place = scratch() / "runs of cases"
    place.mkdir()
    with chdir(place):
        dataset()
        assert run(SWEEP)[0] == 0
        assert run("sshade-eval collect tiny")[0] == 0
    return place


def runs() -> None:
    """Two runs, their dataset and their rows."""
    shutil.copytree(_done(), ".", dirs_exist_ok=True)


def _in_run(name: str, damage: Callable[[str], Given]) -> Given:
    """The two runs, with a damaged file in the first run."""
    return both(runs, lambda: damage(str(min(Path(RUNS).rglob(name))))())


def _row(name: str, value: Any) -> Given:
    """The two runs, with an entry of the first run's row replaced; the value None removes the entry."""

    def damage(path: str) -> Given:
        row = json.loads(Path(path).read_text()) | {name: value}
        return text(path, json.dumps({n: v for n, v in row.items() if n != name or v is not None}))

    return _in_run("row.json", damage)


def _vertices(damage: Callable[[str], Given]) -> Given:
    return _in_run("vertices.npy", damage)


OPTIONS = {
    "tables tiny -o body.ply": ("body.ply: the folder cannot be created",),
    "tables tiny -o out/rows": ("holds the rows",),
}
#: Refused by `figures`, which reads the files and the source that a row names.
NAMED = {
    "cut vertices": (_vertices(lambda p: cut(p, 0.5)), "vertices.npy: not the file of a run"),
    "vertices that are a pickle": (_vertices(lambda p: data(p, pickle.dumps([1]))), "not the file of a run"),
    "vertices of another mesh": (_vertices(lambda p: lambda: np.save(p, np.zeros((5, 3)))), "5"),
    "a dataset that is gone": (both(runs, lambda: shutil.rmtree("balls")), "balls"),
    "a row that names another function": (_row("task.source", '{"_target_": "os.getcwd"}'), "and no task"),
}

METHODS = {
    "method=arap method.start=middle": ("start must be rest or rigid, not 'middle'",),
    "run.speed=1": ("no setting run.speed",),
    "seed=-1": ("seed=-1",),
    "run.split=half": ("it takes tuning, held_out, both or null",),
    "run.jobs=0": ("run.jobs=0",),
    "run.experiment=../tiny": ("run.experiment=../tiny is no name of a folder",),
    "method._target_=magic.magic": ("no module 'magic'",),
    "dataset._target_=os.getcwd": ("os.getcwd has no parameter",),
    "method=magic": ("there is no method 'magic'; choose one of acc",),
    "method=arap +method.colour=red": ("has no option 'colour'",),
    "method=arap method.max_iterations=many": ("max_iterations must be a whole number", "'many'"),
    "label=": ("label is empty",),
    "label=mine/a": ("label=mine/a has a '/'",),
    "~seed": ("~seed deletes a setting that every run needs",),
    "method._target_=baselines.arap.magic": ("no function 'magic'",),
    "'proxy.vertices=[1'": ("proxy.vertices=[1 is not understood; close its brackets",),
    "arap": ("arap is not understood; write settings as key=value",),
    "method._target_=magic": ("_target_ 'magic' is no function; write package.module.function",),
    "method=external method.command=sh": ("command='sh' does not fit; it takes list[str]",),
    "dataset._target_=builtins.dict": ("dict does not tell its parameters",),
    "dataset=moon": ("there is no dataset 'moon'",),
    "paths.runs=body.ply/x": ("body.ply/x",),
}


def _full_disk() -> None:
    """Earlier rows stay, no part of the new row is written, and a rerun completes the new row."""
    before = contents()
    with limited(3000):
        check_refusal(run(f"{RUN} run.experiment=tiny subject=1"), "cannot be written", "disk may be full")
    assert contents() == before
    code, out, err = run(f"{RUN} run.experiment=tiny subject=1")
    assert code == 0 and len(contents().keys() - before.keys()) == 2, (code, err)


PRINTING = [sys.executable, "-m", "sshade", "--help"]


def _to_a_full_device() -> None:
    """Print to a device that is always full, like a log on a full disk."""
    with open("/dev/full", "w") as full:
        done = subprocess.run(PRINTING, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60)
    assert done.returncode == 2 and done.stderr == "error: No space left on device\n", done


def _to_nobody() -> None:
    """Print to a pipe whose reader closes it at once, as ``| head -0`` does."""
    with subprocess.Popen(PRINTING, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        process.stdout.close()
        assert process.stderr.read() == "" and process.wait(60) == 141


CASES = [
    *(Case(call, f"sshade-eval {call}", runs, says=says) for call, says in OPTIONS.items()),
    *(
        Case(f"figures: {name}", "sshade-eval figures tiny", given, says=(word,), leaves=(RUNS,))
        for name, (given, word) in NAMED.items()
    ),
    *(Case(f"run: {change}", f"{RUN} {change}", dataset, says=says) for change, says in METHODS.items()),
    Case("full disk: a run", _full_disk, runs, leaves=("out",)),
    Case("full disk: what is printed", _to_a_full_device),
    Case("nobody reads what is printed", _to_nobody),
    on_a_full_disk("sshade-eval collect tiny -o rows", runs),
    on_a_full_disk("sshade-eval tables tiny -o t", runs),
    Case("run: what is there already", SWEEP, runs, leaves=(f"{RUNS}/tiny/multirun.yaml",)),
]
