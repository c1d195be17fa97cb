"""A mesh file in memory: its mesh, and everything else that is needed to write the file again.

The readers of all formats use this module: they return a :class:`MeshFile`, and convert polygons and strips
to triangles here.
"""

from __future__ import annotations

import filecmp
import os
import re
import shutil
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath
from urllib.parse import urlsplit

import numpy as np

from sshade.core.errors import InputError
from sshade.core.whole_files import check_suffix, replacing
from sshade.problem.similarity import LPS_RAS

#: Suffixes of the formats of meshes that are read and written.
SUFFIXES = (".ply", ".obj", ".off", ".stl", ".glb", ".gltf")
#: Declaration of a coordinate system, as 3D Slicer writes it into comments and headers.
DECLARED = re.compile(rb"SPACE=(LPS|RAS)")
#: Suffixes of files that hold several poses, as morph targets.
MORPHS = (".glb", ".gltf")


def check_input(path: Path, suffixes: Collection[str]) -> None:
    """Raise InputError unless `path` is a file with one of the suffixes."""
    check_suffix(path, suffixes)
    if not path.is_file():
        there = "is a folder" if path.is_dir() else "is a pipe or a device, which cannot be read"
        raise InputError(
            f"{path}: {f'{there}; give the name of a file' if path.exists() else 'no such file'}"
        )


def as_floats(V: np.ndarray, path: Path) -> np.ndarray:
    """Return positions (n, 3) as float32, and raise InputError where a position is too large for it."""
    with np.errstate(over="ignore", under="ignore"):
        floats = V.astype(np.float32)
    if (np.isinf(floats) & np.isfinite(V)).any():
        raise InputError(f"{path}: a position is too large for the single precision of this format")
    return floats


def between(space: str, other: str) -> np.ndarray:
    """Return the factors (3,) that convert positions between LPS and RAS; 1 if either system is unknown."""
    return LPS_RAS if {space, other} == {"LPS", "RAS"} else np.ones(3)


def unchanged(V: np.ndarray) -> np.ndarray:
    """Return positions (n, 3) as decimals or float64 hold them."""
    return V


@dataclass(frozen=True, eq=False)
class MeshFile:
    """Contents of a mesh file.

    Attributes
    ----------
    V : (n, 3) float64
        Positions, in the order and the unit of length of the file.
    F : (m, 3) int64
        Triangles. Polygons are fanned from their first corners; the file keeps its polygons.
    holds : tuple of str
        Names of further contents, such as "texture coordinates".
    suffixes : tuple of str
        Suffixes of the formats that can hold all contents.
    content : callable
        ``content(V, path)`` returns the bytes of the file with positions `V` (n, 3), to be written to `path`.
        Normals and tangents turn with the surface, and references to other files are relative to `path`.
        Everything else stays as it is. Numbers keep their type.
    notes : tuple of str
        Oddities of the file, such as values that its header does not declare: one clause each, to be
        printed behind the name of the file.
    stored : callable, optional
        ``stored(V)`` returns positions V (n, 3) as the numbers of the file hold them; by default unchanged.
        None if only reading the file again tells.
    rounding : (3,) float64, optional
        Rounding steps of the coordinates, where the file holds them in single precision.
    source, named : Path and tuple of str
        The file, and the names of the files that it refers to. Files in its folder are copied beside an
        output elsewhere.
    parts : tuple of (int, str)
        Number of the first triangle and name of each part that the file names, in their order.
    space : str
        Coordinate system that the file declares, LPS or RAS; empty if it declares none.
    """

    V: np.ndarray
    F: np.ndarray
    holds: tuple[str, ...]
    suffixes: tuple[str, ...]
    content: Callable[[np.ndarray, Path], bytes | memoryview]
    notes: tuple[str, ...] = ()
    rounding: np.ndarray | None = None
    stored: Callable[[np.ndarray], np.ndarray] | None = unchanged
    source: Path = Path()
    named: tuple[str, ...] = ()
    parts: tuple[tuple[int, str], ...] = ()
    space: str = ""

    def __post_init__(self) -> None:
        for array in (self.V, self.F):  # so that Mesh need not copy them
            array.setflags(write=False)

    def lost(self, path: str | os.PathLike[str]) -> tuple[str, ...]:
        """Return the names of contents that the format of `path` cannot hold."""
        if Path(path).suffix.lower() in self.suffixes:
            return ()
        return self.holds + ((f"declaration SPACE={self.space}",) if self.space else ())

    def require_triangles(self) -> None:
        """Raise InputError if the file holds points alone."""
        if not len(self.F):
            raise InputError("the file holds no triangles; give a mesh with faces")


