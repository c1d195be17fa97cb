"""Shapes of one mesh in several files: the same vertices, in the same order."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sshade.core.errors import InputError
from sshade.files.mesh_file import MeshFile

if TYPE_CHECKING:
    from sshade.files.door import OpenShape

#: Least share of edges that shapes with the same order of vertices have in common, of the shape with fewer;
#: and about how many vertices it is tried on.
ALIKE, TRIED = 0.5, 10_000


def require_same_order(shape: MeshFile, path: Path, F: np.ndarray, other: str) -> None:
    """Raise InputError if a shape has few edges of the faces F (m, 3) of another, as after a new order.

    Shapes with other triangles between the same vertices pass, and shapes that lack faces.
    """
    if np.array_equal(shape.F, F) or not (len(shape.F) and len(F)):
        return
    mine, theirs = (_some_edges(faces, len(shape.V)) for faces in (shape.F, F))
    if len(np.intersect1d(mine, theirs)) < ALIKE * min(len(mine), len(theirs)):
        raise InputError(
            f"{path} has other edges than {other}: its vertices seem to be in another order; export it "
            "without merging or sorting vertices"
        )


def _some_edges(F: np.ndarray, n: int) -> np.ndarray:
    """Return numbers of the edges of faces F (m, 3) whose first of n vertices is one of :data:`TRIED`."""
    tried = np.zeros(n, dtype=bool)
    tried[:: max(1, n // TRIED)] = True
    found = []
    for k in range(3):
        one, other = F[:, k], F[:, k - 1]
        first = np.minimum(one, other)
        here = tried[first]
        found.append(first[here].astype(np.int64) * n + np.maximum(one[here], other[here]))
    return np.unique(np.concatenate(found))


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
