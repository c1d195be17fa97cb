"""Files of registered meshes and animations: found by name, read with that name in every complaint."""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from defaust.sources.animations import SUFFIX, read_counts, read_frame
from defaust.sources.choices import shortened
from defaust.sources.matlab import read_surface
from sshade import InputError, Mesh
from sshade.io.meshes import read_arrays

#: Mesh formats that keep shared vertices, the first that is there first.
MESH_SUFFIXES = (".ply", ".off", ".obj")
#: All formats of one mesh a file. A .vert has its .tri beside it.
SUFFIXES = (*MESH_SUFFIXES, ".vert", ".mat")
LAYOUTS = ("auto", "tosca", "sequence")
#: Name of the class where a folder is one sequence: the folder's own must not enter the record.
SEQUENCE = "sequence"


@dataclass(frozen=True)
class Shape:
    """One mesh in a file.

    Parameters
    ----------
    name : str
        The file's name without its suffix, or that of the array or the frame.
    path : Path
    array : str
        Name of the positions in an archive; empty for a file of its own.
    frame : int, optional
        Of an animation.
    """

    name: str
    path: Path
    array: str = ""
    frame: int | None = None

    @property
    def files(self) -> tuple[Path, ...]:
        """What it is read from."""
        second = (self.path.with_suffix(".tri"),) if self.path.suffix.lower() == ".vert" else ()
        return (self.path, *second)

    @property
    def label(self) -> str:
        """What complaints about it begin with."""
        inside = self.array or self.frame is not None
        return f"{self.path.name}, {self.name}" if inside else self.path.name

    def mesh(self, *, whole: bool = False) -> Mesh:
        """Read the mesh.

        Parameters
        ----------
        whole : bool
            It must be manifold and of one component.

        Raises
        ------
        InputError
            With the file's name.
        """
        V, F = self.arrays()
        with self.named():
            mesh = Mesh(V, F)
            if whole:
                mesh.require_manifold()
                mesh.require_one_component()
            return mesh

    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices and faces as they stand in the file, not validated; InputError with its name."""
        with self.named():
            for path in self.files:
                if not path.is_file():
                    raise InputError(f"{path}: no such file")
            if self.array:
                return _read_archive(self.path, array=self.array)
            if self.frame is not None:
                return read_frame(self.path, self.frame)
            read = {".vert": _read_vert_tri, ".mat": _read_mat}.get(self.path.suffix.lower(), read_arrays)
            return read(self.path)

    @contextmanager
    def named(self) -> Iterator[None]:
        """Begin the text of an InputError with the file's name, without its folder, which no record names."""
        try:
            yield
        except InputError as error:
            text = str(error).replace(f"{self.path.parent}{os.sep}", "")
            own = tuple(f"{path.name}:" for path in self.files)
            raise InputError(text if text.startswith(own) else f"{self.label}: {text}") from error


def mesh_files(folder: Path, suffixes: Sequence[str] = SUFFIXES) -> dict[str, Path]:
    """Find the meshes in a folder, by name without suffix; of several formats the first of `suffixes`."""
    found: dict[str, Path] = {}
    for suffix in reversed(suffixes):
        for path in folder.iterdir():
            if path.suffix.lower() == suffix and path.is_file() and not path.name.startswith("."):
                found[path.stem] = path
    return found


