"""Whether two sets of rows say the same: ``sshade-eval compare A B``.

Meant for one sweep run twice, through two launchers or on two machines. Every
run of one must be in the other, and every column must be equal to the last
digit, but for times and provenance, which the command names.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from eval.rows.collect import collect
from eval.rows.store import ROWS, Row, experiment_folder, read_csv
from sshade.errors import InputError

#: What may differ: when, where and in what company a run took place, and how long it took.
LEFT_OUT = ("date", "env.", "peak_mib", "seconds.", "task.source")

#: Part of the provenance that must not differ.
KEPT = "env.version."


def load(name: Path) -> list[Row]:
    """Rows of a CSV, of a folder of runs, or of an experiment by its name."""
    if name.suffix == ".csv":
        return read_csv(name)
    if not name.is_dir() and (ROWS / f"{name}.csv").is_file():
        return read_csv(ROWS / f"{name}.csv")
    return collect(experiment_folder(name))


def compared(column: str) -> bool:
    """Whether a column must be equal."""
    left_out = any(column == name or (name.endswith(".") and column.startswith(name)) for name in LEFT_OUT)
    return column.startswith(KEPT) or not left_out


def differences(first: list[Row], second: list[Row]) -> list[str]:
    """What differs between two sets of rows, one sentence each; empty if they say the same.

    Runs are matched by method, task and seed.

    Raises
    ------
    InputError
        When a set holds two rows of one method, task and seed.
    """
    a, b = _by_run(first), _by_run(second)
    found = [f"{' '.join(run)}: only in the {where}" for run, where in _unmatched(a, b)]
    for run in sorted(a.keys() & b.keys()):
        for column in sorted(name for name in a[run].keys() | b[run].keys() if compared(name)):
            one, other = a[run].get(column), b[run].get(column)
            if one != other:
                found.append(f"{' '.join(run)}: {column} is {one!r} and {other!r}")
    return found


def _by_run(rows: list[Row]) -> dict[tuple[str, str, str], Row]:
    by_run: dict[tuple[str, str, str], Row] = {}
    for row in rows:
        run = row["method.name"], row["task.name"], f"seed {row['seed']}"
        if run in by_run:
            raise InputError(f"{' '.join(run)}: several rows; compare sets that hold one row a run")
        by_run[run] = row
    return by_run


def _unmatched(a: dict, b: dict) -> list[tuple[tuple[str, str, str], str]]:
    return [(run, "first") for run in sorted(a.keys() - b.keys())] + [
        (run, "second") for run in sorted(b.keys() - a.keys())
    ]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("first", type=Path, help="CSV, folder of runs, or name of an experiment")
    parser.add_argument("second", type=Path, help="the same")


def command(options: argparse.Namespace) -> int:
    """Do it; return the exit code."""
    first, second = load(options.first), load(options.second)
    found = differences(first, second)
    for text in found:
        print(text)  # noqa: T201
    names = {name for row in (*first, *second) for name in row}
    left_out = ", ".join(f"{name}*" if name.endswith(".") else name for name in LEFT_OUT)
    print(  # noqa: T201
        f"{len(first)} and {len(second)} rows, {sum(map(compared, names))} columns compared, "
        f"{len(found)} differences; left out: {left_out} (but not {KEPT}*)"
    )
    return 1 if found else 0
