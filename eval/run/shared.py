"""A run that another experiment has made: taken along, in place of running it again."""

from __future__ import annotations

import shutil
from pathlib import Path

from sshade.io.files import make_folder, replacing


def take_along(run: Path, folder: Path) -> None:
    """Copy a run's folder: the row last, so that a folder with a row is complete."""
    make_folder(folder)
    for name in ("vertices.npy", "curves.npz", "row.json"):
        if (run / name).is_file():
            with replacing(folder / name) as temporary:
                shutil.copyfile(run / name, temporary)
