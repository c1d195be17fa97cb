"""The files of an editor: the mesh, and handles that it reads and writes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from sshade.edit.saving import Outputs
from sshade.edit.state import Group, State, groups_of
from sshade.errors import InputError
from sshade.io.handles import read_handles, write_handles
from sshade.io.meshes import read_file, write_file
from sshade.mesh.surface import surface
from sshade.task import DeformationTask


class Document:
    """A mesh file, and how its vertices are those of what can be deformed of it.

    Parameters
    ----------
    path : path
        Any that ``sshade deform`` takes.
    outputs : Outputs
    carry_unconstrained : bool
        See :class:`sshade.DeformationTask`.

    Attributes
    ----------
    mesh : Mesh
        What can be deformed of the file: its vertices, but for unused and doubled ones.
    name : str
    outputs : Outputs
    carry_unconstrained : bool

    Raises
    ------
    InputError
        When the file cannot be read.
    """

    def __init__(self, path: Path, outputs: Outputs, *, carry_unconstrained: bool) -> None:
        self.name, self.outputs, self.carry_unconstrained = path.name, outputs, carry_unconstrained
        self._file = read_file(path)
        try:
            self._surface = surface(self._file.V, self._file.F)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        self.mesh = self._surface.mesh
        used = np.flatnonzero(self._surface.vertex >= 0)
        # Of vertices that stand twice along a seam, the first one stands for both in handle files.
        _, first = np.unique(self._surface.vertex[used], return_index=True)
        self._id = used[first]

    def task(self, state: State) -> DeformationTask:
        """What a method is to do.

        Raises
        ------
        InputError
            When a component has no handle and is not to be carried along, or there are no handles.
        """
        handles = state.handles(self.mesh)
        return DeformationTask(self.name, self.mesh, handles, carry_unconstrained=self.carry_unconstrained)

    def read_groups(self, path: Path, *, first: int, name: str | None = None) -> tuple[Group, ...]:
        """The groups of a handle file.

        Parameters
        ----------
        path : path
        first : int
            Number of the first group.
        name : str, optional
            What messages call the file.

        Raises
        ------
        InputError
            See :func:`sshade.io.handles.read_handles`.
        """
        try:
            handles = read_handles(path, self.mesh, vertex=self._surface.vertex)
        except InputError as error:
            raise InputError(str(error).replace(str(path), name or str(path))) from error
        names = {}
        if path.suffix.lower() == ".json":
            entries = json.loads(path.read_text(encoding="utf-8"))["handles"]
            names = {i: str(own["landmark"]) for i, own in enumerate(entries) if "landmark" in own}
        return groups_of(handles, names, first=first)

    def received_groups(self, content: bytes, name: str, *, first: int) -> tuple[Group, ...]:
        """The groups of a handle file of this project's JSON that somebody sent."""
        with TemporaryDirectory(prefix="sshade-") as folder:
            path = Path(folder, "handles.json")
            path.write_bytes(content)
            return self.read_groups(path, first=first, name=name)

    def write_handles(self, state: State, name: str, *, over: bool) -> Path:
        """Write the groups of a state, by the vertex ids of the mesh file; return where.

        Raises
        ------
        InputError
            See :meth:`sshade.edit.saving.Outputs.choose`; when there are no groups.
        """
        path = self.outputs.choose("handles", name, over=over)
        handles = state.handles(self.mesh)
        made = {"method": state.settings.method, **state.settings.constraints}
        names = {number: group.name for number, group in enumerate(state.groups)}
        own = replace(handles, index=self._id[handles.index])
        write_handles(path, own, names=names, about={"made": made})
        self.outputs.written("handles", path)
        return path

    def write_mesh(self, V: np.ndarray, path: Path) -> tuple[str, ...]:
        """Write the file with other positions (n, 3) of the mesh; return what of it the format has not."""
        write_file(path, self._file, self._surface.placed(self._file.V, V))
        self.outputs.written("mesh", path)
        return tuple(self._file.lost(path))
