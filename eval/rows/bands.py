"""Committed bands of quality: ``sshade-eval check ROWS.csv [--bands ci]``.

A band file ``conf/bands_<name>.yaml`` maps method -> task -> column -> [low,
high]. A metric that is not available is out of its band. Times have no bands:
they depend on the machine. ``--suggest`` prints bands around the rows instead,
for a new method or data set: look at the numbers before committing them.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path

from eval.metrics import METRICS
from eval.rows.store import ROWS_HELP, VALID, Row
from sshade.cli.configuration import CONFIGURATION
from sshade.errors import InputError

Bands = Mapping[str, Mapping[str, Mapping[str, Sequence[float]]]]

#: Width of a suggested band: a factor, and for values near zero an amount in the metric's unit. It
#: is what machines and versions of libraries differ by; a count of zero has none.
FACTOR, AMOUNT = 1.05, {"%": 0.005, "deg": 0.005, "count": 5.0, "-": 0.001}
#: Metrics that few faces or edges decide, and counts, differ by more.
TAILS, TAIL_FACTOR = (
    {"bend_tail", "spike", "distortion", "distortion_95", "distortion_99", "distortion_max"},
    1.25,
)
#: Handles that are met to this percentage of the diagonal are met exactly, and must be.
EXACT = 1e-7


def out_of_band(row: Row, bands: Bands | str) -> list[str]:
    """What is wrong with a row, one short text for each column out of its band.

    A skipped row passes: an extra that is not installed is no defect.

    Parameters
    ----------
    row : mapping
    bands : mapping or str
        ``{method: {task: {column: [low, high]}}}``, or the name that :func:`read_bands` takes.

    Raises
    ------
    InputError
        Where there are no bands of the name.
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
    """Bands around the metrics of valid rows; what is not available gets none."""
    bands: dict[str, dict[str, dict[str, list[float]]]] = {}
    for row in rows:
        if row["status"] not in VALID:
            continue
        of_task = bands.setdefault(row["method.name"], {}).setdefault(row["task.name"], {})
        for name in METRICS:
            value = row.get(f"metric.{name}")
            if value is not None:
                of_task[f"metric.{name}"] = [float(f"{bound:.3g}") for bound in _band(name, value)]
    return bands


def _band(name: str, value: float) -> tuple[float, float]:
    """Bounds around a metric's value."""
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
    """The bands of ``conf/bands_<name>.yaml``; not to be changed.

    Raises
    ------
    InputError
        Where there is no such file.
    """
    import yaml

    path = CONFIGURATION / f"bands_{name}.yaml"
    if not path.is_file():
        raise InputError(f"there are no bands {name!r}: conf has no bands_{name}.yaml")
    return yaml.safe_load(path.read_text())


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("rows", type=Path, help=ROWS_HELP)
    parser.add_argument("--bands", default="ci", help="NAME of conf/bands_NAME.yaml (default: %(default)s)")
    parser.add_argument("--suggest", action="store_true", help="print bands around the rows instead")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    from eval.rows.experiment import rows_file  # not above: a run holds its row against bands without pandas
    from eval.rows.frame import read_csv, records

    rows = records(read_csv(rows_file(options.rows)))
    if options.suggest:
        import yaml

        print(yaml.safe_dump(suggest(rows), default_flow_style=None, width=200), end="")  # noqa: T201
        return 0
    bands = read_bands(options.bands)
    bad = [(row, problem) for row in rows for problem in out_of_band(row, bands)]
    for row, problem in bad:
        print(f"{row['method.name']} {row['task.name']}: {problem}")  # noqa: T201
    print(f"{len(rows)} rows, {len(bad)} values out of band")  # noqa: T201
    return 1 if bad else 0
