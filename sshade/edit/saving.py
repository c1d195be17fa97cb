"""Where an editor may write: beside the mesh, or where the command line said."""

from __future__ import annotations

import shlex
from pathlib import Path

from sshade.edit.state import Settings
from sshade.errors import InputError
from sshade.io.files import check_output
from sshade.io.meshes import SUFFIXES

#: What is saved, and the formats of it.
FORMATS = {"handles": (".json",), "mesh": SUFFIXES}
#: Characters of a name, which every file system takes.
LONGEST = 120


class FileExists(InputError):
    """A file of that name stands there, which this editor did not write."""


class Outputs:
    """The files that an editor writes, by what they hold: ``handles`` and ``mesh``.

    Parameters
    ----------
    mesh : path
        The mesh that is edited.
    output, handles : path, optional
        The files for the deformed mesh and the handles; by default they lie beside the mesh and have its
        name. Those named here are written over without a question.

    Raises
    ------
    InputError
        When one that is named could not be written, or is the mesh itself.
    """

    def __init__(self, mesh: Path, *, output: Path | None = None, handles: Path | None = None) -> None:
        self._mesh = mesh
        named = {"mesh": output, "handles": handles}
        self._own = {path.resolve() for path in named.values() if path is not None}
        beside = {
            "mesh": mesh.with_name(f"{mesh.stem}_deformed{mesh.suffix}"),
            "handles": mesh.with_name(f"{mesh.stem}_handles.json"),
        }
        self.path = {what: path or beside[what] for what, path in named.items()}
        for what, path in named.items():
            if path is not None:
                self._check(what, path)

    def choose(self, what: str, name: str, *, over: bool = False) -> Path:
        """The path for a name that a person gave: in the folder of the usual one.

        Parameters
        ----------
        what : {"handles", "mesh"}
        name : str
            Of a file, without a folder.
        over : bool
            An existing file may be replaced.

        Raises
        ------
        InputError
            On anything but the plain name of a file of such a format, or on the mesh that is edited.
        FileExists
            Where there is one that may not.
        """
        plain = Path(name).name == name and "\\" not in name and ":" not in name and name.isprintable()
        if not (name and plain) or name.startswith(".") or len(name) > LONGEST:
            raise InputError(f"{name!r}: give the name of a file alone, without a folder")
        path = self.path[what].with_name(name)
        self._check(what, path)
        if path.exists() and not over and path.resolve() not in self._own:
            raise FileExists(f"{name} exists already")
        return path

    def written(self, what: str, path: Path) -> None:
        """Take a path as the usual one from now on."""
        self.path[what] = path
        self._own.add(path.resolve())

    def command(self, settings: Settings, *, carry_unconstrained: bool) -> str:
        """The command that deforms the mesh with these files as the editor does."""
        method = [] if settings.method == "sshade_fast" else ["--method", settings.method]
        carry = ["--carry-unconstrained"] if carry_unconstrained else []
        paths = [str(self._mesh), str(self.path["handles"]), "-o", str(self.path["mesh"])]
        return shlex.join(["sshade", "deform", *paths, *method, *carry])

    def _check(self, what: str, path: Path) -> None:
        check_output(path, FORMATS[what])
        if path.resolve() == self._mesh.resolve():
            raise InputError(f"{path} is the mesh that is edited; save under another name")
