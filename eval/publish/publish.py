"""Put rows, tables and figures where they are committed: ``sshade-eval publish EXPERIMENT ...``.

Nothing else writes to ``results``: rows go from out/rows to results/rows, their
tables are made in results/tables, and the figures that out/figures has under the
experiment's name go to results/figures. Everything is checked before anything
is written.
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
    parser.add_argument("experiments", nargs="+", metavar="EXPERIMENT", help="name of rows in out/rows")


def command(options: argparse.Namespace) -> int:
    """Do it; return the exit code."""
    if not (PUBLISHED / "rows").is_dir():
        raise InputError(f"there is no {PUBLISHED / 'rows'} here; publish from the project's own folder")
    rows = {name: read_csv(ROWS / f"{name}.csv") for name in options.experiments}
    tables = [make_table(own, title=name) for name, own in rows.items()]
    write_tables(tables, PUBLISHED / "tables")
    for name, own in rows.items():
        write_csv(PUBLISHED / "rows" / f"{name}.csv", own)
        figures = [path for suffix in SUFFIXES if (path := FIGURES / f"{name}{suffix}").is_file()]
        make_folder(PUBLISHED / "figures")
        for figure in figures:
            with replacing(PUBLISHED / "figures" / figure.name) as temporary:
                shutil.copyfile(figure, temporary)
        told = "".join(f", {path.name}" for path in figures)
        print(f"{name}: {len(own)} rows and their tables{told} in {PUBLISHED}")  # noqa: T201
    return 0
