"""Input files of the cases. Most functions return a writer, which puts a file into the working folder."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from sshade import Handles
from sshade.files.meshes import write_mesh
from sshade.files.task_files import write_handles
from tests.shapes import bumpy, end_handles

BODY = bumpy(2)

Given = Callable[[], None]


def pose(V: np.ndarray) -> Handles:
    """Return handles: the lowest tenth along z stays, the highest tenth moves sideways and up."""
    return end_handles(V, shift=np.ptp(V[:, 2]) * np.array([0.1, 0, 0.05]))


def write_sound() -> None:
    """Write the sound files that every case begins with."""
    write_mesh("body.ply", BODY.V, BODY.F)
    write_handles("pose.json", pose(BODY.V))


def both(*parts: Given) -> Given:
    """Return a writer that calls several writers in their order."""

    def write() -> None:
        for part in parts:
            part()

    return write


def mesh(V: Any, F: Any, path: str = "body.ply") -> Given:
    """A mesh file."""
    return lambda: write_mesh(path, np.asarray(V, dtype=float), np.asarray(F, dtype=np.int64).reshape(-1, 3))


def data(path: str, content: bytes) -> Given:
    """A file with the bytes `content`; its folders are made, too."""

    def write() -> None:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        Path(path).write_bytes(content)

    return write


def text(path: str, content: str) -> Given:
    """A text file."""
    return data(path, content.encode())


def cut(path: str, share: float) -> Given:
    """A file cut to the fraction `share` of its length; a negative `share` counts bytes off its end."""

    def write() -> None:
        content = Path(path).read_bytes()
        Path(path).write_bytes(content[: int(share * len(content)) if share > 0 else int(share)])

    return write


def patched(path: str, old: bytes, new: bytes) -> Given:
    """A file in which `new` replaces `old`; the file must contain `old`."""

    def write() -> None:
        content = Path(path).read_bytes()
        assert old in content, f"{old!r} is not in {path}"
        Path(path).write_bytes(content.replace(old, new))

    return write
