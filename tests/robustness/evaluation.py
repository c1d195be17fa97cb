"""Cases: running methods, and everything made of rows."""

from __future__ import annotations

import atexit
import json
import pickle
import shutil
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from tests.robustness.case import Case, contents, limited, run, working_in
from tests.robustness.datasets import RUN, dataset
from tests.robustness.inputs import Given, both, cut, data, garbage, text

CASES_OF_TWO = "dataset=defaust dataset.root=balls subject=0 pose=1,2"
SWEEP = f"sshade-eval run -m {CASES_OF_TWO} method=identity run.experiment=tiny"
OF_ROWS = (
    "tables",
    "charts",
    "report",
    "check",
    "curves",
)
OF_RUNS = ("collect", "figures", "remeasure")


@cache
def _done() -> Path:
    """A working folder with a dataset, two runs and their rows."""
    place = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    with working_in(place):
        dataset()
        assert run(SWEEP)[0] == 0
        assert run("sshade-eval collect tiny")[0] == 0
    return place


def runs() -> None:
    """Two runs, their dataset and their rows."""
    shutil.copytree(_done(), ".", dirs_exist_ok=True)


def _of_run(name: str) -> Path:
    """A file of the first of the runs."""
    return min(Path("out/runs").rglob(name))


def _in_run(name: str, damage: Callable[[str], Given]) -> Given:
    return both(runs, lambda: damage(str(_of_run(name)))())


def _row(**changes: Any) -> Given:
    """A row with entries replaced; None takes one out."""

    def write() -> None:
        runs()
        row = json.loads(_of_run("row.json").read_text())
        for name, value in changes.items():
            row[name.replace("__", ".")] = value
        _of_run("row.json").write_text(
            json.dumps({n: v for n, v in row.items() if v is not None or n not in changes})
        )

    return write


def _csv(change: Callable[[str], str]) -> Given:
    def write() -> None:
        runs()
        path = Path("out/rows/tiny.csv")
        path.write_text(change(path.read_text()))

    return write


def _each(programs: tuple[str, ...], name: str, given: Given, *says: str) -> list[Case]:
    """The same wrong input for each program that reads it."""
    return [
        Case(f"{program}: {name}", f"sshade-eval {program} tiny", given, says=says)
        if program in OF_RUNS
        else Case(f"{program}: {name}", f"sshade-eval {program} out/rows/tiny.csv", given, says=says)
        for program in programs
    ]


