"""Charts of an experiment: ``sshade-eval charts [ROWS ...]``, needs the extra ``figures``.

The distribution of each metric over the runs of each method, and the convergence curves of iterative methods,
from rows and run folders. Each chart is a file out/figures/<experiment>/<chart>.svg.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from eval.metrics import METRICS
from eval.publish.columns import reference_rows
from eval.publish.notes import warn_of_versions
from eval.publish.plotting import FIGURES, SUFFIXES, axis_label, look, new_figure, save, style
from eval.rows.experiment import Experiment, read_experiments
from eval.rows.files import ROWS_HELP, add_out
from eval.rows.frame import method_names, numbers, records, split_label, valid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Ratio of the largest to the smallest value above which an axis is logarithmic.
LOG_ABOVE = 30.0
#: Largest number of powers of ten on a logarithmic axis; smaller values are rounding errors.
DECADES = 6
#: Width of a chart in inches: a column of a paper.
WIDTH = 4.4
#: Form and lines of a box.
BOX: dict[str, Any] = {
    **{"orientation": "horizontal", "widths": 0.62, "showfliers": False, "manage_ticks": False},
    **dict.fromkeys(("boxprops", "whiskerprops", "capprops"), {"color": "#999999", "linewidth": 0.8}),
    "medianprops": {"color": "#222222", "linewidth": 1.2},
}


def charts(experiment: Experiment) -> dict[str, Figure]:
    """Return all charts by name."""
    return {**distributions(experiment.rows), **convergence(experiment)}


def distributions(rows: pd.DataFrame) -> dict[str, Figure]:
    """Return a chart for each metric, and for memory, whose values differ between runs.

    A dot is a run. The box spans the quartiles, its line is the median, and the whiskers end at the last
    runs within 1.5 lengths of the box from its ends. References are left out.
    """
    rows = rows[~reference_rows(rows)]
    measures = {f"metric.{name}": (name, metric.unit) for name, metric in METRICS.items()}
    measures["peak_mib"] = ("memory", "MiB")
    results = valid(rows)
    found = {}
    for column, (name, unit) in measures.items():
        values = numbers(results, column).dropna()
        if values.nunique() > 1:
            runs = values.groupby(results["method.name"])
            shown = [method for method in method_names(rows) if method in runs.groups]
            of_method = {method: runs.get_group(method).to_numpy() for method in shown}
            found[name] = _distribution(of_method, label=axis_label(name, unit), looks=_looks(rows))
    return found


@style()
def _distribution(values: dict[str, np.ndarray], *, label: str, looks: dict) -> Figure:
    figure = new_figure(WIDTH, 0.75 + 0.23 * len(values))
    axes = figure.subplots()
    places = np.arange(len(values))[::-1]
    axes.boxplot(list(values.values()), positions=places, **BOX)
    dots = {"s": 9, "alpha": 0.65, "linewidths": 0, "clip_on": False, "zorder": 3}
    for place, (method, runs) in zip(places, values.items(), strict=True):
        # The golden ratio spreads the dots evenly and reproducibly.
        spread = 0.44 * ((np.arange(len(runs)) * 0.618034) % 1 - 0.5)
        axes.scatter(runs, place + spread, **dots, **looks[method])
    axes.set_yticks(places, list(values))
    axes.set_ylim(-0.6, len(values) - 0.4)
    axes.set_title(label)
    _scale(axes, np.concatenate(list(values.values())))
    return figure


def _scale(axes: Axes, numbers: np.ndarray) -> None:
    """Choose a logarithmic axis for values over orders of magnitude, otherwise an axis from zero."""
    from matplotlib.ticker import LogLocator, NullFormatter

    seen = numbers[numbers > numbers.max() / 10**DECADES]
    wide = seen.max() > LOG_ABOVE * seen.min()
    if wide and len(seen) == len(numbers):
        axes.set_xscale("log")
        if seen.max() < 1000 * seen.min():  # one or two powers of ten are too few ticks
            axes.xaxis.set_major_locator(LogLocator(subs=(1, 3)))
            axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter(NullFormatter())
    else:
        if wide:
            axes.set_xscale("symlog", linthresh=10 ** float(np.floor(np.log10(seen.min()))))
        else:
            axes.locator_params(axis="x", nbins=6)
        axes.set_xlim(left=0)
    axes.grid(axis="x", alpha=0.3)


def _looks(rows: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """Return the colour and marker of each method.

    Methods share a look if their labels differ only in the number of vertices, such as arap-7000.
    """
    families = {}
    for method in method_names(rows):
        family, number = split_label(method)
        sizes = rows["task.vertices"][rows["method.name"] == method]
        is_size = number is not None and all(abs(size - number) < 0.5 * number for size in sizes)
        families[method] = family if is_size else method
    looks = look(dict.fromkeys(families.values()))
    return {method: looks[family] for method, family in families.items()}


def convergence(experiment: Experiment) -> dict[str, Figure]:
    """Return a chart for each curve of the runs, such as the loss over the steps, with one line per run."""
    lines: dict[str, list[tuple[str, np.ndarray]]] = {}
    for row in records(valid(experiment.rows)):
        for name, curve in experiment.curves(row).items():
            columns = curve.reshape(len(curve), -1).T
            for i, column in enumerate(columns):
                label = name if len(columns) == 1 else f"{name}_{i + 1}"
                lines.setdefault(label, []).append((row["method.name"], column))
    looks = _looks(experiment.rows)
    return {name: _curves(axis_label(name, ""), lines[name], looks=looks) for name in sorted(lines)}


@style()
def _curves(title: str, lines: list[tuple[str, np.ndarray]], *, looks: dict) -> Figure:
    methods = len({method for method, _ in lines})
    figure = new_figure(WIDTH, 2.6 + 0.16 * ((methods + 2) // 3))  # with a legend in three columns below
    axes = figure.subplots()
    axes.grid(alpha=0.3)
    seen: set[str] = set()
    for method, values in lines:
        label = None if method in seen else method
        seen.add(method)
        steps = np.arange(1, len(values) + 1)
        axes.plot(steps, values, color=looks[method]["color"], linewidth=0.9, alpha=0.8, label=label)
    if all((values > 0).all() for _, values in lines):
        axes.set_yscale("log")
    axes.set(xlabel="step", title=title)
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("rows", nargs="*", type=Path, help=f"{ROWS_HELP} (default: every CSV there)")
    formats = [suffix[1:] for suffix in SUFFIXES]
    text = "format of the charts (default: svg)"
    parser.add_argument("--format", choices=formats, default="svg", help=text)
    add_out(parser, FIGURES, "folder of the charts")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    for experiment in read_experiments(options.rows):
        warn_of_versions(experiment.rows)
        for name, figure in charts(experiment).items():
            save(figure, options.out / experiment.name / f"{name}.{options.format}")
    return 0
