"""The pictures of an experiment: ``sshade-eval figures [EXPERIMENT]``, needs the extra ``figures``.

The chart ``out/figures/<experiment>_time.svg`` shows the time of each method against its distance to the true
pose. The picture ``out/figures/<experiment>.png`` shows shapes, if there are run folders: a row of panels for
each case, with the rest shape and its handles (blue: fixed, yellow: moved), then the result of each method,
coloured by the change of edge lengths at a vertex. A run that failed shows its reason. Pose transfers have a
second row with the place of the largest error. ``conf/pictures.yaml`` holds the cases, methods and camera of
some experiments; options override it.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eval.metrics import Task
from eval.publish import panels
from eval.publish.chart import chart_of
from eval.publish.plotting import FIGURES, add_camera, camera, save
from eval.rows.collect import Experiment, collect, load_rows
from eval.rows.files import FOLDER_HELP, TIMING, experiment_folder, has_runs, read_conf, rows_file
from eval.rows.frame import numbers, read_csv, records
from eval.rows.store import VALID, Row
from eval.run.config import load_task
from sshade.core.errors import InputError
from sshade.plotting.pictures import colour_range


class Case(NamedTuple):
    """A task with the vertices (n, 3) of each method, or the reason why there are none, and the rows."""

    task: Task
    results: dict[str, np.ndarray | str]
    rows: dict[str, Row]


def read_cases(
    folder: Path, *, names: Sequence[str], methods: Sequence[str], worst: str | None = None
) -> list[Case]:
    """Read tasks and results from the run folders of an experiment; the latest of several runs counts.

    Parameters
    ----------
    folder : path
    names, methods : list of str
        Cases and methods to show. If empty: three cases, and all methods with a result on them.
    worst : str, optional
        A metric. Without `names`, show the case with the largest value.

    Raises
    ------
    InputError
        If there is no such run, result or metric, or a dataset has changed since the run.
    """
    experiment = Experiment(folder.name, collect(folder), (folder,))
    every = experiment.rows.assign(found=experiment.rows["status"].isin(VALID))
    # The latest run with a result; without a result, the latest run.
    every = every.sort_values(["found", "date"]).drop_duplicates(["task.name", "method.name"], keep="last")
    rows = every[every["found"]]
    known = sorted(rows["task.name"].unique())
    if not known:
        raise InputError(f"{folder}: no runs with a result there")
    missing = [name for name in names if name not in known]
    if missing:
        raise InputError(f"{folder}: no case {missing[0]!r}; there are {', '.join(known)}")
    if worst and not names:
        shown = rows[rows["method.name"].isin(methods)] if methods else rows
        values = numbers(shown, f"metric.{worst}")
        if values.isna().all():
            raise InputError(f"no case has the metric {worst!r}")
        names = [shown["task.name"][values.idxmax()]]
    names = names or [known[i] for i in np.unique(np.linspace(0, len(known) - 1, 3).astype(int))]
    with_result = set(rows["method.name"][rows["task.name"].isin(names)])
    methods = methods or [method for method in experiment.methods if method in with_result]
    return [_case(experiment, records(every[every["task.name"] == name]), methods) for name in names]


def _case(experiment: Experiment, rows: Sequence[Row], methods: Sequence[str]) -> Case:
    runs = {row["method.name"]: row for row in rows}
    folder, name = experiment.runs[0], rows[0]["task.name"]
    results: dict[str, np.ndarray | str] = {}
    for method in methods:
        if method not in runs:
            raise InputError(f"{folder}: case {name!r} has no run of {method!r}")
        row = runs[method]
        V = experiment.vertices(row) if row["found"] else None
        if row["found"] and V is None:
            raise InputError(f"{folder}: the run folders of {name} were renamed; give them their old names")
        results[method] = re.sub(r"^\w+Error: ", "", row["reason"] or row["status"]) if V is None else V
    if all(isinstance(result, str) for result in results.values()):
        raise InputError(f"{folder}: case {name!r} has no result of {', '.join(methods)}")
    return Case(load_task(next(row for row in rows if row["found"])), results, runs)


def read_picture(name: str) -> dict[str, Any]:
    """Return the entry of an experiment in ``conf/pictures.yaml``; it may be empty."""
    return dict(read_conf("pictures").get(name, {}))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("folder", nargs="?", type=Path, default=Path("quick"), help=FOLDER_HELP)
    text = "rows of `sshade-eval bench` with the times of the chart (default: the times of the runs)"
    parser.add_argument("--times", metavar="NAME", help=text)
    parser.add_argument("--cases", nargs="+", default=[], help="task names (default: three cases)")
    parser.add_argument("--methods", nargs="+", default=[], help="method names (default: all)")
    text = "show the case with the largest value of this measure"
    parser.add_argument("--worst", metavar="METRIC", help=text)
    add_camera(parser)
    text = "picture to write (default: out/figures/<experiment>.png)"
    parser.add_argument("-o", "--out", type=Path, help=text)


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    import matplotlib  # noqa: F401 - refused before the results are read
    import pyvista  # noqa: F401

    rows = load_rows(options.folder)
    times = None if options.times is None else read_csv(rows_file(options.times, TIMING))
    name = options.folder.resolve().name if options.folder.is_dir() else options.folder.stem
    if (chart := chart_of(rows, times)) is not None:
        save(chart, FIGURES / f"{name}_time.svg")
    if options.folder.suffix != ".csv" and (options.folder.is_dir() or has_runs(options.folder)):
        _draw_shapes(experiment_folder(options.folder), options)
    return 0


def _draw_shapes(folder: Path, options: argparse.Namespace) -> None:
    """Draw the grid of pictures: a row for each case, a panel for each method."""
    entry = read_picture(folder.name)
    names, methods = options.cases, options.methods or entry.get("methods", [])
    if not names and not options.worst:
        names = entry.get("tasks", [])
    cases = read_cases(folder, names=names, methods=methods, worst=options.worst)
    view = camera(options, entry)
    out = options.out or FIGURES / f"{folder.name}.png"
    rows = [row for case in cases for row in panels.rows_of(case.task, case.results, **view)]
    found = ((case.task, V) for case in cases for V in case.results.values() if isinstance(V, np.ndarray))
    top = colour_range(panels.error_of(task, V) for task, V in found)
    label = panels.error_label(cases[0].task)
    legend = "  (handles: blue stay, yellow move)" if any(row.handles for row in rows) else ""
    figure = panels.draw(rows, title=entry.get("title", folder.name) + legend, top=top, label=label)
    save(figure, out, small=True)
