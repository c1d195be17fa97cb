"""Metrics against a size or a parameter: ``sshade-eval curves ROWS``, needs the extra ``figures``.

For experiments whose methods are labelled by a number, such as ``arap-7000``: one curve per method over the
vertices of its tasks (``conf/experiment/resolution.yaml``), or over another column of the rows, such as
``--over method.samplings`` (``conf/experiment/ablation_samplings.yaml``).
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from eval.metrics import METRICS
from eval.publish.plotting import FIGURES, axis_label, look, new_figure, plot_points, save, style
from eval.rows.files import ROWS_HELP, rows_file
from eval.rows.frame import read_csv, split_label, valid
from sshade.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Method -> (size, value), by growing size.
Curves = dict[str, list[tuple[float, float]]]


def curves(rows: pd.DataFrame, metric: str = "volume", *, over: str = "task.vertices") -> Curves:
    """Return means over the valid runs of each method and size.

    Parameters
    ----------
    rows : DataFrame
        Methods are labelled ``<method>-<size>``.
    metric : str
    over : str
        Column of the rows that holds the size.

    Raises
    ------
    InputError
        If no valid row has such a label, the metric, and a number in the column.
    """
    rows = valid(rows).reindex(columns=["method.name", over, f"metric.{metric}"])
    labels = rows["method.name"].map(split_label)
    points = pd.DataFrame({"method": labels.str[0], "number": labels.str[1].astype(float)})
    points["size"], points["value"] = (pd.to_numeric(rows[name], "coerce") for name in rows.columns[1:])
    means = points.dropna().groupby(["method", "number"]).mean().astype(float)
    if means.empty:
        raise InputError(
            f"no valid row labelled like arap-7000 has the metric {metric} and a number in {over}"
        )
    return {method: list(own.itertuples(index=False, name=None)) for method, own in means.groupby("method")}


@style()
def draw(panels: dict[str, Curves], *, over: str = "task.vertices") -> Figure:
    """Draw one panel per metric. Numbers of vertices have a logarithmic axis."""
    one = len(panels) == 1
    figure = new_figure(6.0 if one else 2.5 * len(panels), 3.8 if one else 2.5)
    every = figure.subplots(1, len(panels), squeeze=False)[0]
    for axes, (metric, lines) in zip(every, panels.items(), strict=True):
        plot_points(axes, lines, look(lines))
        if over.endswith("vertices"):
            axes.set_xscale("log")
        axes.set_ylim(0, 1.06 * max(value for points in lines.values() for _, value in points) or 1.0)
        axes.set(xlabel=over.rpartition(".")[2], ylabel=axis_label(metric, METRICS[metric].unit))
    if one or len(lines) > 1:
        axes.legend()
    return figure


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("rows", type=rows_file, help=ROWS_HELP)
    text = f"measures to draw, of {', '.join(METRICS)} (default: volume)"
    parser.add_argument(
        "--metric", nargs="+", choices=METRICS, default=["volume"], metavar="METRIC", help=text
    )
    parser.add_argument(
        "--over", default="task.vertices", help="column on the other axis (default: %(default)s)"
    )
    parser.add_argument(
        "-o", "--out", type=Path, help="picture to write (default: out/figures/<experiment>.png)"
    )


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    rows = read_csv(options.rows)
    panels = {metric: curves(rows, metric, over=options.over) for metric in options.metric}
    save(draw(panels, over=options.over), options.out or FIGURES / f"{options.rows.stem}.png")
    return 0
