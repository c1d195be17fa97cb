"""``sshade-eval report``: the results of experiments on one HTML page that needs no network.

The page begins with a headline table and pictures. It has all numbers, time against truth, configurations and
failures from rows. If the run folders exist, it also has pictures of every case and a 3D view.
"""

from __future__ import annotations

import argparse
import base64
import html
import io
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from eval.metrics import Task
from eval.publish.columns import HEADLINE, Column, begun
from eval.publish.comparison import compare, means
from eval.publish.figures import camera_of, chart_of
from eval.publish.notes import definitions, legend
from eval.publish.panels import Case, error_label, error_of, picture_of, row_of, task_title, what_to_see
from eval.publish.plotting import to_svg
from eval.publish.summary import Table, by_half, make_table, ranks
from eval.publish.tables import TIE, printed
from eval.rows.collect import Experiment, read_experiments
from eval.rows.files import ROWS_HELP, add_out, write_text
from eval.rows.frame import distinct, method_names, of_methods, records, valid
from eval.rows.store import Row
from eval.run.config import load_task
from sshade import plotting
from sshade.core.console import progress_bar
from sshade.core.errors import InputError, counted
from sshade.core.progress import Progress
from sshade.plotting import threejs
from sshade.plotting.pictures import PERCENTILE, colour_range
from sshade.plotting.view import ViewShape, packed_view
from sshade.problem.task import DeformationTask

#: Default number of cases of an experiment in the 3D view.
TURNABLE = 3
#: Columns of the table of failures.
FAILURE = ("method.name", "task.name", "seed", "status", "reason")
#: Pixels on the page of the bounding-box diagonal of a rest shape: all pictures have one scale.
DIAGONAL = 280


@dataclass
class ReportCase:
    """A section of the report.

    Parameters
    ----------
    rows : list of rows
        One row per method.
    task : Task, optional
        None without stored vertices.
    missing : list of str
        Sentences on parts that cannot be shown.
    pictures : list of dict
        Name, caption and images (data URIs) of each shape: plain, and in colours.
    width : int
        Width of the pictures in pixels.
    top : float
        Upper end of the colour scale.
    view : dict, optional
        Data of the 3D view.
    """

    rows: list[Row]
    task: Task | None = None
    missing: list[str] = field(default_factory=list)
    pictures: list[dict[str, Any]] = field(default_factory=list)
    width: int = 0
    top: float = 1.0
    view: dict[str, Any] | None = None

    def table(self, columns: Iterable[Column]) -> tuple[list[str], list[list[str]]]:
        """Return the headings and the lines of a table of the methods."""
        chosen = list(columns)
        body = [
            [
                row["method.name"],
                *("n/a" if row[c.source] is None else c.text(row[c.source]) for c in chosen),
            ]
            for row in self.rows
        ]
        return ["method", *(column.label for column in chosen)], body

    @property
    def title(self) -> str:
        """The case in words."""
        return self.rows[0]["task.name"] if self.task is None else task_title(self.task)


def stored_case(experiment: Experiment, rows: list[Row]) -> tuple[Case | None, list[str]]:
    """Return a case with its stored results, None where there are none, and sentences on what is missing."""
    found: dict[str, np.ndarray | str] = {
        row["method.name"]: V for row in rows if (V := experiment.vertices(row)) is not None
    }
    missing = []
    if absent := [row["method.name"] for row in rows if row["method.name"] not in found]:
        missing.append(f"No stored vertices of {', '.join(absent)} in {experiment.runs}: only the numbers.")
    if not found:
        return None, missing
    try:
        task = load_task(next(row for row in rows if row["method.name"] in found))
    except (InputError, OSError, ImportError) as error:
        return None, [*missing, f"No pictures: {error}."]
    return Case(task, found, {row["method.name"]: row for row in rows}), missing


def scales_of(cases: Iterable[Case]) -> dict[str, float]:
    """Return the upper end of the common colour scale of each kind of error, by its label."""
    high: dict[str, list[np.ndarray]] = {}
    for case in cases:
        errors = (error_of(case.task, np.asarray(V)) for V in case.results.values())
        # One number of each shape is enough, and a report may have hundreds of large shapes.
        high.setdefault(error_label(case.task), []).extend(np.percentile(e, [PERCENTILE]) for e in errors)
    return {label: colour_range(own) for label, own in high.items()}


