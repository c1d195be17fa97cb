"""Find and read the files of registered meshes. Error messages name the file."""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from defaust.sources.choices import shortened
from sshade import InputError
from sshade.core.natural import natural
from sshade.files.meshes import read_arrays

#: Mesh formats that keep shared vertices, in order of preference.
MESH_SUFFIXES = (".ply", ".off", ".obj")
#: All formats with one mesh a file, in order of preference. A .vert file needs a .tri file beside it.
SUFFIXES = (*MESH_SUFFIXES, ".vert", ".mat", ".vtp", ".vtu", ".vtk", ".3mf")
LAYOUTS = ("auto", "tosca", "sequence")
#: Name of the only class of a sequence. The folder's own name must not enter the record.
SEQUENCE = "sequence"
#: Reason to leave out a file in the layout ``tosca``.
NO_CLASS = "its name does not read as a class and a number, like cat0"

Classes = dict[str, tuple["SourceShape", ...]]


@dataclass(frozen=True)
class SourceShape:
    """A mesh in a file.

    Parameters
    ----------
    name : str
        Name of the file without suffix.
    path : Path
    """

    name: str
    path: Path

    @property
    def files(self) -> tuple[Path, ...]:
        """The files that hold the mesh."""
        second = (self.path.with_suffix(".tri"),) if self.path.suffix.lower() == ".vert" else ()
        return (self.path, *second)

    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Read vertices and faces without validating them; an InputError names the file."""
        with self.named():
            read = {".vert": _read_vert_tri, ".mat": _read_mat}.get(self.path.suffix.lower(), read_arrays)
            return read(self.path)

    @contextmanager
    def named(self) -> Iterator[None]:
        """Put the file's name before the text of an InputError, without its folder, for dataset.json."""
        try:
            yield
        except InputError as error:
            text = str(error).replace(f"{self.path.parent}{os.sep}", "")
            if not text.startswith(tuple(f"{path.name}:" for path in self.files)):
                text = f"{self.path.name}: {text}"
            raise InputError(text) from error


def mesh_files(folder: Path, suffixes: Sequence[str] = SUFFIXES) -> dict[str, Path]:
    """Find the meshes in a folder by name without suffix; earlier `suffixes` take precedence."""
    paths = [path for path in folder.iterdir() if path.suffix.lower() in suffixes and path.name[0] != "."]
    paths.sort(key=lambda path: suffixes.index(path.suffix.lower()), reverse=True)
    return {path.stem: path for path in paths if path.is_file()}


def find_shapes(root: Path, *, layout: str) -> tuple[Classes, dict[str, str]]:
    """Find the meshes of a folder, sorted into classes.

    Parameters
    ----------
    root : Path
        A folder of meshes.
    layout : str
        ``tosca``: files are named <class><number>.<suffix>. ``sequence``: all files are one sequence,
        sorted by name, but ``rest`` is first; numbers in the names are sorted as numbers. ``auto``: tosca if
        all names fit.

    Returns
    -------
    dict
        Meshes of each class.
    dict
        Names of unusable meshes, and the reasons.

    Raises
    ------
    InputError
        When there is no usable mesh.
    """
    files = mesh_files(root)
    if not files:
        deeper = sorted(path.name for path in root.iterdir() if path.is_dir() and mesh_files(path))
        where = f"one of its folders ({', '.join(deeper)})" if deeper else "their folder"
        raise InputError(f"{root} holds no meshes ({', '.join(SUFFIXES)}); set source.root to {where}")
    names = sorted(files, key=lambda name: (name.lower() != "rest", natural(name)))
    match = {name: re.fullmatch(r"([A-Za-z]+)\d+", name) for name in names}
    if layout == "sequence" or (layout == "auto" and not all(match.values())):
        return {SEQUENCE: tuple(SourceShape(name, files[name]) for name in names)}, {}
    unfit = [name for name in names if not match[name]]
    if len(unfit) == len(names):
        raise InputError(
            f"{root}: {shortened(unfit)} do not read as a class and a number, like cat0; "
            "rename them, or set source.layout=sequence"
        )
    classes: dict[str, list[SourceShape]] = {}
    for name in names:
        if found := match[name]:
            classes.setdefault(found[1], []).append(SourceShape(name, files[name]))
    return {name: tuple(classes[name]) for name in sorted(classes)}, dict.fromkeys(unfit, NO_CLASS)


def existing(root: Any, *, option: str) -> Path:
    """Folder that the user named; InputError if there is none."""
    path = Path(os.path.expanduser(str(root)))
    if path.is_file():
        raise InputError(f"{path} is a file; give a folder")
    if not path.is_dir():
        raise InputError(f"{path}: no such folder; set {option}")
    return path


def _read_vert_tri(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read two text tables; the triangles count from 1."""
    V = _reading(path, lambda: np.loadtxt(path, dtype=np.float64, ndmin=2))
    tri = path.with_suffix(".tri")
    return V, _from_one(_reading(tri, lambda: np.loadtxt(tri, dtype=np.int64, ndmin=2)), path=tri)


def _read_mat(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read a struct with X, Y, Z and TRIV, such as TOSCA's ``surface``; the triangles count from 1."""
    from scipy.io import loadmat

    for value in _reading(path, lambda: loadmat(path, simplify_cells=True)).values():
        if isinstance(value, Mapping) and {"X", "Y", "Z", "TRIV"} <= set(value):
            V = np.stack([np.ravel(value[axis]).astype(np.float64) for axis in "XYZ"], axis=1)
            return V, _from_one(np.atleast_2d(value["TRIV"]).astype(np.int64), path=path)
    raise InputError(f"{path}: it holds no struct with X, Y, Z and TRIV")


def _reading(path: Path, read: Callable[[], Any]) -> Any:
    """Return the result of `read`; report any failure as an InputError that names the file."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # an empty table fails the next check
            return read()
    except Exception as error:  # a reader fails in many ways, always because of the file
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: not readable as {path.suffix} ({reason})") from error


def _from_one(F: np.ndarray, *, path: Path) -> np.ndarray:
    """Count vertices from 0 instead of 1."""
    if F.size and F.min() < 1:
        raise InputError(f"{path}: its vertices must count from 1, but one is {int(F.min())}")
    return F - 1
