"""Put own rows with their tables and figures into ``results``: ``sshade-eval tables NAME --publish``."""

from __future__ import annotations

import re
from collections.abc import Mapping

import pandas as pd

from eval.publish.notes import require_one_version
from eval.publish.plotting import FIGURES, SUFFIXES
from eval.rows.files import PUBLISHED, ROWS, copy_file
from eval.rows.frame import newest, numbers, read_csv, write_csv
from sshade.core.errors import InputError

#: The project's packages. Methods from all other packages belong to users.
OWN = ("sshade", "baselines")


def published_rows(name: str) -> pd.DataFrame:
    """Return the rows of an experiment in out/rows, joined with the published ones.

    Rows of a newer version of a method or of the measures replace the older rows.

    Raises
    ------
    InputError
        Outside of the project's folder; if rows are of no commit or of a modified checkout, or mix versions.
    """
    if not (PUBLISHED / "rows").is_dir():
        raise InputError(f"there is no {PUBLISHED / 'rows'} here; publish from the project's own folder")
    path, target = ROWS / f"{name}.csv", PUBLISHED / "rows" / f"{name}.csv"
    new = read_csv(path)
    loose = new[new["env.modified"].ne(False) | new["env.commit"].isna()]
    if len(loose):
        raise InputError(
            f"{len(loose)} of {len(new)} rows of {path} come from a checkout with changes that are not "
            "committed, or from no commit: commit, and run them again with run.force=true"
        )
    targets = [name for name in new if re.fullmatch(r"method\.(.*\.)?target", name)]
    users = new[targets].map(lambda target: target is not None and target.split(".")[0] not in OWN)
    programs = new[[name for name in new if name == "method.command"]].notna()
    if users.any(axis=None) or programs.any(axis=None):
        raise InputError(
            f"{path} has rows of methods or programs that are no part of this project, so that the commit "
            "does not hold their code: propose the methods as CONTRIBUTING.md describes"
        )
    rows = pd.concat([read_csv(target), new], ignore_index=True) if target.is_file() else new
    latest = rows.groupby("method.name")["method.version"].transform("max")
    rows = rows[(rows["method.version"] == latest) & (rows["measures"] == numbers(rows, "measures").max())]
    rows = newest(rows)
    require_one_version(rows)
    return rows


def write_published(rows: Mapping[str, pd.DataFrame]) -> None:
    """Write the rows of experiments by name, and copy the figures with their names."""
    for name, own in rows.items():
        write_csv(PUBLISHED / "rows" / f"{name}.csv", own)
    drawn = [
        FIGURES / f"{name}{end}{suffix}" for name in rows for end in ("", "_time") for suffix in SUFFIXES
    ]
    for figure in (path for path in drawn if path.is_file()):
        copy_file(figure, PUBLISHED / "figures" / figure.name)