def show_case(
    experiment: Experiment,
    rows: list[Row],
    *,
    scales: dict[str, float],
    turnable: bool,
) -> ReportCase:
    """Render a case from its stored runs.

    Parameters
    ----------
    experiment : Experiment
    rows : list of rows
        Rows of the case, one per method.
    scales : dict
        See :func:`scales_of`.
    turnable : bool
        Pack the shapes for the 3D view as well.
    """
    case, missing = stored_case(experiment, rows)
    shown = ReportCase(rows, missing=missing)
    if case is None:
        return shown
    shown.task = task = case.task
    camera = camera_of(experiment.name)
    row = row_of(case, camera)
    shown.width, shown.top = round(DIAGONAL * row.width), scales[error_label(task)]
    try:
        for panel in row.panels:
            looks = [panel._replace(error=None), panel] if panel.error is not None else [panel]
            images = [
                image_uri(picture_of(one, row.mesh, width=2 * shown.width, top=shown.top)) for one in looks
            ]
            shown.pictures.append({"name": panel.name, "caption": panel.caption, "images": images})
    except InputError as error:  # the system cannot draw
        shown.missing.append(f"No pictures: {error}.")
    if turnable:
        shapes = [ViewShape(p.name, p.caption, np.asarray(p.shape), p.error) for p in row.panels]
        handles = task.handles if isinstance(task, DeformationTask) else None
        view = packed_view(
            task.mesh, shapes, handles=handles, top=shown.top, label=error_label(task), camera=camera
        )
        shown.view = view | {"name": task.name, "first": row.nearest}
        shown.view |= {"beside": "rest" if task.truth is None else "true pose"}
    return shown


