"""The comparison picture: ``sshade-eval figures [EXPERIMENT]``, needs the extra ``figures``.

The rest shape of each case, with its handles (blue: static, yellow: dynamic),
then each method's result, coloured by how much the edges at a vertex changed
their length, on one scale, or why there is none. Of pose transfers also a close-up of the largest
error. Made from run folders; no method is run. Which cases, methods and camera, unless told,
``conf/pictures.yaml`` says of the experiments that it names.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from eval.metrics import Task
from eval.publish import panels
from eval.publish.plotting import FIGURES, add_camera, camera, save
from eval.rows.collect import collect
from eval.rows.experiment import Experiment
from eval.rows.frame import numbers, records
from eval.rows.store import FOLDER_HELP, VALID, Row, experiment_folder
from eval.run.recall import load_task
from sshade.cli.configuration import CONFIGURATION
from sshade.errors import InputError
from sshade.figures import colour_range, require_extra


@dataclass(frozen=True)
class Case:
    """A task and the vertices that each method left for it, or why it left none."""

    task: Task
    results: dict[str, np.ndarray | str]


def read_cases(
    folder: Path, *, names: Sequence[str], methods: Sequence[str], worst: str | None = None
) -> list[Case]:
    """Read tasks and results from the run folders of an experiment; of several runs the latest counts.

    Parameters
    ----------
    folder : path
    names, methods : list of str
        Cases and methods to show; empty: three spread over the cases, and all methods with a result there.
    worst : str, optional
        A metric: without names, show the one case where a method shown has the largest value.

    Raises
    ------
    InputError
        When there is no such run, result or metric, or a dataset is not the one that was run on.
    """
    experiment = Experiment(folder.name, collect(folder), (folder,))
    every = experiment.rows.assign(found=experiment.rows["status"].isin(VALID))
    # The latest run with a result, or without any the latest of all.
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
    chosen = methods or [method for method in experiment.methods if method in with_result]
    return [_case(experiment, records(every[every["task.name"] == name]), chosen) for name in names]


def _case(experiment: Experiment, rows: Sequence[Row], methods: Sequence[str]) -> Case:
    runs = {row["method.name"]: row for row in rows}
    name = rows[0]["task.name"]
    results: dict[str, np.ndarray | str] = {}
    for method in methods:
        if method not in runs:
            raise InputError(f"{experiment.runs[0]}: case {name!r} has no run of {method!r}")
        if not runs[method]["found"]:
            reason = runs[method]["reason"] or runs[method]["status"]
            results[method] = re.sub(r"^\w+Error: ", "", reason)
            continue
        V = experiment.vertices(runs[method])
        if V is None:
            raise InputError(
                f"{experiment.runs[0]}: the runs of {name} lie in folders of other names than were given them"
            )
        results[method] = V
    if not any(isinstance(result, np.ndarray) for result in results.values()):
        raise InputError(f"{experiment.runs[0]}: case {name!r} has no result of {', '.join(methods)}")
    return Case(load_task(next(row for row in rows if row["found"])), results)


def read_picture(name: str, path: Path = CONFIGURATION / "pictures.yaml") -> dict[str, Any]:
    """What ``conf/pictures.yaml`` says of an experiment: title, tasks, methods, towards, up, or fewer."""
    with path.open(encoding="utf-8") as file:
        return dict(yaml.safe_load(file).get(name, {}))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("folder", nargs="?", type=Path, default=Path("quick"), help=FOLDER_HELP)
    parser.add_argument("--cases", nargs="+", default=[], help="task names (default: three of them)")
    parser.add_argument("--methods", nargs="+", default=[], help="method names (default: all)")
    parser.add_argument("--worst", metavar="METRIC", help="the one case where this metric is largest")
    add_camera(parser)
    parser.add_argument("-o", "--out", type=Path, help="default: out/figures/<experiment>.png")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    require_extra()
    folder = experiment_folder(options.folder)
    told = read_picture(folder.name)
    names, methods = options.cases, options.methods or told.get("methods", [])
    if not names and not options.worst:
        names = told.get("tasks", [])
    cases = read_cases(folder, names=names, methods=methods, worst=options.worst)
    view = camera(options, told)
    rows = [row for case in cases for row in panels.rows_of(case.task, case.results, **view)]
    found = ((case.task, V) for case in cases for V in case.results.values() if isinstance(V, np.ndarray))
    top = colour_range(panels.error_of(task, V) for task, V in found)
    label = panels.error_label(cases[0].task)
    legend = "  (handles: blue stay, yellow move)" if any(row.handles for row in rows) else ""
    figure = panels.draw(rows, title=told.get("title", folder.name) + legend, top=top, label=label)
    save(figure, options.out or FIGURES / f"{folder.name}.png", small=True)
    return 0
