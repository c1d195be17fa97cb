"""What of given vertices and faces can be deformed: a mesh, and where each vertex is on it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sshade.mesh.cleaning import cleaned
from sshade.mesh.mesh import Mesh
from sshade.mesh.seams import join_seams


class Surface(NamedTuple):
    """A surface made of vertices and faces as a file or another program gives them.

    Attributes
    ----------
    mesh : Mesh
    vertex : (n,) int64
        For each vertex given its vertex in `mesh`, -1 where it has none.
    facts : mapping
        The numbers of vertices ``unused`` and ``doubled`` along seams, and of ``collapsed`` faces.
    """

    mesh: Mesh
    vertex: np.ndarray
    facts: dict[str, int]

    def placed(self, V: np.ndarray, moved: np.ndarray) -> np.ndarray:
        """(n, 3) positions V of the vertices given, and `moved` of the mesh where they are on it."""
        return np.where((self.vertex >= 0)[:, None], moved[self.vertex], V)


def surface(V: np.ndarray, F: np.ndarray) -> Surface:
    """Leave out what is no part of a surface, and join its seams.

    Faces that repeat a vertex go, then vertices that no face uses (:func:`sshade.mesh.cleaning.cleaned`);
    vertices that stand twice along a seam become one (:func:`sshade.mesh.seams.join_seams`). All else
    keeps its place and its order.

    Parameters
    ----------
    V : (n, 3) float64
    F : (m, 3) int

    Raises
    ------
    InputError
        Those of :class:`sshade.Mesh`; when every face repeats a vertex.
    """
    whole = cleaned(V, F)
    mesh, onto = join_seams(whole.mesh)
    vertex = np.where(whole.vertex >= 0, onto[whole.vertex], -1)
    doubled = whole.mesh.n - mesh.n
    return Surface(mesh, vertex, {"unused": whole.unused, "collapsed": whole.collapsed, "doubled": doubled})
