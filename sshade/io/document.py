"""A mesh file as it was read: positions and triangles, and all else, to be written with other positions."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np


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
    content: Callable[[np.ndarray, Path], bytes | bytearray]

    def __post_init__(self) -> None:
        for array in (self.V, self.F):  # so that a mesh of them needs no copies
            array.setflags(write=False)

    def lost(self, path: str | os.PathLike[str]) -> tuple[str, ...]:
        """What a file at `path` cannot take over, as its name ends otherwise."""
        return () if Path(path).suffix.lower() in self.suffixes else self.holds


def present(**found: object) -> tuple[str, ...]:
    """The names, with spaces for underlines, of what there is."""
    return tuple(name.replace("_", " ") for name, there in found.items() if there)


def fanned(polygons: list[np.ndarray], which: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of polygons, fanned from their first corners.

    Parameters
    ----------
    polygons : list of (p, k) int64
        Those of k corners each.
    which : list of (p,) int64
        Their numbers in the file.

    Returns
    -------
    F : (m, 3) int64
        In the order of the file.
    face : (m,) int64
        The polygon of each.
    """
    if len(polygons) == 1 and polygons[0].shape[1] == 3:
        return polygons[0], which[0]
    F, face = [np.zeros((0, 3), dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for ids, numbers in zip(polygons, which, strict=True):
        k = ids.shape[1]
        first = np.repeat(ids[:, :1], k - 2, axis=1)
        F.append(np.stack([first, ids[:, 1:-1], ids[:, 2:]], axis=2).reshape(-1, 3))
        face.append(np.repeat(numbers, k - 2))
    order = np.argsort(np.concatenate(face), kind="stable")
    return np.concatenate(F)[order], np.concatenate(face)[order]


def moved_reference(name: str, source: Path, path: Path) -> str:
    """The name of a file that `source` refers to, as `path` has to; absolute ones and URLs stay."""
    here, there = source.resolve().parent, path.resolve().parent
    if here == there or Path(name).is_absolute() or len(urlsplit(name).scheme) > 1:
        return name
    return Path(os.path.relpath(here / name, there)).as_posix()
