"""How numbers change with a size: ``sshade-eval curves ROWS``, needs the extra ``figures``.

For experiments whose methods are labelled by a number, such as ``arap-7000``:
one curve a method over the vertices of its tasks (``conf/experiment/resolution.yaml``)
or over another column of the rows, such as ``--over method.samplings``
(``conf/experiment/ablation_samplings.yaml``). Made from rows; no method is run.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from eval.metrics import METRICS
from eval.publish.plotting import FIGURES, axis_label, look, new_figure, plot_points, save, style
from eval.rows.experiment import rows_file
from eval.rows.frame import read_csv, split_label, valid
from eval.rows.store import ROWS_HELP
from sshade.errors import InputError
from sshade.figures import require_extra

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Method -> (size, value), by growing size.
Curves = dict[str, list[tuple[float, float]]]

#: What can be drawn -> the row's column and its unit.
DRAWN = {name: (f"metric.{name}", metric.unit) for name, metric in METRICS.items()}


def curves(rows: pd.DataFrame, metric: str = "volume", *, over: str = "task.vertices") -> Curves:
    """Means over the valid runs of each method and size.

    Parameters
    ----------
    rows : DataFrame
        Labelled ``<method>-<size>``.
    metric : str
        A name in :data:`DRAWN`.
    over : str
        The rows' column that is the size.

    Raises
    ------
    InputError
        On an unknown metric, or when no valid row has such a label, that metric
        and a number in that column.
    """
    if metric not in DRAWN:
        raise InputError(f"there is no metric {metric!r}; there are {', '.join(DRAWN)}")
    rows = valid(rows).reindex(columns=["method.name", over, DRAWN[metric][0]])
    labels = rows["method.name"].map(split_label)
    points = pd.DataFrame({"method": labels.str[0], "number": labels.str[1].astype(float)})
    points["size"], points["value"] = (pd.to_numeric(rows[name], "coerce") for name in rows.columns[1:])
    means = points.dropna().groupby(["method", "number"]).mean().astype(float)
    if means.empty:
        raise InputError(
            f"no valid row of a method labelled like arap-7000 has the metric {metric} and a number in {over}"
        )
    return {method: list(own.itertuples(index=False, name=None)) for method, own in means.groupby("method")}


@style()
def draw(panels: dict[str, Curves], *, over: str = "task.vertices") -> Figure:
    """Draw curves.

    Parameters
    ----------
    panels : dict
        Metric -> its curves, one panel each.
    over : str
        The column that is the size; numbers of vertices get a logarithmic axis.
    """
    one = len(panels) == 1
    figure = new_figure(6.0 if one else 2.5 * len(panels), 3.8 if one else 2.5)
    every = figure.subplots(1, len(panels), squeeze=False)[0]
    for axes, (metric, lines) in zip(every, panels.items(), strict=True):
        plot_points(axes, lines, look(lines))
        if over.endswith("vertices"):
            axes.set_xscale("log")
        axes.set_ylim(0, 1.06 * max(value for points in lines.values() for _, value in points) or 1.0)
        axes.set(xlabel=over.rpartition(".")[2], ylabel=axis_label(metric, DRAWN[metric][1]))
    if one or len(lines) > 1:
        axes.legend()
    return figure


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("rows", type=rows_file, help=ROWS_HELP)
    parser.add_argument(
        "--metric", nargs="+", default=["volume"], help=f"of {', '.join(DRAWN)} (default: volume)"
    )
    parser.add_argument("--over", default="task.vertices", help="column of the rows (default: %(default)s)")
    parser.add_argument("-o", "--out", type=Path, help="default: out/figures/<experiment>.png")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    require_extra("matplotlib")
    rows = read_csv(options.rows)
    panels = {metric: curves(rows, metric, over=options.over) for metric in options.metric}
    save(draw(panels, over=options.over), options.out or FIGURES / f"{options.rows.stem}.png")
    return 0
