"""Files of the editor: the mesh, and the handle files that it reads and writes."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from sshade.edit.saving import Outputs
from sshade.edit.state import Group, Settings, State, groups_of
from sshade.errors import InputError
from sshade.io.files import naming
from sshade.io.handles import read_handles, write_handles
from sshade.io.meshes import read_file, write_file
from sshade.mesh.surface import surface
from sshade.task import DeformationTask


class Document:
    """A mesh file and the surface in it that can be deformed.

    Parameters
    ----------
    path : path
        Any mesh file that ``sshade deform`` takes.
    outputs : Outputs
    carry_unconstrained : bool
        See :class:`sshade.DeformationTask`.

    Attributes
    ----------
    mesh : Mesh
        The surface. Unused vertices of the file are missing, and vertices at one place along a seam are one.
    name : str
    outputs : Outputs

    Raises
    ------
    InputError
        When the file cannot be read.
    """

    def __init__(self, path: Path, outputs: Outputs, *, carry_unconstrained: bool) -> None:
        self.name, self.outputs, self._path = path.name, outputs, path
        self._carry_unconstrained = carry_unconstrained
        self._file = read_file(path)
        with naming(path):
            self._surface = surface(self._file.V, self._file.F)
        self.mesh = self._surface.mesh
        used = np.flatnonzero(self._surface.vertex >= 0)
        # Handle files name the first of the vertices at one place.
        _, first = np.unique(self._surface.vertex[used], return_index=True)
        self._id = used[first]

    def task(self, state: State) -> DeformationTask:
        """Return the task of a method.

        Raises
        ------
        InputError
            When there are no handles, or a component has none and may not follow another component.
        """
        handles = state.handles(self.mesh)
        return DeformationTask(self.name, self.mesh, handles, carry_unconstrained=self._carry_unconstrained)

    def read_groups(self, path: Path, *, first: int) -> tuple[Group, ...]:
        """Read the groups of a handle file; `first` is the number of the first group.

        Raises
        ------
        InputError
            See :func:`sshade.io.handles.read_handles`.
        """
        handles = read_handles(path, self.mesh, vertex=self._surface.vertex)
        names = {}
        if path.suffix.lower() == ".json":
            entries = json.loads(path.read_text(encoding="utf-8"))["handles"]
            names = {i: str(entry["landmark"]) for i, entry in enumerate(entries) if "landmark" in entry}
        return groups_of(handles, names, first=first)

    def received_groups(self, content: bytes, name: str, *, first: int) -> tuple[Group, ...]:
        """Read the groups of a handle file in this project's JSON; messages call it `name`."""
        with TemporaryDirectory(prefix="sshade-") as folder:
            path = Path(folder, "handles.json")
            path.write_bytes(content)
            try:
                return self.read_groups(path, first=first)
            except InputError as error:
                raise InputError(str(error).replace(str(path), name)) from error

    def write_handles(self, state: State, path: Path) -> None:
        """Write the groups as a handle file; raise InputError when there are none."""
        handles = state.handles(self.mesh)
        handles = replace(handles, index=self._id[handles.index])
        names = {number: group.name for number, group in enumerate(state.groups)}
        made = {"method": state.settings.method, **state.settings.constraints}
        write_handles(path, handles, names=names, about={"made": made})
        self.outputs.written("handles", path)

    def write_mesh(self, V: np.ndarray, path: Path) -> tuple[str, ...]:
        """Write the file with new positions (n, 3) of the mesh; return the contents that the format loses."""
        write_file(path, self._file, self._surface.placed(self._file.V, V))
        self.outputs.written("mesh", path)
        return self._file.lost(path)

    def command(self, settings: Settings) -> str:
        """Return the command line that computes the same shape from the saved handles."""
        method = [] if settings.method == Settings().method else ["--method", settings.method]
        carry = ["--carry-unconstrained"] if self._carry_unconstrained else []
        paths = [str(self._path), str(self.outputs.path["handles"]), "-o", str(self.outputs.path["mesh"])]
        constraints = [word for name in settings.constraints for word in (f"--{name}", "0")]
        return shlex.join(["sshade", "deform", *paths, *method, *constraints, *carry])
