"""Shapes of one mesh in several files: the same vertices, in the same order."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sshade.core.errors import InputError
from sshade.files.mesh_file import MeshFile

if TYPE_CHECKING:
    from sshade.files.open_shape import OpenShape
    from sshade.mesh.mesh import Mesh

#: Largest ratio of the mean edge lengths of two lists of faces in one shape.
LONGER = 2.0


def require_same_order(shape: MeshFile, path: Path, F: np.ndarray, other: str) -> None:
    """Raise InputError if faces F (m, 3) of another mesh have long edges in a shape, as after a new order.

    Shapes with other triangles between the same vertices pass, and shapes that lack faces.
    """
    if np.array_equal(shape.F, F) or not (len(shape.F) and len(F)):
        return
    V = shape.V
    own, theirs = (np.linalg.norm(V[faces[:, 0]] - V[faces[:, 1]], axis=1) for faces in (shape.F, F))
    if theirs.mean() > LONGER * own.mean():
        raise InputError(
            f"{path} has other edges than {other}: its vertices seem to be in another order; export it "
            "without merging or sorting vertices"
        )


def corresponding(other: MeshFile, path: Path, shape: OpenShape, mesh: Path) -> np.ndarray:
    """Return the positions (k, 3) of the surface's vertices in another shape of a mesh.

    Parameters
    ----------
    other, path : MeshFile and path
        The other shape.
    shape, mesh : OpenShape and path
        The mesh.

    Raises
    ------
    InputError
        When the numbers of vertices differ, or a position is not finite.
    """
    if len(other.V) != len(shape.V):
        raise InputError(
            f"{path} has {len(other.V)} vertices and {mesh} has {len(shape.V)}; they must correspond"
        )
    if {other.space, shape.space} == {"LPS", "RAS"}:
        raise InputError(f"{path} is in {other.space}, and {mesh} in {shape.space}; save both in one of them")
    require_same_order(other, path, shape.F, str(mesh))
    V = shape.surface.picked(other.V)
    require_finite(V, path, shape.surface.original)
    return V


def require_finite(V: np.ndarray, path: Path, number: np.ndarray | None = None) -> None:
    """Raise InputError if a position V (k, 3) of a file is not finite; `number` (k,) are the ids there."""
    if not (finite := np.isfinite(V).all(axis=1)).all():
        bad = int(np.argmin(finite))
        vertex = bad if number is None else number[bad]
        raise InputError(f"{path}: vertex {vertex} has a NaN or infinite coordinate; write the file again")


def moved_by(mesh: Mesh, V: np.ndarray) -> float:
    """Return the mean distance that a shape V (n, 3) of a mesh moved, apart from a rigid motion."""
    from sshade.mesh.rigid import rigid_motion, rigidly_moved

    return float(np.linalg.norm(V - rigidly_moved(mesh.V, *rigid_motion(mesh.V, V)), axis=1).mean())
