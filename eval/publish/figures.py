"""The comparison picture: ``sshade-eval figures [EXPERIMENT]``, needs the extra ``figures``.

One row a case: the rest shape with its handles (blue: static, yellow: dynamic),
then each method's result, coloured by how much the edges at a vertex changed
their length, on one scale. Pose transfers are drawn by :mod:`eval.publish.transfer_figures`.
Made from run folders; no method is run.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eval.metrics.truth import Task
from eval.publish import transfer_figures
from eval.publish.plotting import new_figure, save
from eval.rows.recall import load_task
from eval.rows.store import FOLDER_HELP, VALID, Row, experiment_folder, read_row, read_vertices, run_folders
from sshade.errors import InputError
from sshade.figures import COLOURS, TOWARDS, UP, View, colour_range, edge_error, picture, require_extra
from sshade.pipeline.transfer_task import TransferTask


@dataclass(frozen=True)
class Case:
    """A task and the vertices that each method left for it."""

    task: Task
    results: dict[str, np.ndarray]


def read_cases(folder: Path, *, names: list[str], methods: list[str], worst: str | None = None) -> list[Case]:
    """Read tasks and results from the run folders of an experiment.

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
    found: dict[str, dict[str, tuple[Row, Path]]] = {}
    for run in run_folders(folder):
        row = read_row(run)
        if row is None or row["status"] not in VALID:
            continue
        of_task = found.setdefault(row["task.name"], {})
        if row["method.name"] not in of_task or row["date"] > of_task[row["method.name"]][0]["date"]:
            of_task[row["method.name"]] = row, run
    if not found:
        raise InputError(f"{folder}: no runs with a result there")
    missing = [name for name in names if name not in found]
    if missing:
        raise InputError(f"{folder}: no case {missing[0]!r}; there are {', '.join(sorted(found))}")
    if worst and not names:
        names = [_worst_case(found, methods, metric=worst)]
    if not names:
        known = sorted(found)
        names = [known[i] for i in np.unique(np.linspace(0, len(known) - 1, 3).astype(int))]
    cases = []
    for name in names:
        runs = found[name]
        shown = methods or sorted(runs, key=lambda method: (method.startswith("sshade"), method))
        absent = [method for method in shown if method not in runs]
        if absent:
            raise InputError(f"{folder}: case {name!r} has no result of {absent[0]!r}")
        task = load_task(next(iter(runs.values()))[0])
        chosen = {method: runs[method] for method in shown}
        cases.append(
            Case(
                task,
                {name: read_vertices(run, n=row["task.vertices"]) for name, (row, run) in chosen.items()},
            )
        )
    return cases


def _worst_case(found: dict[str, dict[str, tuple[Row, Path]]], methods: list[str], *, metric: str) -> str:
    """The case with the largest value of a metric."""
    values = {
        name: [row[f"metric.{metric}"] for method, (row, _) in runs.items() if method in (methods or runs)]
        for name, runs in found.items()
        if all(row.get(f"metric.{metric}") is not None for row, _ in runs.values())
    }
    if not any(values.values()):
        raise InputError(f"no case has the metric {metric!r}")
    return max(values, key=lambda name: max(values[name], default=-np.inf))


def draw(cases: list[Case], path: Path, *, title: str, towards: np.ndarray, up: np.ndarray) -> None:
    """Draw the comparison.

    Parameters
    ----------
    cases : list of Case
    path : path
        A .png, .pdf or .svg file.
    title : str
    towards, up : (3,) float64
        From the scene to the camera, and the upright direction.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    errors = [[edge_error(case.task.mesh, V) for V in case.results.values()] for case in cases]
    scale = Normalize(0, colour_range(error for row in errors for error in row))
    views = [view_of(case, towards=towards, up=up) for case in cases]
    columns = 1 + max(len(case.results) for case in cases)
    heights = [view.height / view.width for view in views]
    figure = new_figure(2.2 * columns + 0.9, 2.2 * sum(heights) + 0.8)
    axes = figure.subplots(len(cases), columns, squeeze=False, height_ratios=heights)
    for case, view, values, panels in zip(cases, views, errors, axes, strict=True):
        for panel in panels:
            panel.set_axis_off()
        mesh = case.task.mesh
        panels[0].imshow(picture(mesh, mesh.V, view=view, handles=case.task.handles))
        panels[0].set_title("rest", fontsize=9)
        panels[0].text(
            -0.03,
            0.5,
            case.task.name,
            rotation=90,
            transform=panels[0].transAxes,
            ha="right",
            va="center",
            fontsize=8,
        )
        for panel, (method, V), error in zip(panels[1:], case.results.items(), values, strict=False):
            panel.imshow(picture(mesh, V, view=view, error=error, top=scale.vmax))
            panel.set_title(f"{method} (mean {error.mean():.1f} %)", fontsize=9)
    bar = figure.colorbar(ScalarMappable(scale, COLOURS), ax=axes, shrink=0.6, extend="max", pad=0.01)
    bar.set_label("change of edge length at a vertex (%)", fontsize=9)
    bar.ax.tick_params(labelsize=8)
    figure.suptitle(f"{title}  (handles: blue static, yellow dynamic)", fontsize=11)
    save(figure, path)


def view_of(case: Case, *, towards: np.ndarray = TOWARDS, up: np.ndarray = UP) -> View:
    """The view of a case in which its rest shape and every result fit."""
    return View.of([case.task.mesh.V, *case.results.values()], towards=towards, up=up)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("folder", nargs="?", type=Path, default=Path("quick"), help=FOLDER_HELP)
    parser.add_argument("--cases", nargs="+", default=[], help="task names (default: three of them)")
    parser.add_argument("--methods", nargs="+", default=[], help="method names (default: all)")
    parser.add_argument("--worst", metavar="METRIC", help="the one case where this metric is largest")
    parser.add_argument("--towards", nargs=3, type=float, default=TOWARDS, metavar=("X", "Y", "Z"))
    parser.add_argument("--up", nargs=3, type=float, default=UP, metavar=("X", "Y", "Z"))
    parser.add_argument("-o", "--out", type=Path, help="default: out/figures/<experiment>.png")


def command(options: argparse.Namespace) -> int:
    """Do it; return the exit code."""
    require_extra()
    folder = experiment_folder(options.folder)
    cases = read_cases(folder, names=options.cases, methods=options.methods, worst=options.worst)
    path = options.out or Path("out/figures") / f"{folder.name}.png"
    camera = {"towards": np.array(options.towards), "up": np.array(options.up)}
    if all(isinstance(case.task, TransferTask) for case in cases):
        transfer_figures.draw(
            [(case.task, case.results) for case in cases], path, title=folder.name, **camera
        )
    else:
        draw(cases, path, title=folder.name, **camera)
    print(path)  # noqa: T201
    return 0
