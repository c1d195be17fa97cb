"""Cases: running methods, and everything made of rows."""

from __future__ import annotations

import atexit
import csv
import json
import pickle
import shutil
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from tests.robustness.case import Case, check_refusal, contents, limited, nothing, refused, run, working_in
from tests.robustness.datasets import RUN, dataset
from tests.robustness.inputs import Given, both, cut, data, garbage, text

RUNS, ROWS = "out/runs", "out/rows/tiny.csv"
CASES_OF_TWO = "dataset=defaust dataset.root=balls subject=0 pose=1,2"
SWEEP = f"sshade-eval run -m {CASES_OF_TWO} method=identity run.experiment=tiny"
OF_ROWS = ("tables", "charts", "report", "check", "curves")
OF_RUNS = ("collect", "figures", "remeasure")


@cache
def _done() -> Path:
    """A working folder with a dataset, two runs and their rows."""
    place = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    with working_in(place):
        dataset()
        assert run(SWEEP)[0] == 0
        for path in Path(RUNS).rglob("row.json"):  # as if the metrics had been written anew since
            row = json.loads(path.read_text()) | {"env.version.metrics": "older"}
            path.write_text(json.dumps(row))
        assert run("sshade-eval collect tiny")[0] == 0
    return place


def runs() -> None:
    """Two runs, their dataset and their rows."""
    shutil.copytree(_done(), ".", dirs_exist_ok=True)


def _in_run(name: str, damage: Callable[[str], Given]) -> Given:
    """The two runs, with a file of the first damaged."""
    return both(runs, lambda: damage(str(min(Path(RUNS).rglob(name))))())


def _row(name: str, value: Any) -> Given:
    """The two runs, with an entry of the first one's row replaced; None takes it out."""

    def damage(path: str) -> Given:
        row = json.loads(Path(path).read_text()) | {name: value}
        return text(path, json.dumps({n: v for n, v in row.items() if n != name or v is not None}))

    return _in_run("row.json", damage)


def _vertices(damage: Callable[[str], Given]) -> Given:
    return _in_run("vertices.npy", damage)


def _cells(column: str, value: str) -> Given:
    """A table of rows with all cells of a column replaced."""

    def write() -> None:
        runs()
        with open(ROWS, newline="") as file:
            lines = list(csv.DictReader(file))
        with open(ROWS, "w", newline="") as file:
            writer = csv.DictWriter(file, lines[0].keys(), lineterminator="\n")
            writer.writeheader()
            writer.writerows(line | {column: value} for line in lines)

    return write


def _without_last_line() -> None:
    lines = Path(ROWS).read_text().splitlines(keepends=True)
    Path(ROWS).write_text("".join(lines[:-1]))


TABLE = {
    "no rows": (nothing, "no such file"),
    "an empty CSV": (data(ROWS, b""), "holds no rows of runs"),
    "a CSV of garbage": (garbage(ROWS), ROWS),
    "a CSV of something else": (text(ROWS, "a,b\n1,2\n"), "holds no rows of runs"),
    "a CSV that is cut in a line": (both(runs, cut(ROWS, -40)), "tiny.csv: line 3"),
    "a CSV that is cut at a line's end": (both(runs, _without_last_line), "of a file of 2 rows"),
    "a CSV of another schema": (_cells("schema", "2"), "line 2 is of schema 2"),
    "an unknown status": (_cells("status", "fine"), "its status is 'fine'"),
    "words for numbers": (_cells("metric.edge", "small"), "metric.edge is 'small'"),
    "no dates": (_cells("date", ""), "it has no date"),
}
OPTIONS = {
    "tables tiny -o body.ply": ("body.ply: the folder cannot be created",),
    "tables tiny nosuch -o t": ("nosuch.csv: no such file",),
    "curves tiny --metric beauty": ("invalid choice: 'beauty'",),
    "curves tiny": ("label",),
    f"check {ROWS} --bands rubber": ("no bands 'rubber'",),
}
ROW = {
    "no runs": (nothing, "no runs in tiny"),
    "an empty row": (_in_run("row.json", lambda p: data(p, b"")), "row.json: not a row"),
    "a row of garbage": (_in_run("row.json", garbage), "row.json: not a row"),
    "a cut row": (_in_run("row.json", lambda p: cut(p, 0.5)), "row.json: not a row"),
    "a row that is a list": (_in_run("row.json", lambda p: text(p, "[]")), "not a row"),
    "a row without a date": (_row("date", None), "it has no date"),
    "a row of an unknown status": (_row("status", "fine"), "its status is 'fine'"),
    "a row of another schema": (_row("schema", 2), "row.json is of schema 2"),
    "a row with a word for a number": (_row("metric.edge", "small"), "metric.edge is 'small'"),
}
#: Of those that read what a row names.
NAMED = {
    "vertices that are gone": (_vertices(lambda p: Path(p).unlink), "no such file"),
    "vertices of garbage": (_vertices(garbage), "vertices.npy: not the file of a run"),
    "cut vertices": (_vertices(lambda p: cut(p, 0.5)), "vertices.npy: not the file of a run"),
    "vertices that are a pickle": (_vertices(lambda p: data(p, pickle.dumps([1]))), "not the file of a run"),
    "vertices of another mesh": (_vertices(lambda p: lambda: np.save(p, np.zeros((5, 3)))), "5"),
    "a dataset that is gone": (both(runs, lambda: shutil.rmtree("balls")), "balls"),
    "a row that names a foreign function": (_row("task.source", '{"_target_": "os.getcwd"}'), "os.getcwd"),
    "a row whose source is no JSON": (_row("task.source", "{"), "source"),
    "a row that names no function": (_row("task.source", "[]"), "_target_"),
}

