"""The report's page: what stands in it, and the template that it is made by."""

from __future__ import annotations

import base64
import re
from importlib.resources import files
from typing import Any

import numpy as np
import pandas as pd

from eval.publish.charts import convergence, distributions
from eval.publish.columns import SUCCESS, Column, begun
from eval.publish.html import charts, configuration, environment, facts, style, views
from eval.publish.report.cases import Case, show_case
from eval.publish.summary import make_table
from eval.rows.experiment import Experiment
from eval.rows.frame import method_names, numbers, records, valid
from sshade import threejs
from sshade.errors import InputError
from sshade.figures import COLOURS
from sshade.progress import Progress, silent

#: Cases of an experiment in the 3D view, unless they are named.
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
    """The page as HTML text.

    Parameters
    ----------
    experiments : list of Experiment
    cases : list of str
        Names of tasks to show; empty: every case in pictures, and of each
        experiment three in the 3D view.
    mixed : bool
        Accept rows of several versions of the code, with a warning.
    towards, up : (3,) float64
        From the scene to the camera, and the upright direction.
    progress : Progress

    Raises
    ------
    InputError
        When no experiment has such a case, or the rows of one make no table.
    """
    every = pd.concat([experiment.rows for experiment in experiments], ignore_index=True)
    known = set(every["task.name"])
    unknown = [name for name in cases if name not in known]
    if unknown:
        raise InputError(f"there is no case {unknown[0]!r}; there are {', '.join(sorted(known))}")
    sections = [
        _section(experiment, cases=cases, mixed=mixed, towards=towards, up=up, progress=progress)
        for experiment in experiments
    ]
    views = [
        case.view | {"experiment": section["name"], "id": f"{section['slug']}-case-{i}"}
        for section in sections
        for i, case in enumerate(section["cases"])
        if case.view is not None
    ]
    return _template().render(
        sections=sections,
        views=[{name: value for name, value in view.items() if name != "data"} for view in views],
        data=[view["data"] for view in views],
        camera={"towards": list(towards), "up": list(up)},
        ramp=_ramp(),
        style=style(),
        script=_text("viewer.js"),
        three=threejs.source(),
        valid=len(valid(every)),
        runs=len(every),
    )


def _section(
    experiment: Experiment,
    *,
    cases: list[str],
    mixed: bool,
    towards: np.ndarray,
    up: np.ndarray,
    progress: Progress,
) -> dict[str, Any]:
    """An experiment as the template needs it."""
    rows, made = experiment.rows, begun(experiment.rows)
    table = make_table(rows, title=experiment.name, mixed=mixed)
    groups = [group for group in experiment.cases() if not cases or group[0]["task.name"] in cases]
    turnable = set(range(len(groups)))
    if not cases:
        turnable = set(np.unique(np.linspace(0, len(groups) - 1, TURNABLE).astype(int)).tolist())
    shown = []
    for i, group in enumerate(groups):
        progress(experiment.name, i, len(groups), group[0]["task.name"])
        shown.append(show_case(experiment, group, towards=towards, up=up, turnable=i in turnable))
    progress(experiment.name, len(groups), len(groups))
    measured = [column for column in table.columns if column.source != SUCCESS]
    slug = re.sub(r"[^a-z0-9]+", "-", experiment.name.lower())
    return {
        "name": experiment.name,
        "slug": slug,
        "views": views(table),
        "notes": table.notes,
        "parts": [{"title": part.title, "views": views(part), "notes": part.notes} for part in table.parts],
        "charts": charts(distributions(rows)),
        "curves": charts(convergence(experiment)),
        "convergence": _convergence(experiment),
        "cases": shown,
        "numbers": [_numbers(case, measured) for case in shown],
        "measures": [column.label for column in measured],
        "failures": records(rows.drop(valid(rows).index)),
        "configurations": [(method, configuration(made, method)) for method in method_names(made)],
        "facts": facts(made),
    }


def _numbers(case: Case, columns: list[Column]) -> list[list[str]]:
    """A case's numbers, method by method."""
    body = []
    for row in case.rows:
        values = [row.get(column.source) for column in columns]
        texts = ["n/a" if v is None else c.text(v) for c, v in zip(columns, values, strict=True)]
        body.append([row["method.name"], *texts])
    return body


def _convergence(experiment: Experiment) -> list[list[str]]:
    """Headings, then a line an iterating method: runs converged, iterations, residuals, energies.

    Columns without a number are left out.
    """
    lines = [["method", "converged", "iterations", "last residual", "energy"]]
    rows = valid(experiment.rows)
    rows = rows[numbers(rows, "iterations") > 0]
    for method in method_names(rows):
        own = rows[rows["method.name"] == method]
        rule = own["converged"].dropna()
        share = f"{int(rule.sum())}/{len(rule)}" if len(rule) else "no rule"
        facts = [_range(numbers(own, f"extra.{name}"), "{:.3g}") for name in ("residual", "energy")]
        lines.append([method, share, _range(numbers(own, "iterations"), "{:,.0f}"), *facts])
    kept = [i for i in range(len(lines[0])) if any(line[i] != "-" for line in lines[1:])]
    return [[line[i] for i in kept] for line in lines]


def _range(values: pd.Series, form: str) -> str:
    """Smallest, median and largest of numbers."""
    return " / ".join(map(form.format, values.quantile([0, 0.5, 1]))) if values.notna().any() else "-"


def _ramp() -> str:
    """256 colours of errors, three bytes each, as base64."""
    import matplotlib

    colours = matplotlib.colormaps[COLOURS](np.arange(256), bytes=True)[:, :3]
    return base64.b64encode(colours.tobytes()).decode("ascii")


def _text(name: str) -> str:
    return files("eval.publish.report").joinpath(name).read_text(encoding="utf-8")


def _template() -> Any:
    return environment().from_string(_text("page.html"))
