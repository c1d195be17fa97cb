"""Charts of an experiment: ``sshade-eval charts [ROWS ...]``, needs the extra ``figures``.

For each metric how it is distributed over the runs of each method, the time
against the number of vertices, and the curves that iterative methods left. Made
from rows and run folders; no method is run. One file a chart, for a paper:
out/figures/<experiment>/<chart>.svg.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eval.metrics.metrics import METRICS
from eval.publish.columns import is_reference
from eval.publish.plotting import SUFFIXES, look, new_figure, save, style
from eval.publish.summary import check_times, method_names
from eval.rows.experiment import Experiment, read_experiments
from eval.rows.store import ROWS_HELP, VALID, Row
from sshade.errors import InputError
from sshade.figures import require_extra

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: A chart whose values span more than this factor has a logarithmic axis.
LOG_ABOVE = 30.0

#: Powers of ten that an axis shows at most: what is smaller is what rounding left of zero.
DECADES = 6

#: Width of a chart in inches: a column of a paper, and of a telephone.
WIDTH = 4.4


def charts(experiment: Experiment) -> dict[str, Figure]:
    """Every chart that the rows and runs have something for, by name."""
    return {**distributions(experiment.rows), **times(experiment.rows), **convergence(experiment)}


def distributions(rows: list[Row]) -> dict[str, Figure]:
    """A chart for each metric, and for time and memory, that is not the same in every run.

    Every run is a dot; the box spans the quartiles, its line is the median and
    its whiskers reach the last runs within 1.5 boxes. References are left out.
    """
    rows = _methods_alone(rows)
    measures = {f"metric.{name}": (name, metric.unit) for name, metric in METRICS.items()}
    measures |= {"seconds.total": ("time", "s"), "peak_mib": ("memory", "MiB")}
    if not _comparable(rows):
        del measures["seconds.total"]
    methods = method_names(rows)
    valid = [row for row in rows if row["status"] in VALID]
    found = {}
    for column, (name, unit) in measures.items():
        values = {
            method: np.array(
                [row[column] for row in valid if row["method.name"] == method and row.get(column) is not None]
            )
            for method in methods
        }
        values = {method: numbers for method, numbers in values.items() if len(numbers)}
        every = np.concatenate([*values.values(), []])
        if len(every) > 1 and np.ptp(every) > 0:
            title = name.replace("_", " ")
            label = title if unit in ("", "-") else f"{title} ({unit})"
            found[name] = _distribution(values, label=label, looks=_looks(rows))
    return found


def _distribution(values: dict[str, np.ndarray], *, label: str, looks: dict) -> Figure:
    with style():
        figure = new_figure(WIDTH, 0.75 + 0.23 * len(values))
        axes = figure.subplots()
        places = np.arange(len(values))[::-1]
        axes.boxplot(
            list(values.values()),
            positions=places,
            orientation="horizontal",
            widths=0.62,
            showfliers=False,
            manage_ticks=False,
            boxprops={"color": "#999999", "linewidth": 0.8},
            whiskerprops={"color": "#999999", "linewidth": 0.8},
            capprops={"color": "#999999", "linewidth": 0.8},
            medianprops={"color": "#222222", "linewidth": 1.2},
        )
        for place, (method, numbers) in zip(places, values.items(), strict=True):
            # Spread by the golden ratio: even, and the same every time.
            spread = 0.44 * ((np.arange(len(numbers)) * 0.618034) % 1 - 0.5)
            axes.scatter(
                numbers,
                place + spread,
                s=9,
                alpha=0.65,
                linewidths=0,
                clip_on=False,
                zorder=3,
                **looks[method],
            )
        axes.set_yticks(places, list(values))
        axes.set_ylim(-0.6, len(values) - 0.4)
        axes.set_title(label)
        _scale(axes, np.concatenate(list(values.values())))
    return figure


def _scale(axes: Axes, numbers: np.ndarray) -> None:
    """A logarithmic axis for what spans orders of magnitude, else one that begins at zero."""
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


def times(rows: list[Row]) -> dict[str, Figure]:
    """Time against vertices; none where times do not compare.

    A point is the mean over the runs of a method at a size, to two digits of it.
    References are left out.
    """
    rows = _methods_alone(rows)
    if not _comparable(rows):
        return {}
    points: dict[str, dict[str, list[tuple[float, float]]]] = {}
    for row in rows:
        if row["status"] in VALID and row["seconds.total"] > 0:
            name, size = _family(row["method.name"], rows), f"{row['task.vertices']:.1e}"
            run = row["task.vertices"], row["seconds.total"]
            points.setdefault(name, {}).setdefault(size, []).append(run)
    if not points:
        return {}
    with style():
        figure = new_figure(WIDTH, 2.6 + 0.16 * ((len(points) + 2) // 3))
        axes = figure.subplots()
        for method, look_of in _looks(rows).items():
            name = _family(method, rows)
            if name in points:
                means = sorted(tuple(np.mean(runs, axis=0)) for runs in points.pop(name).values())
                axes.plot(*zip(*means, strict=True), label=name, markersize=4, linewidth=1, **look_of)
        axes.set(xscale="log", yscale="log", xlabel="vertices", title="time (s) against vertices")
        low, high = axes.dataLim.intervalx
        if high < 3 * low:  # no power of ten would be seen
            axes.set_xlim(low / 2, high * 2)
            axes.set_xticks([low] if high < 1.1 * low else [low, high])
            axes.minorticks_off()
            axes.xaxis.set_major_formatter("{x:,.0f}")
        axes.grid(alpha=0.3)
        figure.legend(loc="outside lower center", ncols=3)
    return {"time_vertices": figure}


def _looks(rows: list[Row]) -> dict[str, dict[str, Any]]:
    """Colour and marker of each method; the sizes of one method share them."""
    families = {method: _family(method, rows) for method in method_names(rows)}
    looks = look(list(dict.fromkeys(families.values())))
    return {method: looks[family] for method, family in families.items()}


def _family(method: str, rows: list[Row]) -> str:
    """A method's name without a size that its label ends with, such as arap-7000 for 7000 vertices."""
    label = re.fullmatch(r"(.+)-(\d+)", method)
    if label is None:
        return method
    sizes = {row["task.vertices"] for row in rows if row["method.name"] == method}
    return label[1] if all(abs(size / int(label[2]) - 1) < 0.5 for size in sizes) else method


