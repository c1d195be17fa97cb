"""Where runs, rows and results are, and how their files are written: whole or not at all."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from eval import CONFIGURATION
from sshade.core.errors import InputError, reason
from sshade.core.whole_files import replacing

#: Default folder of runs, with one folder per experiment.
RUNS = Path("out/runs")
#: Default folder of collected rows, with one CSV per experiment.
ROWS = Path("out/rows")
#: Folder of the rows of times: one CSV a name.
TIMING = Path("out/timing")
#: Folder of committed rows, tables and figures. Only `sshade-eval tables --publish` writes there.
PUBLISHED = Path("results")
FOLDER_HELP = "name of an experiment in out/runs, such as mine or mine_mesh, or a folder of runs"
ROWS_HELP = "CSV of rows, or name of an experiment in out/rows or else results/rows"


def add_out(parser: argparse.ArgumentParser, default: Path, what: str) -> None:
    """Declare -o, the path of an output that is `what`."""
    parser.add_argument("-o", "--out", type=Path, default=default, help=f"{what} (default: {default})")


def experiment_folder(name: Path) -> Path:
    """Return a folder of runs, from its path or from the name of its experiment.

    Raises
    ------
    InputError
        When there is no such folder.
    """
    for folder in (name, RUNS / name):
        # A folder such as "quick" in the current folder may hold anything; skip it unless it holds runs.
        if next(folder.rglob("row.json"), None) is not None:
            return folder
    here = ", ".join(sorted(path.name for path in RUNS.glob("*") if has_runs(path.name))) or "none"
    raise InputError(f"no runs in {name} or {RUNS / name}; {RUNS} has {here}")


def has_runs(name: str | os.PathLike[str]) -> bool:
    """Whether the experiment with a name has a folder of runs."""
    return next((RUNS / name).rglob("row.json"), None) is not None


def rows_file(name: str | os.PathLike[str], folder: Path = ROWS) -> Path:
    """Return the CSV of a path or of a name; searches a folder of ``out`` before that of ``results``."""
    if Path(name).suffix == ".csv":
        return Path(name)
    own, published = folder / f"{name}.csv", PUBLISHED / folder.name / f"{name}.csv"
    return published if published.is_file() and not own.is_file() else own


def read_conf(name: str) -> Any:
    """Return the content of the file ``conf/<name>.yaml``."""
    import yaml

    return yaml.safe_load((CONFIGURATION / f"{name}.yaml").read_text(encoding="utf-8"))


@cache
def method_files() -> dict[str, Path]:
    """Return the files of ``conf/method`` by their names there, such as ``transfer/paper``."""
    folder = CONFIGURATION / "method"
    return {
        path.relative_to(folder).with_suffix("").as_posix(): path for path in sorted(folder.rglob("*.yaml"))
    }


def make_folder(path: str | os.PathLike[str]) -> None:
    """Create a folder and its parents unless they exist.

    Raises
    ------
    InputError
        When the folder cannot be created: a file is in its way, a parent is read-only, the disk is full.
    """
    try:
        Path(path).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{path}: the folder cannot be created ({reason(error)})") from error


@contextmanager
def writing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path that becomes `path` on success: :func:`sshade.core.whole_files.replacing`."""
    make_folder(Path(path).parent)
    with replacing(path) as temporary:
        yield temporary


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a text file."""
    with writing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
