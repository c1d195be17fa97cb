"""Whether two sets of rows say the same: ``sshade-eval compare A B``.

Meant for one sweep run twice, through two launchers or on two machines. Every
run of one must be in the other, and every column must be equal to the last
digit, but for times and provenance, which the command names.
"""

from __future__ import annotations

import argparse

import pandas as pd

from eval.rows.experiment import load_rows
from eval.rows.frame import records
from eval.rows.store import Row, in_group
from sshade.errors import InputError

#: What may differ: when, where and in what company a run took place, and how long it took.
LEFT_OUT = ("date", "env.", "peak_mib", "seconds.", "task.source")

#: Part of the provenance that must not differ.
KEPT = "env.version."


def compared(column: str) -> bool:
    """Whether a column must be equal."""
    return in_group(column, KEPT) or not any(in_group(column, group) for group in LEFT_OUT)


def differences(first: pd.DataFrame, second: pd.DataFrame) -> list[str]:
    """What differs between two sets of rows, one sentence each; empty if they say the same.

    Runs are matched by method, task and seed.

    Raises
    ------
    InputError
        When a set holds two rows of one method, task and seed.
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
    """The rows by method, task and seed."""
    by_run = {
        f"{row['method.name']} {row['task.name']} seed {row['seed']}": row
        for row in records(rows.replace("", None))
    }
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
    print(  # noqa: T201
        f"{len(first)} and {len(second)} rows, {sum(map(compared, names))} columns compared, "
        f"{len(found)} differences; left out: {left_out} (but not {KEPT}*)"
    )
    return 1 if found else 0
