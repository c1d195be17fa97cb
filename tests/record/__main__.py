"""Record anew: ``python -m tests.record [NAME ...]``. Lines that are the same but for rounding stay.

Read the changes with ``git diff`` before you commit them: each is what a user sees, or work that is done
more or less often.
"""

import os
import sys
import tempfile
from contextlib import chdir
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from tests.record import transcript, work
from tests.record.compared import differences, settled


def record(names: list[str]) -> None:
    for part in (transcript, work):
        for name in part.transcripts():
            if names and name not in names:
                continue
            path = part.HERE / f"{name}.txt"
            before = part.recorded(name) if path.exists() else []
            with tempfile.TemporaryDirectory() as folder, chdir(folder):
                found = part.played(before) if part is transcript else part.played(name)
            if changes := differences(found, before):
                path.write_text("\n".join(settled(found, before)) + "\n", "utf-8")
                print(f"{path.relative_to(Path.cwd())}: {len(changes)} lines of differences")  # noqa: T201


if __name__ == "__main__":
    if not work.COUNTS:
        sys.exit("records are written with Python 3.11, which counts all calls")
    record(sys.argv[1:])
