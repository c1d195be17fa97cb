"""Paths that the editor may write: beside the mesh, or given on the command line."""

from __future__ import annotations

from pathlib import Path

from sshade.errors import InputError
from sshade.io.files import check_output
from sshade.io.meshes import SUFFIXES

#: Suffixes of the files that are saved, by content.
FORMATS = {"handles": (".json",), "mesh": SUFFIXES}
#: Greatest length of a file name, which every file system accepts.
LONGEST = 120


class FileExists(InputError):
    """A file of this name exists, and this editor did not write it."""


class Outputs:
    """Files that the editor writes, by content: ``handles`` and ``mesh``.

    Parameters
    ----------
    mesh : path
        The edited mesh.
    output, handles : path, optional
        Files for the deformed mesh and the handles. They are replaced without a question. By default the
        files lie beside the mesh and are named after it.

    Attributes
    ----------
    path : dict
        Path of the file that is proposed for the next save, by content.

    Raises
    ------
    InputError
        When a given path cannot be written, or is the mesh itself.
    """

    def __init__(self, mesh: Path, *, output: Path | None = None, handles: Path | None = None) -> None:
        self._mesh = mesh
        self.path = {
            "mesh": output or mesh.with_name(f"{mesh.stem}_deformed{mesh.suffix}"),
            "handles": handles or mesh.with_name(f"{mesh.stem}_handles.json"),
        }
        self._replaceable: set[Path] = set()
        for content, path in (("mesh", output), ("handles", handles)):
            if path is not None:
                self._check(content, path)
                self._replaceable.add(path.resolve())

    def choose(self, content: str, name: str, *, over: bool = False) -> Path:
        """Return the path for a file name that the user typed, in the folder of the proposed path.

        Parameters
        ----------
        content : {"handles", "mesh"}
        name : str
            Name of a file, without a folder.
        over : bool
            Allow replacing an existing file.

        Raises
        ------
        InputError
            On another content, or when `name` is not the plain name of a file with a suffix of the content,
            or is the edited mesh.
        FileExists
            When the file exists and may not be replaced.
        """
        if content not in FORMATS:
            raise InputError(f"{content!r} cannot be saved: use {' or '.join(FORMATS)}")
        plain = Path(name).name == name and "\\" not in name and ":" not in name and name.isprintable()
        if not (name and plain) or name.startswith(".") or len(name) > LONGEST:
            raise InputError(f"{name!r}: give the name of a file alone, without a folder")
        path = self.path[content].with_name(name)
        self._check(content, path)
        if path.exists() and not over and path.resolve() not in self._replaceable:
            raise FileExists(f"{name} exists already")
        return path

    def written(self, content: str, path: Path) -> None:
        """Propose a path from now on; it may be replaced without a question."""
        self.path[content] = path
        self._replaceable.add(path.resolve())

    def _check(self, content: str, path: Path) -> None:
        check_output(path, FORMATS[content])
        if path.resolve() == self._mesh.resolve():
            raise InputError(f"{path} is the mesh that is edited; save under another name")