def find_shapes(root: Path, *, layout: str) -> tuple[dict[str, tuple[Shape, ...]], dict[str, str]]:
    """The classes of a folder, by name, or the one sequence of a folder or of an .npz file.

    Beside them what is of no class, by name, and why: meshes that do not fit the layout ``tosca``,
    animations that cannot be read.

    Parameters
    ----------
    root : Path
        Of animations the file, or a folder that holds some at any depth and no other meshes: each
        file is a class, its frames are ``frame_0``, ``frame_1``, ...
    layout : str
        ``tosca``: <class><number>.<suffix>, in the order of the numbers;
        ``sequence``: all files are one sequence, sorted by name, numbers in
        the names as numbers; ``auto``: tosca where every name fits it. Of no matter to animations.

    Raises
    ------
    InputError
        When there are no meshes, or none whose name fits the layout, or none that can be read.
    """
    if root.suffix.lower() == SUFFIX and root.is_file():
        return _animations([root])
    if root.is_file():
        return {root.stem: _archive_shapes(root)}, {}
    files = mesh_files(root)
    if not files:
        paths = [path for path in root.rglob(f"*{SUFFIX}") if path.is_file() and path.name[0] != "."]
        if paths:
            return _animations(sorted(paths, key=lambda path: _natural(path.stem)))
        raise InputError(
            f"{root} holds no meshes ({', '.join((*SUFFIXES, SUFFIX))}); set source.root to their folder, or "
            "to an .npz"
        )
    shapes = [Shape(name, files[name]) for name in sorted(files, key=_natural)]
    parts = [re.fullmatch(r"([A-Za-z]+)\d+", shape.name) for shape in shapes]
    if layout == "sequence" or (layout == "auto" and not all(parts)):
        return {SEQUENCE: tuple(shapes)}, {}
    unfit = [shape.name for shape, match in zip(shapes, parts, strict=True) if not match]
    if not any(parts):
        raise InputError(
            f"{root}: {shortened(unfit)} do not read as a class and a number, like cat0; "
            "rename them, or set source.layout=sequence"
        )
    of = [match[1] if match else "" for match in parts]
    classes = sorted(set(of) - {""})
    found = {name: tuple(s for s, own in zip(shapes, of, strict=True) if own == name) for name in classes}
    return found, dict.fromkeys(unfit, "its name does not read as a class and a number, like cat0")


def _animations(paths: Sequence[Path]) -> tuple[dict[str, tuple[Shape, ...]], dict[str, str]]:
    found: dict[str, tuple[Shape, ...]] = {}
    unreadable = {}
    for path in paths:
        if path.stem in found or path.stem in unreadable:
            raise InputError(f"{path}: another file is called {path.name}; classes need names of their own")
        try:
            with Shape(path.stem, path).named():
                frames = read_counts(path).frames
        except InputError as error:
            unreadable[path.stem] = str(error)
        else:
            found[path.stem] = tuple(Shape(f"frame_{k}", path, frame=k) for k in range(frames))
    if not found:
        raise InputError(unreadable[paths[0].stem])
    return found, unreadable


def existing(root: Any, *, option: str) -> Path:
    """The path that the user named; InputError where nothing is there."""
    path = Path(str(root)).expanduser()
    if not path.exists():
        raise InputError(f"{path}: no such folder; set {option}")
    return path


def _natural(name: str) -> list[tuple[int, str]]:
    """Sorts frame9 before frame10."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", name)]


def _archive_shapes(path: Path) -> tuple[Shape, ...]:
    with _open_archive(path) as archive:
        names = [name for name in archive.files if re.fullmatch(r"V_\d+", name)]
        if not names or "F" not in archive.files:
            raise InputError(
                f"{path}: holds {shortened(archive.files) or 'nothing'}; it needs positions V_0, V_1, ... "
                "and triangles F"
            )
    return tuple(Shape(name, path, name) for name in sorted(names, key=_natural))


@contextmanager
def _open_archive(path: Path) -> Iterator[Any]:
    with path.open("rb") as file:
        archive = _reading(path, lambda: np.load(file, allow_pickle=False))
        if not isinstance(archive, np.lib.npyio.NpzFile):
            raise InputError(f"{path}: not an .npz file; give a folder of meshes or an .npz")
        with archive:
            yield archive


def _read_archive(path: Path, *, array: str) -> tuple[np.ndarray, np.ndarray]:
    with _open_archive(path) as archive:
        return _reading(path, lambda: (archive[array].astype(np.float64), archive["F"].astype(np.int64)))


def _read_vert_tri(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Two text tables; the triangles count from 1."""
    V = _reading(path, lambda: np.loadtxt(path, dtype=np.float64, ndmin=2))
    tri = path.with_suffix(".tri")
    return V, _from_one(_reading(tri, lambda: np.loadtxt(tri, dtype=np.int64, ndmin=2)), path=tri)


def _read_mat(path: Path) -> tuple[np.ndarray, np.ndarray]:
    V, F = _reading(path, lambda: read_surface(path))
    return V, _from_one(F, path=path)


def _reading(path: Path, read: Callable[[], Any]) -> Any:
    """What `read` returns; any failure becomes one sentence that names the file."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # an empty table: the next check says so
            return read()
    except Exception as error:  # a reader fails in many ways, all of them the file's fault
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: not readable as {path.suffix} ({reason})") from error


def _from_one(F: np.ndarray, *, path: Path) -> np.ndarray:
    if F.size and F.min() < 1:
        raise InputError(f"{path}: its vertices must count from 1, but one is {int(F.min())}")
    return F - 1