def image_uri(pixels: np.ndarray) -> str:
    """Return an image, (h, w, 3) uint8, as a data URI."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "WEBP", quality=82, method=4)
    return f"data:image/webp;base64,{base64.b64encode(file.getvalue()).decode('ascii')}"


def svg_uri(figure: Any) -> str:
    """Return a figure as a data URI."""
    return f"data:image/svg+xml;base64,{base64.b64encode(to_svg(figure).encode()).decode('ascii')}"


def headline(table: Table, rows: pd.DataFrame) -> dict[str, Any] | None:
    """Return a table for a first look, in HTML, with a sentence and a note; None without a result.

    Bold are the methods that share the first rank of the whole table.
    """
    first = next(iter(by_half(rows).values()))
    comparison = compare(first, HEADLINE)
    of_methods = means(comparison.values, "method.name").reindex(comparison.ranked)
    found = of_methods.dropna(axis="columns", how="all")
    if found.empty:
        return None
    columns = {column.heading: column for column in HEADLINE if column.heading in found}
    best = {name: [m for m, place in ranks(table, name).items() if place == 1] for name in table.places}

    def cell(method: str, name: str) -> str:
        mean = found.at[method, name]
        text = "n/a" if np.isnan(mean) else columns[name].text(mean)
        return f"<b>{text}</b>" if method in best.get(name, []) else text

    sentence = ""
    for words, name in (("Smallest mean distance to the true pose", "truth"), ("Shortest mean time", "time")):
        if name in found and len(found) > 1:
            least = found[name].idxmin()
            sentence += (
                f" {words}: {least} ({columns[name].text(found.at[least, name])} {columns[name].unit})"
            )
            if name == "truth" and best.get(name) != [least]:
                others = [method for method in best.get(name, []) if method != least]
                sentence += f"; the cases cannot tell it from {', '.join(others) or 'the other methods'}"
            sentence += "."
    note = f"Means over {counted(len(comparison.common), 'case', 'cases')}."
    note += " Bold: the first rank of all measures below." if any(best.values()) else ""
    note += " crossings: new self-intersections." if "crossings" in found else ""
    note += " truth: distance to the true pose, % of the bounding-box diagonal." if "truth" in found else ""
    note += " EL: change of edge length, % of the longest edge. time: of these runs"
    at_once = max(distinct(first, "env.jobs"), default=1)
    return {
        "labels": ["method", *(column.label for column in columns.values())],
        "body": [[html.escape(method), *(cell(method, name) for name in columns)] for method in found.index],
        "sentence": sentence.strip(),
        "note": note + (f", {at_once} at once." if at_once > 1 else "."),
    }


def write_page(
    experiments: list[Experiment],
    *,
    cases: list[str],
    progress: Progress,
) -> str:
    """Return the page as HTML text.

    Parameters
    ----------
    experiments : list of Experiment
    cases : list of str
        Names of tasks to show. If empty: pictures of every case, and three cases of each experiment in 3D.
    progress : Progress

    Raises
    ------
    InputError
        If no experiment has a named case, or the rows of an experiment make no table.
    """
    every = pd.concat([of_methods(experiment.rows) for experiment in experiments], ignore_index=True)
    known = set(every["task.name"])
    unknown = [name for name in cases if name not in known]
    if unknown:
        raise InputError(f"there is no case {unknown[0]!r}; there are {', '.join(sorted(known))}")
    chosen = [(experiment, group) for experiment in experiments for group in experiment.cases(cases)]
    stored = (stored_case(*pair)[0] for pair in chosen)
    scales = scales_of(filter(None, stored))
    sections = [_section(each, cases=cases, scales=scales, progress=progress) for each in experiments]
    views = [
        case.view | {"title": f"{section['name']}: {case.title}", "id": f"{section['slug']}-case-{i}"}
        for section in sections
        for i, case in enumerate(section["cases"])
        if case.view is not None
    ]
    return _render(
        sections=sections,
        data=[view.pop("data") for view in views],
        views=views,
        ramp=plotting.COLOURS,
        three=threejs.source(),
        viewer=plotting.part("viewer.js"),
        view_markup=plotting.part("view.html"),
        view_style=plotting.style(),
        valid=len(valid(every)),
        runs=len(every),
    )


def _render(**names: Any) -> str:
    """Return the page from its template. All text is escaped; undefined names are refused."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    pages = Environment(
        loader=PackageLoader("eval", "publish"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    marks = {0: "{}", 1: '<b title="best">{}</b>', 2: '<u title="second best">{}</u>'}
    marks[TIE] = '<i title="may be zero">{}</i>'
    pages.globals["printed"] = partial(printed, marks=marks, not_available="n/a", escape=html.escape)
    pages.globals |= {"legend": legend, "definitions": definitions}
    pages.globals["what_to_see"] = what_to_see
    return pages.get_template("report.html").render(**names)


def _section(
    experiment: Experiment,
    *,
    cases: list[str],
    scales: dict[str, float],
    progress: Progress,
) -> dict[str, Any]:
    """Return the contents of the section of an experiment."""
    rows = experiment.rows
    runs = begun(of_methods(rows))
    table = make_table(rows, title=experiment.name)
    groups = list(experiment.cases(cases))
    turnable = len(groups) if cases else TURNABLE
    shown = []
    for i, group in enumerate(groups):
        progress(experiment.name, i, len(groups), group[0]["task.name"])
        shown.append(show_case(experiment, group, scales=scales, turnable=i < turnable))
    progress(experiment.name, len(groups), len(groups))
    return {
        "name": experiment.name,
        "headline": headline(table, rows),
        "table": table,
        "slug": re.sub(r"[^a-z0-9]+", "-", experiment.name.lower()),
        "chart": svg_uri(figure) if (figure := chart_of(rows)) else "",
        "cases": shown,
        "scales": {error_label(case.task): case for case in shown if case.task and case.pictures},
        "columns": [column for column in HEADLINE if column.source in rows],
        "failures": [[row[name] for name in FAILURE] for row in records(rows.drop(valid(rows).index))],
        "configurations": [(method, configuration(runs, method)) for method in method_names(runs)],
        "facts": facts(runs),
    }


def configuration(rows: pd.DataFrame, method: str) -> str:
    """Return the settings of a method, one a line, with all values of a setting that differs by the case."""
    own = rows[rows["method.name"] == method]
    names = [name for name in own if name.startswith("method.") and own[name].notna().any()]
    facts = [f"method.{fact}" for fact in ("name", "note")]
    found = {name: own[name].dropna().unique() for name in names if name not in facts}
    return "\n".join(f"{name} = {' or '.join(map(str, values))}" for name, values in found.items())


def facts(rows: pd.DataFrame) -> list[tuple[str, str]]:
    """Return when and where the rows were made; several values are listed."""
    names = [name for name in rows if name.startswith("env.") and name != "env.cores_used"]
    found = [(name.removeprefix("env."), ", ".join(map(str, distinct(rows, name)))) for name in names]
    days = sorted({date[:10] for date in distinct(rows, "date")})
    return [("dates", " to ".join(dict.fromkeys(days[:1] + days[-1:]))), *(fact for fact in found if fact[1])]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("rows", nargs="*", type=Path, help=f"{ROWS_HELP} (default: every CSV there)")
    add_out(parser, Path("out/report.html"), "page to write")
    cases = "task names to show in pictures and in 3D (default: pictures of all, three in 3D)"
    parser.add_argument("--cases", nargs="+", default=[], metavar="TASK", help=cases)


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    import jinja2  # noqa: F401 - refused before the rows are read
    import matplotlib  # noqa: F401
    import pyvista  # noqa: F401

    experiments = read_experiments(options.rows)
    with progress_bar() as progress:
        text = write_page(experiments, cases=options.cases, progress=progress)
    write_text(options.out, text)
    print(f"{options.out}: {len(text) / 1e6:.1f} MB; open it in a browser")  # noqa: T201
    return 0
