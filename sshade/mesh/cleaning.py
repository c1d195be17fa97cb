"""What files have beside a surface: faces that repeat a vertex, faces twice, vertices in no face."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sshade.errors import InputError
from sshade.mesh.mesh import Mesh, check_faces, repeats_vertex


class Cleaned(NamedTuple):
    """A mesh of what can be deformed, and what was left out.

    Attributes
    ----------
    mesh : Mesh
    vertex : (n,) int64
        For each vertex given its vertex in `mesh`, -1 where no face uses it.
    unused : int
        Vertices that no face uses.
    collapsed : int
        Faces that repeat a vertex.
    """

    mesh: Mesh
    vertex: np.ndarray
    unused: int
    collapsed: int


def cleaned(V: np.ndarray, F: np.ndarray) -> Cleaned:
    """Leave out the faces that repeat a vertex, then the vertices that no face uses.

    Neither is a part of the surface: all else keeps its place and its order.

    Parameters
    ----------
    V : (n, 3) float64
    F : (m, 3) int

    Raises
    ------
    InputError
        Those of :class:`sshade.mesh.mesh.Mesh`; when every face repeats a vertex.
    """
    V, F = np.asarray(V), np.asarray(F)
    everywhere = np.arange(len(V))
    indices = F.ndim == 2 and F.shape[1] == 3 and len(F) > 0 and np.issubdtype(F.dtype, np.integer)
    sound = False
    if indices:
        used = np.zeros(len(V), dtype=bool)
        outside, _, repeating = check_faces(np.ascontiguousarray(F, dtype=np.int64), used)
        sound = outside < 0 and repeating == 0 and bool(used.all())
    if sound or not indices or outside >= 0:
        return Cleaned(Mesh(V, F), everywhere, 0, 0)  # which tells what is wrong
    collapsed = repeats_vertex(F)
    if collapsed.all():
        raise InputError(f"all {len(F)} faces repeat a vertex; there is no surface to deform")
    F = F[~collapsed]
    used = np.zeros(len(V), dtype=bool)
    used[F] = True
    if used.all():
        return Cleaned(Mesh(V, F), everywhere, 0, int(collapsed.sum()))
    vertex = np.where(used, np.cumsum(used) - 1, -1)
    return Cleaned(Mesh(V[used], vertex[F]), vertex, int((~used).sum()), int(collapsed.sum()))


def without_duplicates(mesh: Mesh) -> Mesh:
    """The mesh without faces that have the three vertices of an earlier one, however they turn.

    A face that lies on another has edges of more than two faces: of a manifold mesh nothing is left out.
    """
    if mesh.is_manifold:
        return mesh
    _, first = np.unique(np.sort(mesh.F, axis=1), axis=0, return_index=True)
    return mesh if len(first) == mesh.m else Mesh(mesh.V, mesh.F[np.sort(first)])
