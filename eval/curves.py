"""How a number grows with the mesh: ``python -m eval.curves ROWS.csv``, needs the extra ``figures``.

For experiments whose methods are labelled by size, such as ``arap-7000`` (see
``conf/experiment/resolution.yaml``): one curve a method over the vertices of
its tasks. Made from rows; no method is run.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections import defaultdict
from pathlib import Path

from eval.metrics import METRICS
from eval.plotting import look, new_figure, save, style
from eval.store import ROWS_HELP, VALID, Row, read_csv, rows_file
from sshade.console import run_command
from sshade.errors import InputError
from sshade.show import require_extra

#: Method -> (vertices, value), by growing vertices.
Curves = dict[str, list[tuple[float, float]]]


def curves(rows: list[Row], metric: str = "volume") -> Curves:
    """Means over the valid runs of each method and size.

    Parameters
    ----------
    rows : list of rows
        Labelled ``<method>-<size>``.
    metric : str
        A name in :data:`eval.metrics.METRICS`.

    Raises
    ------
    InputError
        On an unknown metric, or when no valid row has such a label and that metric.
    """
    if metric not in METRICS:
        raise InputError(f"there is no metric {metric!r}; there are {', '.join(METRICS)}")
    found: dict[str, dict[int, list[tuple[int, float]]]] = defaultdict(lambda: defaultdict(list))
    for row in rows:
        label = re.fullmatch(r"(.+)-(\d+)", row["method.name"])
        value = row.get(f"metric.{metric}")
        if label and row["status"] in VALID and value is not None:
            found[label[1]][int(label[2])].append((row["task.vertices"], value))
    if not found:
        raise InputError(f"no valid row of a method labelled like arap-7000 has the metric {metric}")
    return {
        method: [
            tuple(sum(part) / len(part) for part in zip(*sizes[size], strict=True)) for size in sorted(sizes)
        ]
        for method, sizes in sorted(found.items())
    }


def draw(lines: Curves, path: Path, *, metric: str) -> None:
    """Draw the curves into a .svg, .pdf or .png file, vertices on a logarithmic axis."""
    with style():
        figure = new_figure(6.0, 3.8)
        axes = figure.subplots()
        looks = look(list(lines))
        for method, points in lines.items():
            axes.plot(*zip(*points, strict=True), label=method, markersize=4, linewidth=1.2, **looks[method])
        axes.set_xscale("log")
        axes.set_ylim(bottom=0)
        axes.set_xlabel("vertices")
        axes.set_ylabel(f"{metric} ({METRICS[metric].unit})")
        axes.legend()
    save(figure, path)


def main(arguments: list[str] | None = None) -> int:
    """Command line of ``python -m eval.curves``."""
    parser = argparse.ArgumentParser(prog="python -m eval.curves", description=__doc__)
    parser.add_argument("rows", type=Path, help=ROWS_HELP)
    parser.add_argument("--metric", default="volume", help="default: %(default)s")
    parser.add_argument("-o", "--out", type=Path, help="default: results/figures/<experiment>.png")
    options = parser.parse_args(arguments)
    require_extra()
    path = options.out or Path("results/figures") / f"{options.rows.stem}.png"
    draw(curves(read_csv(rows_file(options.rows)), options.metric), path, metric=options.metric)
    print(path)  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(run_command(main))