_CONFIGS = both(text("configs/x.yaml", "_target_: os.system\n"), text("broken/x.yaml", "a: [\n"), dataset)
METHODS = {
    "method=magic": ("there is no method 'magic'; choose one of acc",),
    "method=arap method.colour=red": ("colour",),
    "method=arap +method.colour=red": ("has no parameter 'colour'",),
    "method=arap method.max_iterations=many": ("max_iterations='many'",),
    "method=arap method.start=middle": ("start='middle'",),
    "run.speed=1": ("speed",),
    "seed=-1": ("seed=-1",),
    "run.time_limit=0": ("run.time_limit=0",),
    "run.jobs=0": ("run.jobs=0",),
    "method._target_=baselines.arap.magic run.allow_targets=[baselines.]": ("no function 'magic'",),
    "method._target_=magic.magic run.allow_targets=[magic.]": ("no module 'magic'",),
    "method._target_=os.system": ("names the function os.system",),
    "'proxy.vertices=[1'": ("proxy.vertices=[1 is not understood",),
    "dataset=moon": ("there is no dataset 'moon'",),
    "dataset.root=nowhere": ("nowhere does not exist", "defaust build"),
    "paths.runs=body.ply/x": ("body.ply/x",),
    "-cd configs": ("configs/x.yaml names the function os.system",),
    "-cd broken": ("broken/x.yaml: not readable as YAML",),
}
#: A command, and its file that holds garbage.
STUDIES = (
    ("topology body.ply", "body.ply"),
    ("jumps body.ply pose.json", "body.ply"),
    ("jumps body.ply pose.json", "pose.json"),
    ('bench speed --methods identity --cases "mesh mesh=body.ply handles=pose.json"', "body.ply"),
)


def _full_disk() -> None:
    """Earlier rows stay, the new one is not half there, and a rerun completes it."""
    before = contents()
    with limited(3000):
        check_refusal(run(f"{RUN} run.experiment=tiny subject=1"), "cannot be written", "disk may be full")
    assert contents() == before
    code, out, err = run(f"{RUN} run.experiment=tiny subject=1")
    assert code == 0 and len(contents().keys() - before.keys()) == 2, (code, err)


def _full_disk_of(command: str, *made: str, slow: bool = False) -> Case:
    def attempt() -> None:
        before = contents()
        with limited(60):
            check_refusal(run(command), "cannot be written (File too large)")
        assert contents() == before
        assert run(command)[0] == 0
        assert all(Path(name).is_file() for name in made)

    return Case(f"full disk: {command}", attempt, runs, leaves=(".",), slow=slow)


def _taken(command: str, *made: str) -> Case:
    return Case(f"sound: {command}", f"sshade-eval {command}", runs, leaves=made)


CASES = [
    *(case for name in OF_ROWS for case in refused(f"sshade-eval {name} {ROWS}", TABLE, prefix=f"{name}: ")),
    *(Case(call, f"sshade-eval {call}", runs, says=says) for call, says in OPTIONS.items()),
    *(case for name in OF_RUNS for case in refused(f"sshade-eval {name} tiny", ROW, prefix=f"{name}: ")),
    *(
        Case(f"{call}: {name}", f"sshade-eval {call}", given, says=(word,), leaves=(RUNS,))
        for call in ("figures tiny", "remeasure tiny")
        for name, (given, word) in NAMED.items()
    ),
    *(Case(f"run: {change}", f"{RUN} {change}", _CONFIGS, says=says) for change, says in METHODS.items()),
    Case("full disk: a run", _full_disk, runs, leaves=("out",)),
    _full_disk_of("sshade-eval collect tiny -o rows", "rows/tiny.csv"),
    _full_disk_of("sshade-eval tables tiny -o t", "t/tiny.md", "t/tiny.tex", "t/tiny.csv"),
    _full_disk_of("sshade-eval remeasure tiny"),
    _full_disk_of("sshade-eval report tiny -o r.html", "r.html", slow=True),
    _full_disk_of("sshade-eval figures tiny -o f.png", "f.png", slow=True),
    _taken("collect tiny -o rows", "rows"),
    Case(
        "collect: a row of the future",
        "sshade-eval collect tiny -o rows",
        _row("date", "2999-01-01"),
        says=("is of the future, 2999-01-01",),
    ),
    Case(
        "collect: a damaged plan",
        "sshade-eval collect tiny -o rows",
        both(runs, lambda: cut(str(min(Path(RUNS).glob("tiny/.plan/*.json"))), 0.5)()),
        says=("not a plan", "remove it"),
    ),
    Case(
        "run: a plan with a case that the dataset lacks",
        f"{SWEEP} pose=1,2,9",
        runs,
        says=("names subject 0, pose 9, which balls does not have",),
    ),
    _taken("tables tiny -o t", "t"),
    _taken("remeasure tiny", RUNS),
    Case("run: what is there already", SWEEP, runs, leaves=(f"{RUNS}/tiny/multirun.yaml",)),
    *(
        Case(f"{call}: garbage for {path}", f"sshade-eval {call}", garbage(path), says=(path,))
        for call, path in STUDIES
    ),
]