def _cells(column: str, value: str) -> Callable[[str], str]:
    """A CSV with a column's cells replaced."""
    import csv
    import io

    def change(content: str) -> str:
        lines = list(csv.DictReader(io.StringIO(content)))
        out = io.StringIO()
        writer = csv.DictWriter(out, lines[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(line | {column: value} for line in lines)
        return out.getvalue()

    return change


ROWS = [
    *_each(OF_ROWS, "no rows", lambda: None, "no such file"),
    *_each(OF_ROWS, "an empty CSV", data("out/rows/tiny.csv", b""), "holds no rows of runs"),
    *_each(OF_ROWS, "a CSV of garbage", garbage("out/rows/tiny.csv"), "out/rows/tiny.csv"),
    *_each(
        OF_ROWS,
        "a CSV of something else",
        text("out/rows/tiny.csv", "a,b\n1,2\n"),
        "holds no rows of runs",
    ),
    *_each(
        OF_ROWS, "a CSV that is cut in a line", _csv(lambda t: t[:-40]), "tiny.csv: line 3 has another number"
    ),
    *_each(OF_ROWS, "a CSV with an unknown status", _csv(_cells("status", "fine")), "its status is 'fine'"),
    *_each(
        OF_ROWS,
        "a CSV with words for numbers",
        _csv(_cells("metric.edge", "small")),
        "metric.edge is 'small', no number",
    ),
    *_each(OF_ROWS, "a CSV without dates", _csv(_cells("date", "")), "it has no date"),
    Case(
        "tables: an unknown machine",
        "sshade-eval tables tiny --machine abacus",
        runs,
        says=("no row is of a machine with 'abacus'",),
    ),
    Case(
        "tables: a file for the output folder",
        "sshade-eval tables tiny -o body.ply",
        runs,
        says=("body.ply: the folder cannot be made",),
    ),
    Case(
        "tables: rows that are not there beside sound ones",
        "sshade-eval tables tiny nosuch -o t",
        runs,
        says=("nosuch.csv: no such file",),
    ),
    Case(
        "curves: an unknown metric",
        "sshade-eval curves tiny --metric beauty",
        runs,
        says=("no metric 'beauty'",),
    ),
    Case(
        "curves: methods without a size",
        "sshade-eval curves tiny",
        runs,
        says=("label",),
    ),
    Case(
        "check: unknown bands",
        "sshade-eval check out/rows/tiny.csv --bands rubber",
        runs,
        says=("no bands 'rubber'",),
    ),
]
RUNS = [
    *_each(OF_RUNS, "no runs", lambda: None, "no runs in tiny"),
    *_each(OF_RUNS, "an empty row", _in_run("row.json", lambda p: data(p, b"")), "row.json: not a row"),
    *_each(OF_RUNS, "a row of garbage", _in_run("row.json", garbage), "row.json: not a row"),
    *_each(OF_RUNS, "a cut row", _in_run("row.json", lambda p: cut(p, 0.5)), "row.json: not a row"),
    *_each(
        OF_RUNS, "a row that is a list", _in_run("row.json", lambda p: text(p, "[]")), "not a row (no object)"
    ),
    *_each(OF_RUNS, "a row without a date", _row(date=None), "not a row (it has no date)"),
    *_each(OF_RUNS, "a row of an unknown status", _row(status="fine"), "its status is 'fine'"),
    *_each(OF_RUNS, "a row with a word for a number", _row(metric__edge="small"), "metric.edge is 'small'"),
]
READERS = (
    ("figures", "sshade-eval figures tiny"),
    ("remeasure", "sshade-eval remeasure tiny --metrics edge"),
)
for _program, _call in READERS:
    RUNS += [
        Case(f"{_program}: {name}", _call, given, says=says, leaves=("out/runs",))
        for name, given, says in (
            (
                "vertices that are gone",
                _in_run("vertices.npy", lambda p: lambda: Path(p).unlink()),
                ("no such file",),
            ),
            (
                "vertices of garbage",
                _in_run("vertices.npy", garbage),
                ("vertices.npy: not the file of a run",),
            ),
            (
                "cut vertices",
                _in_run("vertices.npy", lambda p: cut(p, 0.5)),
                ("vertices.npy: not the file of a run",),
            ),
            (
                "vertices that are a pickle",
                _in_run("vertices.npy", lambda p: data(p, pickle.dumps([1]))),
                ("not the file of a run",),
            ),
            (
                "vertices of another mesh",
                _in_run("vertices.npy", lambda p: lambda: np.save(p, np.zeros((5, 3)))),
                ("5",),
            ),
            ("a dataset that is gone", both(runs, lambda: shutil.rmtree("balls")), ("balls",)),
            (
                "a row that names a foreign function",
                _row(task__source='{"_target_": "os.getcwd"}'),
                ("names the function os.getcwd",),
            ),
            ("a row whose source is no JSON", _row(task__source="{"), ("source",)),
            ("a row that names no function", _row(task__source="[]"), ("_target_",)),
        )
    ]

_CONFIGS = both(text("configs/x.yaml", "_target_: os.system\n"), text("broken/x.yaml", "a: [\n"), dataset)
METHODS = [
    Case(f"run: {name}", f"{RUN} {change}", _CONFIGS, says=says)
    for name, change, says in (
        ("an unknown method", "method=magic", ("there is no method 'magic'; choose one of acc",)),
        ("an unknown parameter", "method=arap method.colour=red", ("colour",)),
        ("an unknown parameter, added", "method=arap +method.colour=red", ("has no parameter 'colour'",)),
        ("a parameter of another type", "method=arap method.max_iterations=many", ("max_iterations='many'",)),
        ("an unknown choice", "method=arap method.start=middle", ("start='middle'",)),
        ("an unknown key of the run", "run.speed=1", ("speed",)),
        ("a negative seed", "seed=-1", ("seed=-1",)),
        ("a time limit of 0", "run.time_limit=0", ("run.time_limit=0",)),
        ("jobs of 0", "run.jobs=0", ("run.jobs=0",)),
        (
            "a function that is not there",
            "method._target_=baselines.arap.magic run.allow_targets=[baselines.]",
            ("no function 'magic'",),
        ),
        (
            "a module that is not there",
            "method._target_=magic.magic run.allow_targets=[magic.]",
            ("no module 'magic'",),
        ),
        ("a foreign function", "method._target_=os.system", ("names the function os.system",)),
        ("a value that is not closed", "'proxy.vertices=[1'", ("proxy.vertices=[1 is not understood",)),
        ("an unknown dataset", "dataset=moon", ("there is no dataset 'moon'",)),
        (
            "a missing dataset",
            "dataset.root=nowhere",
            ("nowhere does not exist; make it with: defaust build",),
        ),
        ("a folder of runs below a file", "paths.runs=body.ply/x", ("body.ply/x",)),
        (
            "a config folder with a foreign function",
            "-cd configs",
            ("configs/x.yaml names the function os.system",),
        ),
        ("a config folder with broken YAML", "-cd broken", ("broken/x.yaml: not readable as YAML",)),
    )
]


def _full_disk() -> None:
    """Earlier rows stay, the new one is not half there, and a rerun completes it."""
    before = contents()
    with limited(3000):
        code, out, err = run(f"{RUN} run.experiment=tiny subject=1")
    assert code == 2 and "cannot be written" in err and "disk may be full" in err, (code, err)
    assert err.count("\n") == 1 and contents() == before
    code, out, err = run(f"{RUN} run.experiment=tiny subject=1")
    assert code == 0 and len(contents().keys() - before.keys()) == 2, (code, err)


def _full_disk_of(command: str, *made: str) -> Callable[[], None]:
    def attempt() -> None:
        before = contents()
        with limited(60):
            code, out, err = run(command)
        assert code == 2 and "cannot be written (File too large)" in err and err.count("\n") == 1, (code, err)
        assert contents() == before
        assert run(command)[0] == 0
        assert all(Path(name).is_file() for name in made)

    return attempt


FULL = [
    Case("full disk: a run", _full_disk, runs, leaves=("out",)),
    Case(
        "full disk: eval.rows.collect",
        _full_disk_of("sshade-eval collect tiny -o rows", "rows/tiny.csv"),
        runs,
        leaves=("rows",),
    ),
    Case(
        "full disk: eval.publish.tables",
        _full_disk_of("sshade-eval tables tiny -o t", "t/tiny.md", "t/tiny.tex", "t/tiny.csv"),
        runs,
        leaves=("t",),
    ),
    Case(
        "full disk: eval.rows.remeasure",
        _full_disk_of("sshade-eval remeasure tiny --metrics edge"),
        runs,
        leaves=("out",),
    ),
    Case(
        "full disk: eval.publish.report",
        _full_disk_of("sshade-eval report tiny -o r.html", "r.html"),
        runs,
        leaves=("r.html",),
        slow=True,
    ),
    Case(
        "full disk: eval.publish.figures",
        _full_disk_of("sshade-eval figures tiny -o f.png", "f.png"),
        runs,
        leaves=("f.png",),
        slow=True,
    ),
]
TAKEN = [
    Case("collect: sound runs", "sshade-eval collect tiny -o rows", runs, leaves=("rows",)),
    Case("tables: sound rows", "sshade-eval tables tiny -o t", runs, leaves=("t",)),
    Case("remeasure: nothing lacks", "sshade-eval remeasure tiny", runs),
    Case("run: what is there already", SWEEP, runs, leaves=("out/runs/tiny/multirun.yaml",)),
]
BENCH = [
    Case(
        "topology: a mesh of garbage",
        "sshade-eval topology body.ply",
        garbage("body.ply"),
        says=("body.ply",),
    ),
    Case(
        "jumps: a mesh of garbage",
        "sshade-eval jumps body.ply pose.json",
        garbage("body.ply"),
        says=("body.ply",),
    ),
    Case(
        "jumps: handles of garbage",
        "sshade-eval jumps body.ply pose.json",
        garbage("pose.json"),
        says=("pose.json",),
    ),
    Case(
        "bench: a mesh of garbage",
        "sshade-eval bench body.ply pose.json",
        garbage("body.ply"),
        says=("body.ply",),
    ),
]
CASES = [*ROWS, *RUNS, *METHODS, *FULL, *TAKEN, *BENCH]
