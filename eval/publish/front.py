"""Volume against stretch: ``sshade-eval front ROWS [ROWS ...]``, needs the extra ``figures``.

A method labelled by its weight of the volume, such as ``sshade_fine-0.1``, is a
curve from the free volume to the exact one; any other is a point. Means over
the cases that all of them have. Made from rows; no method is run.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

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

#: What volume is drawn against.
AGAINST = ("edge", "angle")

#: A point of the figure: the means of volume and of each metric in AGAINST.
Point = tuple[float, ...]


def front(rows: pd.DataFrame, *, leave_out: tuple[str, ...] = ("identity",)) -> dict[str, list[Point]]:
    """Mean volume and stretch of each method, curves by falling volume.

    Parameters
    ----------
    rows : DataFrame
        A method's curve: those named ``<method>-<weight>`` with the weight in ``method.volume``,
        and the one named ``<method>``, of another experiment perhaps.
    leave_out : names of methods

    Returns
    -------
    dict
        Method -> points (volume, edge, angle); several make a curve.

    Raises
    ------
    InputError
        When no case has a valid row of every method.
    """
    columns = ["metric.volume", *(f"metric.{name}" for name in AGAINST)]
    rows = valid(rows).reindex(columns=["method.name", "method.volume", "task.checksum", "seed", *columns])
    pairs = zip(rows["method.name"], rows["method.volume"], strict=True)
    rows = rows.assign(family=[_family(name, weight) for name, weight in pairs])
    rows = rows[~rows["family"].isin(leave_out) & rows["metric.volume"].notna()]
    run = ["task.checksum", "seed", "family", "method.name"]
    values = rows.drop_duplicates(run, keep="last").set_index(run)[columns].astype(float)
    common = values.unstack(["family", "method.name"]).dropna()
    if common.empty:
        raise InputError("the methods of these rows have no case in common that all have a volume for")
    means = common.mean().unstack(0)[columns]
    return {
        family: sorted(own.itertuples(index=False, name=None), reverse=True)
        for family, own in means.groupby("family")
    }


def _family(name: str, weight: Any) -> str:
    """A row's method: its name without the weight of the volume, where the name ends with that."""
    family, number = split_label(name)
    try:
        return family if weight is not None and number == float(weight) else name
    except ValueError:
        return name


@style()
def draw(points: dict[str, list[Point]]) -> Figure:
    """A panel for each metric in :data:`AGAINST`."""
    figure = new_figure(7.0, 3.4)
    panels = figure.subplots(1, len(AGAINST))
    for i, (name, axes) in enumerate(zip(AGAINST, panels, strict=True), start=1):
        curves = {method: [(point[0], point[i]) for point in own] for method, own in points.items()}
        plot_points(axes, curves, look(points))
        axes.set_xlabel(axis_label("volume", METRICS["volume"].unit))
        axes.set_ylabel(axis_label(name, METRICS[name].unit))
        axes.set_xlim(left=-0.3)
        axes.set_ylim(bottom=0)
    panels[-1].legend()
    return figure


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("rows", nargs="+", type=rows_file, help=ROWS_HELP)
    parser.add_argument(
        "--leave-out", nargs="*", default=["identity"], metavar="METHOD", help="default: identity"
    )
    parser.add_argument("-o", "--out", type=Path, help="default: out/figures/<first experiment>.png")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    require_extra("matplotlib")
    rows = pd.concat([read_csv(path) for path in options.rows], ignore_index=True)
    points = front(rows, leave_out=tuple(options.leave_out))
    save(draw(points), options.out or FIGURES / f"{options.rows[0].stem}.png")
    return 0
