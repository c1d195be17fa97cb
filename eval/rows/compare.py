"""Compare two sets of rows: ``sshade-eval compare A B``.

Use it for the same sweep with two launchers or on two machines. Both sets must have the same runs, and all
columns must be equal to the last digit. Times and facts about the machine are not compared.
"""

from __future__ import annotations

import argparse

import pandas as pd

from eval.rows.experiment import load_rows
from eval.rows.frame import records
from eval.rows.store import Row, in_group
from sshade.core.errors import InputError

#: Columns that may differ: date, machine, number of parallel runs, memory and times.
LEFT_OUT = ("date", "env.", "peak_mib", "seconds.", "task.source")

#: Columns in the groups above that must be equal: versions of code and libraries.
KEPT = "env.version."


def compared(column: str) -> bool:
    """Whether a column must be equal."""
    return in_group(column, KEPT) or not any(in_group(column, group) for group in LEFT_OUT)


def differences(first: pd.DataFrame, second: pd.DataFrame) -> list[str]:
    """Return one sentence for each difference between two sets of rows.

    Runs with equal method, task and seed are compared.

    Raises
    ------
    InputError
        When a set holds two rows with the same method, task and seed.
    """
    a, b = _by_run(first), _by_run(second)
    found = [f"{run}: only in the first" for run in sorted(a.keys() - b.keys())]
    found += [f"{run}: only in the second" for run in sorted(b.keys() - a.keys())]
    for run in sorted(a.keys() & b.keys()):
        for column in sorted(filter(compared, a[run].keys() | b[run].keys())):
            one, other = a[run].get(column), b[run].get(column)
            if one != other:
                found.append(f"{run}: {column} is {one!r} and {other!r}")
    return found


def _by_run(rows: pd.DataFrame) -> dict[str, Row]:
    """Return the rows by method, task and seed."""
    plain = records(rows.replace("", None))
    by_run = {f"{row['method.name']} {row['task.name']} seed {row['seed']}": row for row in plain}
    if len(by_run) < len(rows):
        raise InputError("several rows of one method, task and seed; compare sets that hold one row a run")
    return by_run


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("first", help="CSV, folder of runs, or name of an experiment")
    parser.add_argument("second", help="the same")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; exit code 1 if the rows differ."""
    first, second = load_rows(options.first), load_rows(options.second)
    found = differences(first, second)
    for text in found:
        print(text)  # noqa: T201
    names = first.columns.union(second.columns)
    left_out = ", ".join(f"{name}*" if name.endswith(".") else name for name in LEFT_OUT)
    counts = f"{len(first)} and {len(second)} rows, {sum(map(compared, names))} columns compared"
    print(f"{counts}, {len(found)} differences; left out: {left_out} (but not {KEPT}*)")  # noqa: T201
    return 1 if found else 0
