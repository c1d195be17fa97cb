"""Copy an equal run from another experiment."""

from __future__ import annotations

import shutil
from pathlib import Path

from eval.rows.store import VALID, read_row
from sshade.io.files import make_folder, replacing


def take_along(run: Path, folder: Path) -> None:
    """Copy a valid run to a folder without a valid run. The row is copied last and marks a complete run."""
    there, here = read_row(run), read_row(folder)
    if there is None or there["status"] not in VALID or (here is not None and here["status"] in VALID):
        return
    make_folder(folder)
    for name in ("vertices.npy", "curves.npz", "row.json"):
        if (run / name).is_file():
            with replacing(folder / name) as temporary:
                shutil.copyfile(run / name, temporary)
