"""Volume against stretch: ``sshade-eval front ROWS.csv [ROWS.csv ...]``.

A method labelled by its weight of the volume, such as ``sshade_fine-0.1``, is a
curve from the free volume to the exact one; any other is a point. Means over
the cases that all of them have. Made from rows; no method is run.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path

from eval.metrics.metrics import METRICS
from eval.publish.plotting import look, new_figure, save, style
from eval.rows.store import ROWS_HELP, VALID, Row, read_csv, rows_file
from sshade.errors import InputError
from sshade.figures import require_extra

#: What volume is drawn against.
AGAINST = ("edge", "angle")

#: A point of the figure: the means of volume and of each metric in AGAINST.
Point = tuple[float, ...]


def front(rows: Iterable[Row], *, leave_out: tuple[str, ...] = ("identity",)) -> dict[str, list[Point]]:
    """Mean volume and stretch of each method, curves by growing weight of the volume.

    Parameters
    ----------
    rows : rows
        A method's curve: those named ``<method>-<weight>`` with the weight in ``method.volume``.
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
    found: dict[tuple[str, float | None], dict[tuple, Row]] = {}
    for row in rows:
        weight = _weight(row)
        method = row["method.name"] if weight is None else row["method.name"].rpartition("-")[0]
        if row["status"] in VALID and method not in leave_out and row["metric.volume"] is not None:
            found.setdefault((method, weight), {})[row["task.checksum"], row["seed"]] = row
    common = set.intersection(*(set(cases) for cases in found.values())) if found else set()
    if not common:
        raise InputError("the methods of these rows have no case in common that all have a volume for")
    points: dict[str, list[Point]] = {}
    for method, weight in sorted(found, key=lambda one: (one[0], -1.0 if one[1] is None else one[1])):
        own = [found[method, weight][case] for case in common]
        columns = ("metric.volume", *(f"metric.{name}" for name in AGAINST))
        mean = tuple(sum(row[column] for row in own) / len(own) for column in columns)
        points.setdefault(method, []).append(mean)
    # A row by the plain name, of another experiment, has its place among those of the curve.
    return {method: sorted(own, reverse=True) for method, own in points.items()}


def draw(points: dict[str, list[Point]], path: Path) -> None:
    """Draw a panel for each metric in :data:`AGAINST` into a .svg, .pdf or .png file."""
    looks = look(list(points))
    with style():
        figure = new_figure(7.0, 3.4)
        panels = figure.subplots(1, len(AGAINST))
        for i, (name, axes) in enumerate(zip(AGAINST, panels, strict=True), start=1):
            for method, own in points.items():
                line = "-" if len(own) > 1 else "none"
                x, y = [point[0] for point in own], [point[i] for point in own]
                axes.plot(x, y, linestyle=line, linewidth=1.2, markersize=4, label=method, **looks[method])
            axes.set_xlabel(f"volume ({METRICS['volume'].unit})")
            axes.set_ylabel(f"{name} ({METRICS[name].unit})")
            axes.set_xlim(left=-0.3)
            axes.set_ylim(bottom=0)
        panels[-1].legend()
    save(figure, path)


def _weight(row: Row) -> float | None:
    """The weight of the volume that a row's name tells, if it does."""
    label, weight = row["method.name"].rpartition("-")[2], row.get("method.volume")
    try:
        return float(weight) if weight is not None and float(label) == float(weight) else None
    except ValueError:
        return None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("rows", nargs="+", type=rows_file, help=ROWS_HELP)
    parser.add_argument(
        "--leave-out", nargs="*", default=["identity"], metavar="METHOD", help="default: identity"
    )
    parser.add_argument("-o", "--out", type=Path, help="default: out/figures/<first experiment>.png")


def command(options: argparse.Namespace) -> int:
    """Do it; return the exit code."""
    require_extra("matplotlib")
    out = options.out or Path("out/figures") / f"{options.rows[0].stem}.png"
    rows = [row for path in options.rows for row in read_csv(path)]
    points = front(rows, leave_out=tuple(options.leave_out))
    draw(points, out)
    print(out)  # noqa: T201
    return 0
