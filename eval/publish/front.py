"""Measures against each other: ``sshade-eval front ROWS [ROWS ...]``, needs the extra ``figures``.

By default volume against stretch. Methods that are labelled by the value of a setting, such as ``fine-0.1``,
form a curve; any other method is a point. Means are over the cases that all methods have. Tuning and held-out
cases have separate lines of panels. With ``--times speed``, the measures are drawn against the times of these
rows of ``sshade-eval bench``.
"""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from eval.metrics import METRICS
from eval.publish.notes import warn_of_versions
from eval.publish.plotting import FIGURES, axis_label, look, name_points, new_figure, plot_points, save, style
from eval.publish.summary import HALVES
from eval.rows.files import ROWS_HELP, TIMING, rows_file
from eval.rows.frame import distinct, numbers, read_csv, split_label, valid
from eval.rows.splits import TUNING, split_of
from sshade.core.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: The measure of rows with times: :func:`with_times`.
TIME = "time"
#: Labels of axes; other measures have their names.
LABELS = {
    TIME: "time (s)",
    "volume": "change of volume (%)",
    "edge": "change of edge lengths, EL (%)",
    "angle": "change of angles, FA (deg)",
    "truth_distance": "distance to the true pose (%)",
    "truth_normal": "angle to the true normals (deg)",
}
#: Default setting, and default measures: the first measure is the horizontal axis of all panels.
KNOB, MEASURES = "volume", ("volume", "edge", "angle")

#: Places of the values at the ends of curves, above and below by turns.
ENDS: list[dict[str, Any]] = [{"xytext": (0, 5), "va": "bottom"}, {"xytext": (0, -5), "va": "top"}]

#: The mean of each measure.
Point = tuple[float, ...]


def front(
    rows: pd.DataFrame,
    *,
    knob: str = KNOB,
    measures: tuple[str, ...] = MEASURES,
    leave_out: tuple[str, ...] = ("identity",),
) -> dict[str, list[Point]]:
    """Return the means of each method, in falling order of the first measure.

    Parameters
    ----------
    rows : DataFrame
        A method's curve has the rows named ``<method>-<value>`` with the value in ``method.<knob>``, and the
        rows named ``<method>``.
    knob : str
    measures : names of metrics
    leave_out : names of methods

    Returns
    -------
    dict
        Method -> points with a number for each measure.

    Raises
    ------
    InputError
        If no case has a valid row of every method.
    """
    curves = _means(rows, knob, measures, leave_out).groupby(level="family")
    return {family: list(own.itertuples(index=False, name=None)) for family, own in curves}


def knob_values(
    rows: pd.DataFrame, *, knob: str, measures: tuple[str, ...], leave_out: tuple[str, ...]
) -> dict[str, list[str]]:
    """Return the numbers in the labels of each method, in the order of the points of :func:`front`."""
    curves = _means(rows, knob, measures, leave_out).groupby(level="family")
    return {
        family: [name.removeprefix(family).removeprefix("-") for _, name in own.index]
        for family, own in curves
    }


def _means(
    rows: pd.DataFrame, knob: str, measures: tuple[str, ...], leave_out: tuple[str, ...]
) -> pd.DataFrame:
    """Return the means of the measures by family and method, in falling order; see :func:`front`."""
    columns = [f"metric.{name}" for name in measures]
    setting = f"method.{knob}"
    kept = ["method.name", setting, "task.name", "task.checksum", "seed", *columns]
    rows = valid(rows).reindex(columns=kept)
    pairs = zip(rows["method.name"], rows[setting], strict=True)
    rows = rows.assign(family=[_family(name, value) for name, value in pairs])
    rows = rows[~rows["family"].isin(leave_out) & rows[columns].notna().all(axis=1)]
    run = ["task.checksum", "seed", "family", "method.name"]
    values = rows.drop_duplicates(run, keep="last").set_index(run)[columns].astype(float)
    common = values.unstack(["family", "method.name"]).dropna()
    if common.empty:
        why = ""
        if rows.groupby("task.name")["task.checksum"].nunique().max() > 1:
            why = (
                "; their cases have the same names and other checksums: run all methods with one version of "
                "the program, on one build of the dataset"
            )
        raise InputError(f"the methods of these rows have no common case with {' and '.join(measures)}{why}")
    return common.mean().unstack(0)[columns].sort_values(columns, ascending=False)


def _family(name: str, value: Any) -> str:
    """Return the label of a method without the value of the setting."""
    family, number = split_label(name)
    try:
        return family if value is not None and number == float(value) else name
    except ValueError:
        return name


def with_times(rows: pd.DataFrame, times: pd.DataFrame) -> tuple[pd.DataFrame, str]:
    """Return the rows of timed methods, with the median time as a measure, and the machine of the times.

    A method was timed if there are times of its configuration, from the commit of its rows. Outside a
    checkout the version of the code takes the place of the commit.

    Raises
    ------
    InputError
        If the times come from several cases, machines or versions of the code, or no method was timed.
    """
    for column in ("task.checksum", "env.machine", "env.machine_id", "env.version.code"):
        if len(distinct(times, column)) > 1:
            raise InputError(f"the times differ in {column}, so one chart cannot show them")
    kept = times[times["kept"].eq(True)]
    seconds = numbers(kept, "seconds.total").groupby(kept["method.hash"]).median()
    version = "env.commit" if distinct(times, "env.commit") else "env.version.code"
    rows = rows[rows[version].isin(distinct(times, version))]
    rows = rows.assign(**{f"metric.{TIME}": rows["method.hash"].map(seconds)})
    timed = rows[rows[f"metric.{TIME}"].notna()]
    if timed.empty:
        raise InputError("no method was timed with the configuration and at the commit of these rows")
    return timed, distinct(times, "env.machine")[0]


