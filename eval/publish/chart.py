"""The chart of time against the distance to the true pose."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from typing import TYPE_CHECKING

import pandas as pd

from eval.publish.columns import TRUTH, reference_rows
from eval.publish.comparison import RUN, means
from eval.publish.plotting import look, name_points, new_figure, plot_points, style
from eval.rows.frame import distinct, method_names, numbers, valid
from sshade.core.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Column of the times.
TIME = "seconds.total"

Point = tuple[float, float]


def time_and_truth(rows: pd.DataFrame, times: pd.DataFrame | None = None) -> dict[str, Point]:
    """Return the mean time and the mean distance to the true pose of each method, over their common cases.

    Parameters
    ----------
    rows : DataFrame
        References are left out.
    times : DataFrame, optional
        Rows of ``sshade-eval bench`` on one machine. Their median times replace the times of `rows`, and
        methods without them are left out.

    Raises
    ------
    InputError
        If the times come from several machines, or no method was timed with its configuration.
    """
    rows = valid(rows)[lambda found: ~reference_rows(found) & numbers(found, TRUTH).notna()]
    values = pd.DataFrame({name: numbers(rows, name) for name in (TIME, TRUTH)})
    values = means(values.set_index(pd.MultiIndex.from_frame(rows[RUN])), RUN[:2])
    common = values[TRUTH].unstack(RUN[0]).dropna().index
    values = means(values[values.index.get_level_values(RUN[1]).isin(common)], RUN[0])
    if times is not None:
        values[TIME] = _medians(rows, times)
        values = values.dropna()
        if values.empty:
            raise InputError("no method was timed with the configuration of these rows")
    order = [name for name in method_names(rows) if name in values.index] if len(values) else []
    return {name: tuple(values.loc[name]) for name in order}


def _medians(rows: pd.DataFrame, times: pd.DataFrame) -> pd.Series:
    """Return the median of the kept times by method, NaN for a method without times."""
    for column in ("task.checksum", "env.machine", "env.machine_id"):
        if len(distinct(times, column)) > 1:
            raise InputError(f"the times differ in {column}, so one chart cannot show them")
    kept = times[times["kept"].eq(True)]
    seconds = numbers(kept, TIME).groupby(kept["method.hash"]).median()
    return rows.groupby("method.name")["method.hash"].first().map(seconds)


@style()
def draw(points: dict[str, Point], *, machine: str) -> Figure:
    """Draw a point for each method; a grey line joins the methods that no other method beats."""
    from matplotlib.ticker import LogLocator, NullFormatter

    figure = new_figure(3.8, 3.6)
    axes, looks = figure.subplots(), look(points)
    curves = {method: [point] for method, point in points.items()}
    plot_points(axes, curves, looks)
    axes.step(*zip(*unbeaten(points.values()), strict=True), where="post", color="#bbbbbb", zorder=0, lw=1)
    axes.set(xscale="log", xlabel="\n".join(["time (s)", *textwrap.wrap(machine, 46)]))
    axes.set(ylabel="distance to the true pose (% of the diagonal)")
    axes.set_ylim(0, 1.1 * axes.get_ylim()[1])
    axes.grid(alpha=0.3)
    axes.margins(x=0.15)
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 3)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
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


def chart_of(rows: pd.DataFrame, times: pd.DataFrame | None = None) -> Figure | None:
    """Return the chart of rows, None where fewer than two methods have a distance to the true pose."""
    points = time_and_truth(rows, times)
    if len(points) < 2:
        return None
    return draw(points, machine="; ".join(distinct(rows if times is None else times, "env.machine")))
