"""Where runs, rows and results are, and how their files are written: whole or not at all."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sshade.errors import InputError
from sshade.io.files import make_folder, replacing

#: Default folder of runs, with one folder per experiment.
RUNS = Path("out/runs")
#: Folder of the plans of an experiment, in the folder of its runs.
PLANS = ".plan"
#: Default folder of collected rows, with one CSV per experiment.
ROWS = Path("out/rows")
#: Folder of the rows of times: one CSV a name.
TIMING = Path("out/timing")
#: Folder of committed rows, tables and figures. Only `sshade-eval publish` writes there.
PUBLISHED = Path("results")
FOLDER_HELP = "name of an experiment in out/runs, or a folder of runs"
ROWS_HELP = "CSV of rows, or name of an experiment in out/rows or else results/rows"


def experiment_folder(name: Path) -> Path:
    """Return a folder of runs, from its path or from the name of its experiment.

    Raises
    ------
    InputError
        When there is no such folder.
    """
    for folder in (name, RUNS / name):
        # A folder such as "quick" in the current folder may hold anything; skip it unless it holds runs.
        if (folder / PLANS).is_dir() or next(folder.rglob("row.json"), None) is not None:
            return folder
    raise InputError(f"no runs in {name} or {RUNS / name}; `sshade-eval run -m experiment=...` makes them")


def rows_file(name: str | os.PathLike[str], folder: Path = ROWS) -> Path:
    """Return the CSV of a path or of a name; searches a folder of ``out`` before that of ``results``."""
    if Path(name).suffix == ".csv":
        return Path(name)
    own, published = folder / f"{name}.csv", PUBLISHED / folder.name / f"{name}.csv"
    return published if published.is_file() and not own.is_file() else own


@contextmanager
def writing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path that becomes `path` on success, as :func:`sshade.io.files.replacing` does."""
    make_folder(Path(path).parent)
    with replacing(path) as temporary:
        yield temporary


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a text file."""
    with writing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def copy_file(source: str | os.PathLike[str], path: str | os.PathLike[str]) -> None:
    """Copy a file."""
    with writing(path) as temporary:
        shutil.copyfile(source, temporary)
