"""Rows of one sweep by two launchers: ``python same_rows.py FOLDER FOLDER`` fails if they differ."""

import sys
from pathlib import Path

import pandas as pd

from eval.rows.collect import collect

#: Beginnings of columns that may differ: date, machine, memory and times.
DIFFER = ("date", "env.", "peak_mib", "seconds.", "task.source")
RUN = ["method.name", "task.name", "seed"]


def comparable(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the columns that are equal on all machines, with a row for each run in order."""
    assert not rows.duplicated(RUN).any()
    kept = sorted(name for name in rows if not name.startswith(DIFFER) or name.startswith("env.version."))
    return rows.sort_values(RUN)[kept].reset_index(drop=True)


if __name__ == "__main__":
    pd.testing.assert_frame_equal(*(comparable(collect(Path(folder))) for folder in sys.argv[1:]))
