"""``sshade-eval report``: the results of experiments on one HTML page that needs no network.

The page shows numbers, time against truth, configurations and failures from rows. If the run folders exist,
it also has pictures of every case and a 3D view.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from eval.publish.chart import chart_of
from eval.publish.columns import SUCCESS, begun
from eval.publish.html import configuration, facts, render, svg_uri
from eval.publish.plotting import add_camera, camera
from eval.publish.report.cases import show_case
from eval.publish.summary import make_table
from eval.rows.collect import Experiment, read_experiments
from eval.rows.files import ROWS_HELP, add_out, write_text
from eval.rows.frame import method_names, records, valid
from sshade import plotting
from sshade.core.console import progress_bar
from sshade.core.errors import InputError
from sshade.core.progress import Progress
from sshade.plotting import threejs

#: Default number of cases of an experiment in the 3D view.
TURNABLE = 3


def write_page(
    experiments: list[Experiment],
    *,
    cases: list[str],
    towards: np.ndarray,
    up: np.ndarray,
    progress: Progress,
) -> str:
    """Return the page as HTML text.

    Parameters
    ----------
    experiments : list of Experiment
    cases : list of str
        Names of tasks to show. If empty: pictures of every case, and three cases of each experiment in 3D.
    towards, up : (3,) float64
        Direction from the scene to the camera, and upright direction.
    progress : Progress

    Raises
    ------
    InputError
        If no experiment has a named case, or the rows of an experiment make no table.
    """
    every = pd.concat([experiment.rows for experiment in experiments], ignore_index=True)
    known = set(every["task.name"])
    unknown = [name for name in cases if name not in known]
    if unknown:
        raise InputError(f"there is no case {unknown[0]!r}; there are {', '.join(sorted(known))}")
    direction = {"towards": towards, "up": up}
    form = {"cases": cases, "camera": direction, "progress": progress}
    sections = [_section(experiment, **form) for experiment in experiments]
    views = [
        case.view | {"title": f"{section['name']}: {case.name}", "id": f"{section['slug']}-case-{i}"}
        for section in sections
        for i, case in enumerate(section["cases"])
        if case.view is not None
    ]
    return render(
        "publish/report/page.html",
        sections=sections,
        data=[view.pop("data") for view in views],
        views=views,
        camera={name: list(axis) for name, axis in direction.items()},
        ramp=plotting.ramp(),
        three=threejs.source(),
        viewer=plotting.part("viewer.js"),
        view_markup=plotting.part("view.html"),
        view_style=plotting.style(),
        valid=len(valid(every)),
        runs=len(every),
    )


def _section(
    experiment: Experiment,
    *,
    cases: list[str],
    camera: dict[str, np.ndarray],
    progress: Progress,
) -> dict[str, Any]:
    """Return the contents of the section of an experiment."""
    rows, runs = experiment.rows, begun(experiment.rows)
    table = make_table(rows, title=experiment.name)
    groups = [group for group in experiment.cases() if not cases or group[0]["task.name"] in cases]
    turnable = set(range(len(groups)))
    if not cases:
        turnable = set(np.unique(np.linspace(0, len(groups) - 1, TURNABLE).astype(int)).tolist())
    shown = []
    for i, group in enumerate(groups):
        progress(experiment.name, i, len(groups), group[0]["task.name"])
        shown.append(show_case(experiment, group, **camera, turnable=i in turnable))
    progress(experiment.name, len(groups), len(groups))
    return {
        "name": experiment.name,
        "table": table,
        "slug": re.sub(r"[^a-z0-9]+", "-", experiment.name.lower()),
        "chart": svg_uri(figure) if (figure := chart_of(rows)) else "",
        "cases": shown,
        "columns": [column for column in table.columns if column.source != SUCCESS],
        "failures": records(rows.drop(valid(rows).index)),
        "configurations": [(method, configuration(runs, method)) for method in method_names(runs)],
        "facts": facts(runs),
    }


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("rows", nargs="*", type=Path, help=f"{ROWS_HELP} (default: every CSV there)")
    add_out(parser, Path("out/report.html"), "page to write")
    runs = "folders of the run folders (default: out/runs/<experiment>)"
    parser.add_argument("--runs", nargs="+", type=Path, default=[], metavar="FOLDER", help=runs)
    cases = "task names to show in pictures and in 3D (default: pictures of all, three in 3D)"
    parser.add_argument("--cases", nargs="+", default=[], metavar="TASK", help=cases)
    add_camera(parser)


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    import jinja2  # noqa: F401 - refused before the rows are read
    import matplotlib  # noqa: F401
    import pyvista  # noqa: F401

    experiments = read_experiments(options.rows, runs=options.runs)
    with progress_bar() as progress:
        text = write_page(experiments, cases=options.cases, **camera(options), progress=progress)
    write_text(options.out, text)
    print(f"{options.out}: {len(text) / 1e6:.1f} MB; open it in a browser")  # noqa: T201
    return 0
