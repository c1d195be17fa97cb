"""How numbers change with a size: ``sshade-eval curves ROWS.csv``, needs the extra ``figures``.

For experiments whose methods are labelled by a number, such as ``arap-7000``:
one curve a method over the vertices of its tasks (``conf/experiment/resolution.yaml``)
or over another column of the rows, such as ``--over method.samplings``
(``conf/experiment/ablation_samplings.yaml``). Made from rows; no method is run.
"""

from __future__ import annotations

import argparse
import re
from collections import defaultdict
from pathlib import Path

from eval.metrics.metrics import METRICS
from eval.publish.plotting import look, new_figure, save, style
from eval.rows.store import ROWS_HELP, VALID, Row, read_csv, rows_file
from sshade.errors import InputError
from sshade.figures import require_extra

#: Method -> (size, value), by growing size.
Curves = dict[str, list[tuple[float, float]]]

#: What can be drawn -> the row's column and its unit.
DRAWN = {name: (f"metric.{name}", metric.unit) for name, metric in METRICS.items()}
DRAWN["time"] = ("seconds.total", "s")


def curves(rows: list[Row], metric: str = "volume", *, over: str = "task.vertices") -> Curves:
    """Means over the valid runs of each method and size.

    Parameters
    ----------
    rows : list of rows
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
    found: dict[str, dict[int, list[tuple[int, float]]]] = defaultdict(lambda: defaultdict(list))
    for row in rows:
        label = re.fullmatch(r"(.+)-(\d+)", row["method.name"])
        size, value = row.get(over), row.get(DRAWN[metric][0])
        if label and row["status"] in VALID and value is not None and type(size) in (int, float):
            found[label[1]][int(label[2])].append((size, value))
    if not found:
        raise InputError(
            f"no valid row of a method labelled like arap-7000 has the metric {metric} and a number in {over}"
        )
    return {
        method: [
            tuple(sum(part) / len(part) for part in zip(*sizes[size], strict=True)) for size in sorted(sizes)
        ]
        for method, sizes in sorted(found.items())
    }


def draw(panels: dict[str, Curves], path: Path, *, over: str = "task.vertices") -> None:
    """Draw curves into a .svg, .pdf or .png file.

    Parameters
    ----------
    panels : dict
        Metric -> its curves, one panel each.
    path : path
    over : str
        The column that is the size; numbers of vertices get a logarithmic axis.
    """
    one = len(panels) == 1
    with style():
        figure = new_figure(6.0 if one else 2.5 * len(panels), 3.8 if one else 2.5)
        every = figure.subplots(1, len(panels), squeeze=False)[0]
        for axes, (metric, lines) in zip(every, panels.items(), strict=True):
            looks = look(list(lines))
            for method, points in lines.items():
                axes.plot(
                    *zip(*points, strict=True), label=method, markersize=4, linewidth=1.2, **looks[method]
                )
            if over.endswith("vertices"):
                axes.set_xscale("log")
            axes.set_ylim(0, 1.06 * max(value for points in lines.values() for _, value in points) or 1.0)
            axes.set_xlabel(over.rpartition(".")[2])
            axes.set_ylabel(f"{metric} ({DRAWN[metric][1]})")
        if one or len(lines) > 1:
            axes.legend()
    save(figure, path)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("rows", type=Path, help=ROWS_HELP)
    parser.add_argument(
        "--metric", nargs="+", default=["volume"], help=f"of {', '.join(DRAWN)} (default: volume)"
    )
    parser.add_argument("--over", default="task.vertices", help="column of the rows (default: %(default)s)")
    parser.add_argument("-o", "--out", type=Path, help="default: out/figures/<experiment>.png")


def command(options: argparse.Namespace) -> int:
    """Do it; return the exit code."""
    require_extra()
    path = options.out or Path("out/figures") / f"{options.rows.stem}.png"
    rows = read_csv(rows_file(options.rows))
    panels = {metric: curves(rows, metric, over=options.over) for metric in options.metric}
    draw(panels, path, over=options.over)
    print(path)  # noqa: T201
    return 0