@style()
def draw(
    points: dict[str | None, dict[str, list[Point]]],
    measures: tuple[str, ...] = MEASURES,
    *,
    values: Mapping[str | None, Mapping[str, list[str]]] | None = None,
    machine: str = "",
) -> Figure:
    """Draw a line of panels for each half of the cases, with a panel for each measure but the first.

    A legend names curves, and their ends have their `values`; points have their names beside them. `machine`
    stands below a time. A grey line is the front of quality against time.
    """
    from matplotlib.ticker import LogLocator, NullFormatter

    first, *others = measures
    single = []
    figure = new_figure(3.5 * len(others), 3.4 * len(points))
    lines = figure.subplots(len(points), len(others), squeeze=False)
    looks = look(dict.fromkeys(method for own in points.values() for method in own))
    for panels, (half, methods) in zip(lines, points.items(), strict=True):
        for i, (name, axes) in enumerate(zip(others, panels, strict=True), start=1):
            curves = {method: [(point[0], point[i]) for point in own] for method, own in methods.items()}
            plot_points(axes, curves, looks)
            lines_of = [method for method, own in curves.items() if len(own) > 1] if values else []
            for number, method in enumerate(lines_of):
                own, side = curves[method], ENDS[number % 2]
                for end in (0, -1):
                    axes.annotate(
                        values[half][method][end],
                        own[end],
                        textcoords="offset points",
                        color=looks[method]["color"],
                        ha="center",
                        fontsize=7,
                        in_layout=False,
                        **side,
                    )
            axes.set(xlabel=_label(first), ylabel=_label(name))
            axes.grid(alpha=0.3)
            axes.set_ylim(0, 1.1 * axes.get_ylim()[1])
            if first == TIME:
                stairs = unbeaten([point for curve in curves.values() for point in curve])
                axes.step(*zip(*stairs, strict=True), where="post", color="#bbbbbb", zorder=0, linewidth=1)
                axes.set(xscale="log", xlabel="\n".join([_label(first), *textwrap.wrap(machine, 46)]))
                axes.margins(x=0.15)
                axes.xaxis.set_major_locator(LogLocator(subs=(1, 3)))
                axes.xaxis.set_major_formatter("{x:g}")
                axes.xaxis.set_minor_formatter(NullFormatter())
            else:
                axes.set_xlim(left=-0.02 * axes.get_xlim()[1])
            if len(points) > 1:
                axes.set_title(HALVES[half])
            if all(len(curve) == 1 for curve in curves.values()):
                single.append((axes, curves))
        if not single:
            panels[-1].legend()
    for axes, curves in single:
        name_points(axes, curves, looks)
    return figure


def unbeaten(points: Iterable[Point]) -> list[Point]:
    """Return the points that no other point beats, in rising order of the first of two measures.

    A point beats another point if it is smaller in one measure and not larger in the other.
    """
    front: list[Point] = []
    for point in sorted(points):
        if not front or point[1] < front[-1][1]:
            front.append(point)
    return front


def _label(name: str) -> str:
    return LABELS.get(name) or axis_label(name, METRICS[name].unit)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("rows", nargs="+", type=rows_file, help=ROWS_HELP)
    text = f"setting whose values make a curve (default: {KNOB})"
    parser.add_argument("--knob", default=KNOB, metavar="SETTING", help=text)
    measures = {"choices": METRICS, "default": MEASURES, "metavar": "METRIC"}
    text = f"measures; the others are drawn against the first (default: {' '.join(MEASURES)})"
    parser.add_argument("--measures", nargs="+", **measures, help=text)
    text = "methods to leave out (default: identity)"
    parser.add_argument("--leave-out", nargs="*", default=["identity"], metavar="METHOD", help=text)
    text = "draw all measures against the times in out/timing or results/timing, on a logarithmic axis"
    parser.add_argument("--times", metavar="NAME", help=text)
    text = "picture to write (default: out/figures/<first experiment>_front.png)"
    parser.add_argument("-o", "--out", type=Path, help=text)


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    measures = tuple(dict.fromkeys(options.measures))
    if len(measures) < 2 and not options.times:
        raise InputError(f"--measures needs at least two metrics, and {measures[0]} is the only one")
    rows = pd.concat([read_csv(path) for path in options.rows], ignore_index=True)
    machine = ""
    if options.times:
        rows, machine = with_times(rows, read_csv(rows_file(options.times, TIMING)))
        measures = (TIME, *measures)
    warn_of_versions(rows)
    if options.knob != KNOB and f"method.{options.knob}" not in rows:
        raise InputError(f"--knob {options.knob}: no method of these rows has this setting")
    halves = rows["task.name"].map(split_of)
    asked = {"knob": options.knob, "measures": measures, "leave_out": tuple(options.leave_out)}
    of_half = {
        half: own
        for half in sorted(HALVES, key=lambda half: half != TUNING)
        if len(own := rows[halves.isna() if half is None else halves == half])
    }
    points, values = (
        {half: read(own, **asked) for half, own in of_half.items()} for read in (front, knob_values)
    )
    figure = draw(points, measures, values=values, machine=machine)
    save(figure, options.out or FIGURES / f"{options.rows[0].stem}_front.png")
    return 0
