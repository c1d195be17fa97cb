"""The pictures of an experiment: ``sshade-eval figures [EXPERIMENT]``, needs the extra ``figures``.

The chart ``out/figures/<experiment>_time.svg`` shows the time of each method against its distance to the true
pose. The picture ``out/figures/<experiment>.png`` shows shapes, if there are run folders: a row of panels for
each case, as :mod:`eval.publish.panels` describes. A run that failed shows its reason. ``conf/pictures.yaml``
holds the cases, methods and camera of some experiments; options override its cases and methods.
"""

from __future__ import annotations

import argparse
import re
import textwrap
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from eval.publish import panels
from eval.publish.columns import HEADLINE
from eval.publish.comparison import compare, means
from eval.publish.notes import require_one_version
from eval.publish.panels import Camera, Case
from eval.publish.plotting import FIGURES, new_figure, save, style
from eval.rows.collect import Experiment, read_experiments
from eval.rows.files import ROWS_HELP, has_runs, read_conf
from eval.rows.frame import distinct, of_methods, records
from eval.rows.store import VALID, Row
from eval.run.config import load_task
from sshade.core.errors import InputError
from sshade.plotting.pictures import TOWARDS, UP

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Colours of methods in the order of the table; colour-blind people can tell them apart. Then markers.
PALETTE = (
    *("#0072b2", "#e69f00", "#009e73", "#d55e00", "#cc79a7"),
    *("#56b4e9", "#8c6d31", "#6b6ecf", "#637939", "#7f7f7f"),
)
MARKERS = "osD^vPX*<>"


def time_and_truth(rows: pd.DataFrame) -> dict[str, tuple[float, float]]:
    """Return the mean time and the mean distance to the true pose of each method, over their common cases.

    References are left out.
    """
    comparison = compare(of_methods(rows), HEADLINE)
    found = means(comparison.values, "method.name").reindex(comparison.ranked)[["time", "truth"]].dropna()
    return {name: (time, truth) for name, time, truth in found.itertuples()}


@style()
def chart_of(rows: pd.DataFrame) -> Figure | None:
    """Return the chart of rows, None where fewer than two methods have a distance to the true pose."""
    from matplotlib.ticker import LogLocator, NullFormatter

    points = time_and_truth(rows)
    if len(points) < 2:
        return None
    figure = new_figure(4.8, 3.6)
    axes = figure.subplots()
    for i, (method, point) in enumerate(points.items()):
        marker, colour = MARKERS[i // len(PALETTE) % len(MARKERS)], PALETTE[i % len(PALETTE)]
        axes.plot(*point, marker, color=colour, label=method)
    machine = "; ".join(distinct(rows, "env.machine"))
    axes.set(xscale="log", xlabel="\n".join(["time (s)", *textwrap.wrap(machine, 46)]))
    axes.set(ylabel="distance to the true pose (% of the diagonal)")
    axes.set_ylim(0, 1.1 * axes.get_ylim()[1])
    axes.grid(alpha=0.3)
    axes.margins(x=0.15)
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 3)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    figure.legend(loc="outside right upper")
    return figure


def read_cases(experiment: Experiment, *, names: Sequence[str], methods: Sequence[str]) -> list[Case]:
    """Read tasks and results from the run folders of an experiment; the latest of several runs counts.

    Parameters
    ----------
    experiment : Experiment
    names, methods : list of str
        Cases and methods to show. If empty: three cases, and all methods with a result on them.

    Raises
    ------
    InputError
        If there is no such run or result, or a dataset has changed since the run.
    """
    rows = of_methods(experiment.rows)
    every = rows.assign(found=rows["status"].isin(VALID))
    # The latest run with a result; without a result, the latest run.
    every = every.sort_values(["found", "date"]).drop_duplicates(["task.name", "method.name"], keep="last")
    rows = every[every["found"]]
    known = sorted(rows["task.name"].unique())
    if not known:
        raise InputError(f"{experiment.name} has no run with a result")
    missing = [name for name in names if name not in known]
    if missing:
        raise InputError(f"{experiment.name} has no case {missing[0]!r}; there are {', '.join(known)}")
    names = names or [known[i] for i in np.unique(np.linspace(0, len(known) - 1, 3).astype(int))]
    with_result = set(rows["method.name"][rows["task.name"].isin(names)])
    methods = methods or [method for method in experiment.methods if method in with_result]
    return [_case(experiment, records(every[every["task.name"] == name]), methods) for name in names]


