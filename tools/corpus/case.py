"""One file of the corpus, and what is expected of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

#: Seed of every random number, together with the name of the case.
SEED = 7


@dataclass(frozen=True)
class Case:
    """A mesh file, perhaps with further files.

    Attributes
    ----------
    name : str
        Unique, with the kind before a slash.
    file : str
        Name of the mesh file.
    files : callable
        Returns the contents (bytes) of all files by name.
    refused : tuple of str
        If the case must be refused: words, one of which the message has to contain.
    says : tuple of str
        Words that the messages must contain if the mesh is deformed.
    handles : bytes, optional
        Contents of the handle file; otherwise handles are made from the mesh.
    expected : (k,) int and (k, 3) float64, optional
        Vertices, and where they must be. Needed beside `handles`, unless the case is refused.
    within : float
        Greatest distance from there, as a fraction of the diagonal.
    output : str
        Suffix of the output, if another than that of the mesh.
    """

    name: str
    file: str
    files: Callable[[], dict[str, bytes]]
    refused: tuple[str, ...] = ()
    says: tuple[str, ...] = ()
    handles: bytes | None = None
    expected: tuple[np.ndarray, np.ndarray] | None = None
    within: float = 1e-6
    output: str = ""

    def write(self, folder: Path) -> None:
        """Write all files of the case."""
        folder.mkdir(parents=True)
        for name, content in self.files().items():
            (folder / name).write_bytes(content)


def one(name: str, file: str, content: Callable[[], bytes], **more: Any) -> Case:
    """Return a case of one file."""
    return Case(name, file, lambda: {file: content()}, **more)
