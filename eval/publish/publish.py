"""Put rows, tables and figures where they are committed: ``sshade-eval publish EXPERIMENT ...``.

Nothing else writes to ``results``: rows go from out/rows to results/rows, their
tables are made in results/tables, and the figures that out/figures has under the
experiment's name go to results/figures. A name without rows, such as that of the
picture of ``sshade-eval bench``, stands for its figure alone. Everything is
checked before anything is written.
"""

from __future__ import annotations

import argparse
import shutil

from eval.publish.plotting import FIGURES, SUFFIXES
from eval.publish.summary import make_table
from eval.publish.tables import write_tables
from eval.rows.frame import read_csv, write_csv
from eval.rows.store import PUBLISHED, ROWS
from sshade.errors import InputError
from sshade.io.files import make_folder, replacing


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("names", nargs="+", metavar="EXPERIMENT", help="name of rows in out/rows")


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
    rows = {name: read_csv(path) for name, path in files.items() if path.is_file() or name not in alone}
    tables = [make_table(own, title=name) for name, own in rows.items()]
    for name, own in rows.items():
        write_csv(PUBLISHED / "rows" / f"{name}.csv", own)
        print(f"{PUBLISHED / 'rows' / name}.csv: {len(own)} rows, and their tables")  # noqa: T201
    write_tables(tables, PUBLISHED / "tables")
    make_folder(PUBLISHED / "figures")
    for figure in figures:
        with replacing(PUBLISHED / "figures" / figure.name) as temporary:
            shutil.copyfile(figure, temporary)
        print(PUBLISHED / "figures" / figure.name)  # noqa: T201
    return 0