def convergence(experiment: Experiment) -> dict[str, Figure]:
    """A chart for each curve that runs left, such as a loss over the steps: a line a run."""
    lines: dict[str, list[tuple[str, np.ndarray]]] = {}
    for row in experiment.valid:
        for name, curve in experiment.curves(row).items():
            columns = curve.reshape(len(curve), -1).T
            for i, column in enumerate(columns):
                label = name if len(columns) == 1 else f"{name}_{i + 1}"
                lines.setdefault(label, []).append((row["method.name"], column))
    return {
        name: _curves(name.replace("_", " "), lines[name], looks=_looks(experiment.rows))
        for name in sorted(lines)
    }


def _curves(title: str, lines: list[tuple[str, np.ndarray]], *, looks: dict) -> Figure:
    with style():
        methods = list(dict.fromkeys(method for method, _ in lines))
        figure = new_figure(WIDTH, 2.6 + 0.16 * ((len(methods) + 2) // 3))
        axes = figure.subplots()
        seen: set[str] = set()
        for method, values in lines:
            label = None if method in seen else method
            seen.add(method)
            steps = np.arange(1, len(values) + 1)
            axes.plot(steps, values, color=looks[method]["color"], linewidth=0.9, alpha=0.8, label=label)
        if all((values > 0).all() for _, values in lines):
            axes.set_yscale("log")
        axes.set(xlabel="step", title=title)
        axes.grid(alpha=0.3)
        figure.legend(loc="outside lower center", ncols=3)
    return figure


def _methods_alone(rows: list[Row]) -> list[Row]:
    """Rows without references, which would take most of an axis."""
    return [row for row in rows if not is_reference(row)]


def _comparable(rows: list[Row]) -> bool:
    """Whether the rows' times may stand in one chart."""
    try:
        check_times(rows)
    except InputError:
        return False
    return True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("rows", nargs="*", type=Path, help=f"{ROWS_HELP} (default: every CSV there)")
    parser.add_argument("--format", choices=[suffix[1:] for suffix in SUFFIXES], default="svg")
    parser.add_argument("-o", "--out", type=Path, default=Path("out/figures"))


def command(options: argparse.Namespace) -> int:
    """Do it; return the exit code."""
    require_extra()
    for experiment in read_experiments(options.rows):
        for name, figure in charts(experiment).items():
            path = options.out / experiment.name / f"{name}.{options.format}"
            save(figure, path)
            print(path)  # noqa: T201
    return 0
