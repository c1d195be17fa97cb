"""Ways to pick vertices: by set operations, connection and distance."""

from __future__ import annotations

import numpy as np

from sshade.core.errors import InputError
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.mesh import Mesh


def selected(mesh: Mesh, before: np.ndarray, vertices: np.ndarray, how: str) -> np.ndarray:
    """Change a selection.

    Parameters
    ----------
    mesh : Mesh
    before : (j,) int64
        Selected vertices.
    vertices : (k,) int
        Vertices for "replace", "add" and "remove".
    how : str
        "replace", "add", "remove", "invert", or "linked", which adds all vertices of the components of
        selected vertices.

    Returns
    -------
    (j',) int64
        Selected vertices, ascending.
    """
    chosen = np.zeros(mesh.n, dtype=bool)
    chosen[before] = how != "replace"
    if how in ("replace", "add", "remove"):
        chosen[vertices] = how != "remove"
    elif how == "invert":
        chosen = ~chosen
    elif how == "linked":
        chosen = np.isin(mesh.component, mesh.component[before])
    return np.flatnonzero(chosen)


def near(mesh: Mesh, vertices: np.ndarray, distance: float) -> np.ndarray:
    """Find the vertices within a distance of other vertices, measured along the edges of the rest shape.

    Parameters
    ----------
    mesh : Mesh
    vertices : (k,) int64
    distance : float
        In the unit of the mesh.

    Returns
    -------
    (n,) bool

    Raises
    ------
    InputError
        When the distance is not above 0.
    """
    from scipy.sparse.csgraph import dijkstra

    if not distance > 0:
        raise InputError(f"a distance is a number above 0, not {distance:g}")
    return np.isfinite(dijkstra(vertex_graph(mesh).matrix, indices=vertices, min_only=True, limit=distance))
