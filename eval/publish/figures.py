"""The comparison picture: ``sshade-eval figures [EXPERIMENT]``, needs the extra ``figures``.

The rest shape of each case, with its handles (blue: static, yellow: dynamic),
then each method's result, coloured by how much the edges at a vertex changed
their length, on one scale. Of pose transfers also a close-up of the largest
error. Made from run folders; no method is run.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eval.metrics import Task
from eval.publish import panels
from eval.publish.plotting import FIGURES, add_camera, camera, save
from eval.rows.collect import collect
from eval.rows.experiment import Experiment
from eval.rows.frame import numbers, records, valid
from eval.rows.store import FOLDER_HELP, experiment_folder
from eval.run.recall import load_task
from sshade.errors import InputError
from sshade.figures import colour_range, require_extra


@dataclass(frozen=True)
class Case:
    """A task and the vertices that each method left for it."""

    task: Task
    results: dict[str, np.ndarray]


def read_cases(folder: Path, *, names: list[str], methods: list[str], worst: str | None = None) -> list[Case]:
    """Read tasks and results from the run folders of an experiment; of several runs the latest counts.

    Parameters
    ----------
    folder : path
    names, methods : list of str
        Cases and methods to show; empty: three spread over the cases, and all methods.
    worst : str, optional
        A metric: without names, show the one case where a method shown has the largest value.

    Raises
    ------
    InputError
        When there is no such run or metric, or a dataset is not the one that was run on.
    """
    experiment = Experiment(folder.name, collect(folder), (folder,))
    rows = valid(experiment.rows).sort_values("date")
    rows = rows.drop_duplicates(["task.name", "method.name"], keep="last")
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
    cases = []
    for name in names:
        runs = {row["method.name"]: row for row in records(rows[rows["task.name"] == name])}
        absent = [method for method in methods if method not in runs]
        if absent:
            raise InputError(f"{folder}: case {name!r} has no result of {absent[0]!r}")
        task = load_task(next(iter(runs.values())))
        chosen = methods or [method for method in experiment.methods if method in runs]
        results = {method: experiment.vertices(runs[method]) for method in chosen}
        if any(V is None for V in results.values()):
            raise InputError(
                f"{folder}: the runs of {name} lie in folders of other names than were given them"
            )
        cases.append(Case(task, results))
    return cases


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
    cases = read_cases(folder, names=options.cases, methods=options.methods, worst=options.worst)
    rows = [row for case in cases for row in panels.rows_of(case.task, case.results, **camera(options))]
    top = colour_range(panels.error_of(case.task, V) for case in cases for V in case.results.values())
    label = panels.error_label(cases[0].task)
    legend = "  (handles: blue static, yellow dynamic)" if any(row.handles for row in rows) else ""
    figure = panels.draw(rows, title=folder.name + legend, top=top, label=label)
    save(figure, options.out or FIGURES / f"{folder.name}.png")
    return 0
