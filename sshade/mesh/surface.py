"""Make a mesh that can be deformed from the vertices and faces of a file or another program."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sshade.errors import InputError
from sshade.mesh.mesh import Mesh, check_faces, repeats_vertex
from sshade.mesh.seams import join_seams


class Surface(NamedTuple):
    """A mesh, and how it relates to the vertices and faces that it was made from.

    Attributes
    ----------
    mesh : Mesh
    vertex : (n,) int64
        Vertex of `mesh` for each original vertex; -1 where it has none.
    facts : mapping
        Counts: vertices that no face uses (``unused``), vertices merged along seams (``doubled``), and
        faces that repeat a vertex (``collapsed``).
    """

    mesh: Mesh
    vertex: np.ndarray
    facts: dict[str, int]

    def placed(self, V: np.ndarray, moved: np.ndarray) -> np.ndarray:
        """Return the original vertices V (n, 3), with the vertices of the mesh placed at `moved` (k, 3)."""
        return np.where((self.vertex >= 0)[:, None], moved[self.vertex], V)


def surface(V: np.ndarray, F: np.ndarray) -> Surface:
    """Leave out whatever is not part of a surface, and join seams.

    Drops faces that repeat a vertex, then vertices that no face uses (:func:`cleaned`), and merges
    vertices along seams (:func:`sshade.mesh.seams.join_seams`). Everything else keeps its position and
    its order.

    Parameters
    ----------
    V : (n, 3) float64
    F : (m, 3) int

    Raises
    ------
    InputError
        As :class:`sshade.Mesh`; also when every face repeats a vertex.
    """
    whole = cleaned(V, F)
    mesh, joined = join_seams(whole.mesh)
    vertex = np.where(whole.vertex >= 0, joined[whole.vertex], -1)
    return Surface(mesh, vertex, {**whole.facts, "doubled": whole.mesh.n - mesh.n})


def cleaned(V: np.ndarray, F: np.ndarray) -> Surface:
    """Drop faces that repeat a vertex, then vertices that no face uses; seams stay.

    Parameters, result and errors are as in :func:`surface`.
    """
    V, F = np.asarray(V), np.asarray(F)
    if F.ndim != 2 or F.shape[1] != 3 or not np.issubdtype(F.dtype, np.integer):
        Mesh(V, F)  # raises InputError
    used = np.zeros(len(V), dtype=bool)
    outside, _, repeating = check_faces(np.ascontiguousarray(F, dtype=np.int64), used)
    if outside >= 0 or len(F) == 0:
        Mesh(V, F)  # raises InputError
    if repeating == len(F):
        raise InputError(f"all {len(F)} faces repeat a vertex; there is no surface to deform")
    if repeating:
        F, used = F[~repeats_vertex(F)], np.zeros(len(V), dtype=bool)
        used[F] = True
    vertex, facts = np.arange(len(V)), {"unused": int((~used).sum()), "collapsed": int(repeating)}
    if not used.all():
        vertex = np.where(used, np.cumsum(used) - 1, -1)
        V, F = V[used], vertex[F]
    return Surface(Mesh(V, F), vertex, facts)  # raises whatever else is wrong


def without_duplicates(mesh: Mesh) -> Mesh:
    """Drop faces that have the three vertices of an earlier face, in any order.

    A manifold mesh has no duplicates and is returned itself.
    """
    if mesh.is_manifold:
        return mesh
    _, first = np.unique(np.sort(mesh.F, axis=1), axis=0, return_index=True)
    return mesh if len(first) == mesh.m else Mesh(mesh.V, mesh.F[np.sort(first)])