def _case(experiment: Experiment, rows: Sequence[Row], methods: Sequence[str]) -> Case:
    runs = {row["method.name"]: row for row in rows}
    case = f"the case {rows[0]['task.name']!r} of {experiment.name}"
    results: dict[str, np.ndarray | str] = {}
    for method in methods:
        if method not in runs:
            raise InputError(f"{case} has no run of {method!r}")
        row = runs[method]
        V = experiment.vertices(row) if row["found"] else None
        if row["found"] and V is None:
            raise InputError(
                f"{experiment.runs} does not hold the run of {method!r} on {case}; collect the rows again"
            )
        results[method] = re.sub(r"^\w+Error: ", "", row["reason"] or row["status"]) if V is None else V
    if all(isinstance(result, str) for result in results.values()):
        raise InputError(f"{case} has no result of {', '.join(methods)}")
    return Case(load_task(next(row for row in rows if row["found"])), results, runs)


def read_picture(name: str) -> dict[str, Any]:
    """Return the entry of an experiment in ``conf/pictures.yaml``; it may be empty."""
    return dict(read_conf("pictures").get(name, {}))


def camera_of(name: str) -> Camera:
    """Return the camera of the pictures of an experiment."""
    entry = read_picture(name)
    return Camera(np.array(entry.get("towards", TOWARDS)), np.array(entry.get("up", UP)))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("rows", nargs="?", type=Path, default=Path("quick"), help=ROWS_HELP)
    parser.add_argument("--cases", nargs="+", default=[], help="task names (default: three cases)")
    parser.add_argument("--methods", nargs="+", default=[], help="method names (default: all)")
    text = "colours: distance to the true pose if known (default), or change of edge lengths as in the paper"
    parser.add_argument("--colour", choices=("truth", "edge"), default="truth", help=text)
    text = "picture to write (default: out/figures/<experiment>.png)"
    parser.add_argument("-o", "--out", type=Path, help=text)


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    import matplotlib  # noqa: F401 - refused before the results are read
    import pyvista  # noqa: F401

    (experiment,) = read_experiments([options.rows])
    require_one_version(experiment.rows)
    if (chart := chart_of(experiment.rows)) is not None:
        save(chart, FIGURES / f"{experiment.name}_time.svg")
    if has_runs(experiment.name):
        _draw_shapes(experiment, options)
    return 0


def of_one_error(cases: list[Case], colour: str = "truth") -> list[Case]:
    """Return cases whose colours mean the same: without true poses where some have none, and for "edge"."""
    if colour == "truth" and len({panels.error_label(case.task) for case in cases}) == 1:
        return cases
    return [case._replace(task=replace(case.task, truth=None)) for case in cases]


def _draw_shapes(experiment: Experiment, options: argparse.Namespace) -> None:
    """Draw the grid of pictures: a row for each case, a panel for each method."""
    entry = read_picture(experiment.name)
    names, methods = options.cases or entry.get("tasks", []), options.methods or entry.get("methods", [])
    cases = of_one_error(read_cases(experiment, names=names, methods=methods), options.colour)
    camera = camera_of(experiment.name)
    out = options.out or FIGURES / f"{experiment.name}.png"
    rows = [panels.row_of(case, camera) for case in cases]
    legend = f"{panels.what_to_see(cases[0].task)} Percentages are means. Seconds are of these runs."
    if any(panel.handles for row in rows for panel in row.panels):
        legend += " Handles: blue fixed, yellow moved."
    title = f"{entry.get('title', experiment.name)}\n{legend}"
    save(panels.draw(rows, title=title, label=panels.error_label(cases[0].task)), out)
