"""Committed bands of quality: ``sshade-eval check ROWS.csv [--bands ci]``.

A file ``conf/bands_<name>.yaml`` maps method -> task -> column -> [low, high]. A metric without a value is
out of its band. Times depend on the machine and have no bands. For a new method or dataset, ``--suggest``
prints bands around the rows; check the numbers before you commit them.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path

import yaml

from eval.installation import CONFIGURATION
from eval.metrics import METRICS
from eval.rows.csv_rows import read_rows
from eval.rows.files import ROWS_HELP, read_conf, rows_file
from eval.rows.store import VALID, Row
from sshade.core.errors import InputError

Bands = Mapping[str, Mapping[str, Mapping[str, Sequence[float]]]]

#: Width of a suggested band: a factor, and for values near zero an amount in the unit of the metric. Results
#: of different machines and library versions fit into this width. A count of zero gets a band of width zero.
FACTOR, AMOUNT = 1.05, {"%": 0.005, "deg": 0.005, "count": 5.0, "-": 0.001}
#: Metrics that depend on few faces or edges vary more. Their factor, which counts share, is larger.
TAILS = {"bend_tail", "spike", "distortion", "distortion_95", "distortion_99", "distortion_max"}
TAIL_FACTOR = 1.25
#: Smallest upper bound of a suggested band of the handle distance, in percent of the diagonal. It leaves room
#: for rounding where a method meets its handles exactly.
EXACT = 1e-7


def out_of_band(row: Row, bands: Bands | str) -> list[str]:
    """Return a short text for each column of a row that is out of its band.

    A skipped row passes, because a missing extra is not a defect.

    Parameters
    ----------
    row : mapping
    bands : mapping or str
        ``{method: {task: {column: [low, high]}}}``, or a name for :func:`read_bands`.

    Raises
    ------
    InputError
        When there are no bands with this name.
    """
    bands = read_bands(bands) if isinstance(bands, str) else bands
    method, task = row["method.name"], row["task.name"]
    if row["status"] == "skipped":
        return []
    if row["status"] not in VALID:
        return [f"status {row['status']}: {row['reason']}"]
    if task not in bands.get(method, {}):
        return [f"no band for {method} on {task}"]
    problems = []
    for column, (low, high) in bands[method][task].items():
        value = row.get(column)
        if value is None or not low <= value <= high:
            problems.append(f"{column} is {value}, not in [{low}, {high}]")
    return problems


def suggest(rows: Iterable[Row]) -> dict[str, dict[str, dict[str, list[float]]]]:
    """Return bands around the available metrics of valid rows."""
    bands: dict[str, dict[str, dict[str, list[float]]]] = {}
    for row in rows:
        if row["status"] not in VALID:
            continue
        of_task = bands.setdefault(row["method.name"], {}).setdefault(row["task.name"], {})
        for name in METRICS:
            value = row.get(f"metric.{name}")
            if value is not None:
                low, high = (float(f"{bound:.3g}") for bound in _band(name, value))
                before = of_task.get(f"metric.{name}", (low, high))  # of another seed
                of_task[f"metric.{name}"] = [min(low, before[0]), max(high, before[1])]
    return bands


def _band(name: str, value: float) -> tuple[float, float]:
    """Return the bounds of a band around a value."""
    unit = METRICS[name].unit
    if name == "handle":
        return 0.0, max(EXACT, TAIL_FACTOR * value)
    if unit == "count" and value == 0:
        return 0.0, 0.0
    factor = TAIL_FACTOR if unit == "count" or name in TAILS else FACTOR
    amount = AMOUNT[unit]
    return max(0.0, min(value / factor, value - amount)), max(value * factor, value + amount)


@cache
def read_bands(name: str) -> Bands:
    """Return the bands of ``conf/bands_<name>.yaml``; do not change the result, which is cached.

    Raises
    ------
    InputError
        When there is no such file.
    """
    if not (CONFIGURATION / f"bands_{name}.yaml").is_file():
        raise InputError(f"there are no bands {name!r}: conf has no bands_{name}.yaml")
    return read_conf(f"bands_{name}")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("rows", type=Path, help=ROWS_HELP)
    parser.add_argument("--bands", default="ci", help="NAME of conf/bands_NAME.yaml (default: %(default)s)")
    parser.add_argument("--suggest", action="store_true", help="print bands around the rows instead")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    rows = read_rows(rows_file(options.rows))
    if options.suggest:
        print(yaml.safe_dump(suggest(rows), default_flow_style=None, width=200), end="")  # noqa: T201
        return 0
    bands = read_bands(options.bands)
    bad = [(row, problem) for row in rows for problem in out_of_band(row, bands)]
    for row, problem in bad:
        print(f"{row['method.name']} {row['task.name']}: {problem}")  # noqa: T201
    print(f"{len(rows)} rows, {len(bad)} values out of band")  # noqa: T201
    return 1 if bad else 0
