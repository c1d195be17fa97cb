"""Files of the editor: the mesh, and the handle files that it reads and writes."""

from __future__ import annotations

import shlex
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from sshade.core.errors import InputError
from sshade.core.whole_files import check_output, is_same_file, naming
from sshade.edit.groups import Group, groups_of
from sshade.edit.state import EditState
from sshade.files.by_library import WRITABLE
from sshade.files.handle_files import read_handle_file
from sshade.files.meshes import read_file, write_file
from sshade.files.open_shape import on_shape, open_shape
from sshade.files.skin import DrawnSkin, has_skin, skin_on
from sshade.files.task_files import write_handles
from sshade.files.vertex_colours import colours_on
from sshade.problem.task import DeformationTask

#: Suffixes of the files that are saved, by content.
FORMATS = {"handles": (".json",), "mesh": WRITABLE}


class FileExists(InputError):
    """A file of this name exists, and this editor did not write it."""


class Document:
    """A mesh file and the surface in it that can be deformed, and the files that the editor writes.

    Parameters
    ----------
    path : path
        Any mesh file that ``sshade deform`` takes.
    output, handles : path, optional
        Files for the deformed mesh and the handles. They are replaced without a question. By default the
        files lie beside the mesh and are named after it.
    weld, repair
        See :func:`sshade.mesh.surface.surface`.

    Attributes
    ----------
    path : path
    mesh : Mesh
        The surface. Unused vertices of the file are missing, and vertices at one place along a seam are one.
    name : str
    outputs : dict
        Path of the file that is proposed for the next save, by content: "handles" and "mesh".
    notes : tuple of str
        Oddities of the mesh file.

    Raises
    ------
    InputError
        When the file cannot be read, or a given path cannot be written or is the mesh itself.
    """

    def __init__(
        self,
        path: Path,
        *,
        output: Path | None = None,
        handles: Path | None = None,
        weld: float | None = None,
        repair: bool = False,
    ) -> None:
        self.name, self.path = path.name, path
        #: Files that may be replaced without a question.
        self._replaceable: set[Path] = set()
        self.outputs = {
            "mesh": path.with_name(f"{path.stem}_deformed{path.suffix}"),
            "handles": path.with_name(f"{path.stem}_handles.json"),
        }
        for content, given in (("mesh", output), ("handles", handles)):
            if given is not None:
                self._check(content, given)
                self._propose(content, given)
        self._file = read_file(path)
        with naming(path):
            self._shape = open_shape(self._file, weld=weld, repair=repair)
        self.notes = self._file.notes
        self._flags: dict[str, Any] = {} if weld is None else {"weld": weld}
        self._flags |= {"repair": True} if repair else {}
        self.mesh = self._shape.mesh
        self._id = self._shape.surface.original  # handle files name the first of the vertices at one place

    def task(self, state: EditState) -> DeformationTask:
        """Return the task of a method; raise InputError when there are no handles."""
        return self._shape.task(self.name, state.handles(self.mesh))

    def read_groups(self, path: Path) -> tuple[Group, ...]:
        """Read a handle file; raise InputError as :func:`sshade.files.task_files.read_handles`."""
        file = read_handle_file(path)
        with naming(path):
            handles = on_shape(file, self._shape)
        return groups_of(handles, {group.number: group.name for group in file.groups})

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
            When `name` is not the plain name of a file with a suffix of the content,
            or is the edited mesh.
        FileExists
            When the file exists, unless this editor wrote it or its path was given in advance.
        """
        if not name or Path(name).name != name or not name.isprintable():
            raise InputError(f"{name!r}: give the name of a file alone, without a folder")
        path = self.outputs[content].with_name(name)
        self._check(content, path)
        if path.exists() and not over and path.resolve() not in self._replaceable:
            raise FileExists(f"{name} exists already")
        return path

    def _check(self, content: str, path: Path) -> None:
        check_output(path, FORMATS[content])
        if is_same_file(path, self.path):
            raise InputError(f"{path} is the mesh that is edited; save under another name")

    def _propose(self, content: str, path: Path) -> None:
        """Propose a path from now on; it may be replaced without a question."""
        self.outputs[content] = path
        self._replaceable.add(path.resolve())

    def write_handles(self, state: EditState, path: Path) -> None:
        """Write the groups and all options as a handle file; raise InputError when there are no groups."""
        names = {number: group.name for number, group in enumerate(state.groups)}
        handles = state.handles(self.mesh)
        handles = replace(handles, index=self._id[handles.index])
        made = {**state.made, **self._flags}
        write_handles(path, handles, names=names, about={"made": made}, static_at_rest=True)
        self._propose("handles", path)

    def write_mesh(self, V: np.ndarray, path: Path) -> tuple[str, ...]:
        """Write the file with new positions (n, 3) of the mesh; return the contents that the format loses."""
        positions = self._shape.placed(V)
        write_file(path, self._file, positions)
        self._propose("mesh", path)
        return self._file.lost(path)

    @cached_property
    def colours(self) -> np.ndarray | None:
        """Colours (n, 3) uint8 of the vertices, or None; see :mod:`sshade.files.vertex_colours`."""
        return colours_on(self.path, self._shape.surface)

    @property
    def is_coloured(self) -> bool:
        """Whether the file has colours of vertices."""
        return "vertex colours" in self._file.holds and self.colours is not None

    @property
    def size(self) -> tuple[int, int]:
        """Number of vertices and faces of the file."""
        return len(self._file.V), len(self._file.F)

    @property
    def has_skin(self) -> bool:
        """Whether the file has materials."""
        return has_skin(self._file)

    @cached_property
    def skin(self) -> DrawnSkin:
        """The materials of the mesh, ready to be drawn.

        Raises
        ------
        InputError
            When materials or texture coordinates cannot be read.
        """
        return skin_on(self._file, self._shape.surface)

    @property
    def command(self) -> str:
        """Command line that computes the same shape from the saved handles and their options."""
        words = [str(self.path), str(self.outputs["handles"]), "-o", str(self.outputs["mesh"])]
        return shlex.join(["sshade", "deform", *words])
