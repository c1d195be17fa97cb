"""The page of a report: its contents, and its template."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pandas as pd

from eval.publish.charts import convergence, distributions
from eval.publish.columns import SUCCESS, begun
from eval.publish.html import charts, configuration, facts, render
from eval.publish.report.cases import show_case
from eval.publish.summary import converged_runs, make_table
from eval.rows.experiment import Experiment
from eval.rows.frame import method_names, numbers, records, valid
from sshade import plotting, threejs
from sshade.errors import InputError
from sshade.progress import Progress, silent

#: Default number of cases of an experiment in the 3D view.
TURNABLE = 3


def write_page(
    experiments: list[Experiment],
    *,
    cases: list[str],
    mixed: bool = False,
    towards: np.ndarray,
    up: np.ndarray,
    progress: Progress = silent,
) -> str:
    """Return the page as HTML text.

    Parameters
    ----------
    experiments : list of Experiment
    cases : list of str
        Names of tasks to show. If empty: pictures of every case, and three cases of each experiment in 3D.
    mixed : bool
        Accept rows of several versions of the code, with a warning.
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
    camera = {"towards": towards, "up": up}
    form = {"cases": cases, "mixed": mixed, "camera": camera, "progress": progress}
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
        camera={name: list(direction) for name, direction in camera.items()},
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
    mixed: bool,
    camera: dict[str, np.ndarray],
    progress: Progress,
) -> dict[str, Any]:
    """Return the contents of the section of an experiment."""
    rows, runs = experiment.rows, begun(experiment.rows)
    table = make_table(rows, title=experiment.name, mixed=mixed)
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
        "charts": charts(distributions(rows)),
        "curves": charts(convergence(experiment)),
        "convergence": _convergence(experiment),
        "cases": shown,
        "columns": [column for column in table.columns if column.source != SUCCESS],
        "failures": records(rows.drop(valid(rows).index)),
        "configurations": [(method, configuration(runs, method)) for method in method_names(runs)],
        "facts": facts(runs),
    }


def _convergence(experiment: Experiment) -> list[list[str]]:
    """Return headings and one line per iterative method; columns without a number are left out."""
    lines = [["method", "converged", "iterations", "last residual", "energy"]]
    rows = valid(experiment.rows)
    rows = rows[numbers(rows, "iterations") > 0]
    for method in method_names(rows):
        own = rows[rows["method.name"] == method]
        ranges = [_range(numbers(own, f"extra.{name}"), "{:.3g}") for name in ("residual", "energy")]
        iterations = _range(numbers(own, "iterations"), "{:,.0f}")
        lines.append([method, converged_runs(own["converged"]), iterations, *ranges])
    kept = [i for i in range(len(lines[0])) if any(line[i] != "-" for line in lines[1:])]
    return [[line[i] for i in kept] for line in lines]


def _range(values: pd.Series, form: str) -> str:
    """Return the smallest, median and largest number."""
    return " / ".join(map(form.format, values.quantile([0, 0.5, 1]))) if values.notna().any() else "-"
