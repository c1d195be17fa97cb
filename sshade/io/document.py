"""A mesh file as it was read: positions and triangles, and all else, to be written with other positions."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np

_SPACE = re.compile(rb"((?:\s|\\\r?\n)+)")


@dataclass(frozen=True, eq=False)
class MeshFile:
    """What a mesh file holds.

    Attributes
    ----------
    V : (n, 3) float64
        Positions, in the file's order and its own unit of length.
    F : (m, 3) int64
        Triangles. A polygon is fanned from its first corner; the file keeps it.
    holds : tuple of str
        What there is besides, such as "texture coordinates".
    suffixes : tuple of str
        Names of files that can hold all of it end so.
    content : callable
        ``content(V, path)`` gives the bytes of the file with positions `V` (n, 3), to stand at `path`.
        Normals and tangents turn with the surface, references to other files are from the new place,
        and all else is as it was. Numbers have the type that they have in the file.
    """

    V: np.ndarray
    F: np.ndarray
    holds: tuple[str, ...]
    suffixes: tuple[str, ...]
    content: Callable[[np.ndarray, Path], bytes]

    def lost(self, path: str | os.PathLike[str]) -> tuple[str, ...]:
        """What a file at `path` cannot take over, as its name ends otherwise."""
        return () if Path(path).suffix.lower() in self.suffixes else self.holds


def present(**found: object) -> tuple[str, ...]:
    """The names, with spaces for underlines, of what there is."""
    return tuple(name.replace("_", " ") for name, there in found.items() if there)


def with_words(line: bytes, words: Mapping[int, bytes]) -> bytes:
    """A text with some of its words replaced, by their number, and the space between them as it was."""
    parts = _SPACE.split(line)
    first = 2 if parts[0] == b"" else 0
    for number, word in words.items():
        parts[first + 2 * number] = word
    return b"".join(parts)


def with_numbers(line: bytes, first: int, old: list[float], new: list[float]) -> bytes:
    """A line whose words from number `first` on are `old`, with `new` ones; equal ones keep their digits."""
    words = {first + i: digits(b) for i, (a, b) in enumerate(zip(old, new, strict=True)) if a != b}
    return with_words(line, words) if words else line


def digits(number: float) -> bytes:
    """The shortest decimals that read back as the same double."""
    return repr(number).encode()


def moved_reference(name: str, source: Path, path: Path) -> str:
    """The name of a file that `source` refers to, as `path` has to; absolute ones and URLs stay."""
    here, there = source.resolve().parent, path.resolve().parent
    if here == there or Path(name).is_absolute() or len(urlsplit(name).scheme) > 1:
        return name
    return Path(os.path.relpath(here / name, there)).as_posix()
