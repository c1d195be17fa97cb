"""Committed bands of quality: ``python -m eval.check ROWS.csv --bands ci``.

A band file ``conf/bands/<name>.yaml`` maps method -> column -> [low, high]. A
metric that is not available is out of its band. Times have no bands: they
depend on the machine.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path

from eval.store import VALID, Row, read_csv
from sshade.console import run_command
from sshade.errors import InputError

Bands = Mapping[str, Mapping[str, Sequence[float]]]


def out_of_band(row: Row, bands: Bands) -> list[str]:
    """What is wrong with a row, one short text for each column out of its band.

    A skipped row passes: an extra that is not installed is no defect.

    Parameters
    ----------
    row : mapping
    bands : mapping
        ``{method: {column: [low, high]}}``.
    """
    if row["status"] == "skipped":
        return []
    if row["status"] not in VALID:
        return [f"status {row['status']}: {row['reason']}"]
    if row["method.name"] not in bands:
        return [f"method {row['method.name']} has no band"]
    problems = []
    for column, (low, high) in bands[row["method.name"]].items():
        value = row.get(column)
        if value is None or not low <= value <= high:
            problems.append(f"{column} is {value}, not in [{low}, {high}]")
    return problems


def read_bands(name: str) -> Bands:
    """The bands of ``conf/bands/<name>.yaml``."""
    import yaml

    path = resources.files("conf").joinpath("bands", f"{name}.yaml")
    if not path.is_file():
        raise InputError(f"there are no bands {name!r} in conf/bands")
    return yaml.safe_load(path.read_text())


def main(arguments: list[str] | None = None) -> int:
    """Command line of ``python -m eval.check``: exit code 1 if a row is out of its band."""
    parser = argparse.ArgumentParser(prog="python -m eval.check", description=__doc__)
    parser.add_argument("rows", type=Path, help="CSV made by eval.collect")
    parser.add_argument("--bands", default="ci", help="name of a file in conf/bands (default: %(default)s)")
    options = parser.parse_args(arguments)
    bands = read_bands(options.bands)
    rows = read_csv(options.rows)
    bad = 0
    for row in rows:
        for problem in out_of_band(row, bands):
            bad += 1
            print(f"{row['method.name']} {row['task.name']}: {problem}")  # noqa: T201
    print(f"{len(rows)} rows, {bad} values out of band")  # noqa: T201
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(run_command(main))
