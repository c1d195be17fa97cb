"""Write files that appear whole or not at all, in folders that are created with them."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sshade.io.files import make_folder, replacing


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
