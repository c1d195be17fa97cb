"""Files of registered meshes: found by name, read with that name in every complaint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sshade import InputError, Mesh
from sshade.io.meshes import read_mesh

#: Mesh formats that keep shared vertices, the first that is there first.
MESH_SUFFIXES = (".ply", ".off", ".obj")
#: File names listed in a sentence before it says "and so many more".
LISTED = 6


def existing_folder(root: Any, *, option: str) -> Path:
    """The folder that the user named; InputError where it is none."""
    path = Path(str(root)).expanduser()
    if not path.exists():
        raise InputError(f"{path}: no such folder; set {option}")
    return path


def require_whole(mesh: Mesh, *, label: str, closed: bool = False) -> None:
    """Raise InputError, beginning with `label`, unless manifold, in one piece and, if asked, closed."""
    try:
        mesh.require_manifold()
        mesh.require_one_component()
    except InputError as error:
        raise InputError(f"{label}: {error}") from error
    if closed and not mesh.is_closed:
        raise InputError(
            f"{label}: the mesh has {len(mesh.boundary_edges)} boundary edges; it must be closed"
        )


def read_counted(path: Path, *, vertices: int, faces: int) -> Mesh:
    """Read a mesh that must have so many vertices and faces."""
    mesh = read_mesh(path)
    if (mesh.n, mesh.m) != (vertices, faces):
        raise InputError(
            f"{path}: {mesh.n} vertices and {mesh.m} faces, but the registrations have {vertices} and {faces}"
        )
    return mesh


def as_landmarks(value: Any, *, option: str) -> dict[str, int]:
    """The mapping of names to vertex ids; InputError on anything else."""
    if not isinstance(value, Mapping) or not value:
        raise InputError(f"{option}={value} is not a mapping of names to vertices, e.g. {{nose: 332}}")
    for name, vertex in value.items():
        if not is_whole(vertex) or vertex < 0:
            raise InputError(f"{option}: the vertex of {name} is {vertex!r}; give a number from 0 up")
    vertices = list(value.values())
    for name, vertex in value.items():
        if vertices.count(vertex) > 1:
            raise InputError(f"{option}: {name} shares vertex {vertex} with another landmark")
    return {str(name): int(vertex) for name, vertex in value.items()}


def is_whole(value: Any) -> bool:
    """True for integers that are not booleans."""
    return isinstance(value, int) and not isinstance(value, bool)


def refuse_repeated(items: Sequence[Any], *, option: str) -> None:
    """Raise InputError on an item that is there twice."""
    repeated = [item for item in items if list(items).count(item) > 1]
    if repeated:
        raise InputError(f"{option}: {repeated[0]!r} is listed twice")


def shortened(names: Sequence[str]) -> str:
    """The names, or the first of them and how many follow."""
    more = len(names) - LISTED
    return ", ".join(names[:LISTED]) + (f" and {more} more" if more > 0 else "")