def present(**found: object) -> tuple[str, ...]:
    """Return the names of the true arguments, with spaces for underscores."""
    return tuple(name.replace("_", " ") for name, there in found.items() if there)


def listed(names: Sequence[str]) -> str:
    """Join names as a sentence does: "normals, colours and comments"."""
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


def beside(source: Path, name: str) -> Path:
    """Return the path of a file that `source` names; programs of Windows write backslashes."""
    return source.parent / os.path.normpath(name.replace("\\", "/"))


def goes_along(name: str, source: Path, path: Path) -> bool:
    """Whether a file that `source` names can be copied beside `path` under its name.

    It lies in the folder of `source` or below, and no other file has its place.
    """
    file, copy = beside(source, name), beside(path, name)
    inside = not _is_absolute(name) and beside(Path(), name).parts[:1] != ("..",) and file.is_file()
    return inside and (not copy.exists() or filecmp.cmp(file, copy))


def copy_along(names: Sequence[str], source: Path, path: Path) -> None:
    """Copy files that `source` names beside `path`; many readers follow no names out of a folder."""
    for name in names:
        copy = beside(path, name)
        if goes_along(name, source, path) and not copy.exists():
            copy.parent.mkdir(parents=True, exist_ok=True)
            with replacing(copy) as temporary:
                shutil.copy2(beside(source, name), temporary)


def _is_absolute(name: str) -> bool:
    return Path(name).is_absolute() or PureWindowsPath(name).is_absolute()


def moved_reference(name: str, source: Path, path: Path, *, along: bool = True) -> str:
    """Convert a file name in `source` so that it is valid in `path`; absolute names and URLs stay.

    With `along`, the name of a file that goes along stays, too. Names are sought beside `source`, even if it
    is a link to a file elsewhere.
    """
    here, there = source.parent.resolve(), path.parent.resolve()
    stays = _is_absolute(name) or len(urlsplit(name).scheme) > 1
    if here == there or stays or (along and goes_along(name, source, path)):
        return name
    return Path(os.path.relpath(beside(here / source.name, name), there)).as_posix()


def fanned(polygons: list[np.ndarray], numbers: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Fan polygons into triangles from their first corners.

    Parameters
    ----------
    polygons : list of (p, k) int64
        Corners of the polygons with k corners, for each k.
    numbers : list of (p,) int64
        Numbers of these polygons in the file.

    Returns
    -------
    F : (m, 3) int64
        Triangles in the order of the file.
    face : (m,) int64
        Number of the polygon of each triangle.
    """
    if len(polygons) == 1 and polygons[0].shape[1] == 3:
        return polygons[0], numbers[0]
    F, face = [np.zeros((0, 3), dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for ids, polygon in zip(polygons, numbers, strict=True):
        k = ids.shape[1]
        first = np.repeat(ids[:, :1], k - 2, axis=1)
        F.append(np.stack([first, ids[:, 1:-1], ids[:, 2:]], axis=2).reshape(-1, 3))
        face.append(np.repeat(polygon, k - 2))
    order = np.argsort(np.concatenate(face), kind="stable")
    return np.concatenate(F)[order], np.concatenate(face)[order]


def strip_triangles(ids: np.ndarray) -> np.ndarray:
    """Convert strips to triangles (m, 3).

    Triangles that repeat a vertex are left out, because exporters use them to join strips.

    Parameters
    ----------
    ids : (k,) int64
        Vertices of the strips. Negative numbers separate strips.
    """
    from sshade.mesh.mesh import repeats_vertex  # imports large libraries

    i = np.arange(len(ids))
    begin = np.maximum.accumulate(np.where(ids < 0, i, -1)) + 1
    F = np.column_stack([ids[:-2], ids[1:-1], ids[2:]])
    odd = (i - begin)[:-2] % 2 == 1
    F[odd] = F[odd, ::-1]
    return F[(F >= 0).all(axis=1) & ~repeats_vertex(F)]
