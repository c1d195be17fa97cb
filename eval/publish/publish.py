"""Put rows, tables and figures into ``results``: ``sshade-eval publish EXPERIMENT ...``.

Rows of out/rows join the rows of the same version in results/rows, tables are made in results/tables, and
figures of out/figures with the name of the experiment are copied to results/figures. Published rows must be
of methods of this project, of one version of the code and of the metrics, and from a clean checkout of a
commit. With --replace they replace published rows of another version. A name without rows, such as the name
of a chart of ``sshade-eval front``, publishes a figure alone. All checks come before the first write.
"""

from __future__ import annotations

import argparse
import re
from collections import Counter
from collections.abc import Iterable

import pandas as pd

from eval.publish.plotting import FIGURES, SUFFIXES
from eval.publish.summary import make_table
from eval.publish.tables import write_tables
from eval.rows.collect import with_missing
from eval.rows.csv_rows import read_rows
from eval.rows.files import PUBLISHED, ROWS, copy_file
from eval.rows.frame import write_csv
from eval.rows.store import MISSING, Row, version_of
from eval.run.code import OWN
from sshade.core.errors import InputError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("names", nargs="+", metavar="EXPERIMENT", help="name of rows in out/rows")
    parser.add_argument("--replace", action="store_true", help="discard published rows of another version")


def joined(name: str, *, replace: bool) -> pd.DataFrame:
    """Return the new rows of an experiment, with the published rows of the same version.

    Raises
    ------
    InputError
        If the new rows are of several versions, of a modified tree, or of methods of a user; or if the
        published rows are of another version and not `replace`.
    """
    path, target = ROWS / f"{name}.csv", PUBLISHED / "rows" / f"{name}.csv"
    new = read_rows(path)
    runs = [row for row in new if row["status"] != MISSING]
    if not runs:
        raise InputError(f"{path} has no rows of runs yet; start the sweep again to make them")
    loose = [row for row in runs if row.get("env.modified") is not False or not row.get("env.commit")]
    if loose:
        raise InputError(
            f"{len(loose)} of {len(runs)} rows of {path} come from a checkout with changes that are not "
            f"committed, or from no commit ({_methods(loose)}): commit, and run them again "
            "with run.force=true"
        )
    users = [row for row in runs if {*_packages(row)} - OWN]
    if users:
        raise InputError(
            f"{len(users)} of {len(runs)} rows of {path} are of methods that are no part of this project "
            f"({_methods(users)}), so the commit does not hold their code: "
            "propose the methods as CONTRIBUTING.md describes"
        )
    metrics = {version_of(row)[1] for row in runs}
    versions = {row["method.name"]: version_of(row) for row in runs}
    if len(metrics) > 1 or any(version_of(row) != versions[row["method.name"]] for row in runs):
        raise InputError(
            f"{path} has rows of {_versions(runs)}; the rows of a method must have one version of the code, "
            "and all rows one version of the metrics: run the older ones again"
        )
    old = read_rows(target) if target.is_file() else []
    before = [row for row in old if row["status"] != MISSING]
    outdated = set()
    for row in before:
        name, (code, metrics_of_row) = row["method.name"], version_of(row)
        if code is None or metrics_of_row not in metrics or code != versions.get(name, version_of(row))[0]:
            outdated.add(name)
    if outdated:
        if not replace:
            raise InputError(
                f"{target} has rows of {_versions(before)}, and {path} of {_versions(runs)}: "
                f"--replace removes the published rows of {', '.join(sorted(outdated))}"
            )
        old = [row for row in old if row["method.name"] not in outdated]
    rows = [row for row in (*old, *new) if row["status"] != MISSING]
    return with_missing(rows, [row for row in (*old, *new) if row["status"] == MISSING])


def _packages(row: Row) -> list[str]:
    """Return the top-level packages of the functions of a row's method, nested methods included."""
    targets = [value for name, value in row.items() if re.fullmatch(r"method\.(.*\.)?target", name)]
    return [str(target).split(".")[0] for target in targets if target]


def _versions(rows: list[Row]) -> str:
    """List the versions of rows, with the number of rows of each."""
    names = [[(name or "unknown")[:8] for name in version_of(row)] for row in rows]
    return _counts(f"version {code} (metrics {metrics})" for code, metrics in names)


def _methods(rows: list[Row]) -> str:
    """List the methods of rows, with the number of rows of each."""
    return _counts(row["method.name"] for row in rows)


def _counts(names: Iterable[str]) -> str:
    return ", ".join(f"{name}: {count}" for name, count in sorted(Counter(names).items()))


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    if not (PUBLISHED / "rows").is_dir():
        raise InputError(f"there is no {PUBLISHED / 'rows'} here; publish from the project's own folder")
    files = {name: ROWS / f"{name}.csv" for name in options.names}
    drawn = [FIGURES / f"{name}{suffix}" for name in files for suffix in SUFFIXES]
    figures = [path for path in drawn if path.is_file()]
    for figure in figures:
        rows_file = files[figure.stem]
        if rows_file.is_file() and figure.stat().st_mtime < rows_file.stat().st_mtime:
            raise InputError(f"{figure} is older than {rows_file}: draw it again, or remove it")
    alone = {figure.stem for figure in figures}
    experiments = [name for name, path in files.items() if path.is_file() or name not in alone]
    rows = {name: joined(name, replace=options.replace) for name in experiments}
    tables = [make_table(own, title=name) for name, own in rows.items()]
    for name, own in rows.items():
        write_csv(PUBLISHED / "rows" / f"{name}.csv", own)
        print(f"{PUBLISHED / 'rows' / name}.csv: {len(own)} rows, and their tables")  # noqa: T201
    write_tables(tables, PUBLISHED / "tables")
    for figure in figures:
        copy_file(figure, PUBLISHED / "figures" / figure.name)
        print(PUBLISHED / "figures" / figure.name)  # noqa: T201
    return 0
