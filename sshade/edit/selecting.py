"""Selections of vertices."""

from __future__ import annotations

import numpy as np

from sshade.errors import InputError
from sshade.mesh.mesh import Mesh

#: Ways to change a selection. The first three take vertices.
WAYS = ("replace", "add", "remove", "all", "none", "invert", "grow", "shrink")


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
        A word of :data:`WAYS`. "grow" adds the neighbours of selected vertices; "shrink" removes selected
        vertices with a neighbour that is not selected.

    Returns
    -------
    (j',) int64
        Selected vertices, ascending.

    Raises
    ------
    InputError
        When `how` is another word, or a vertex is out of range.
    """
    if how not in WAYS:
        raise InputError(f"{how!r} is no way to pick vertices; use {', '.join(WAYS)}")
    if vertices.ndim != 1 or (len(vertices) and (vertices.min() < 0 or vertices.max() >= mesh.n)):
        raise InputError(f"vertices to pick are numbers from 0 to {mesh.n - 1}")
    chosen = np.zeros(mesh.n, dtype=bool)
    chosen[before] = how not in ("replace", "none")
    if how in ("replace", "add", "remove"):
        chosen[vertices] = how != "remove"
    elif how == "all":
        chosen[:] = True
    elif how == "invert":
        chosen = ~chosen
    elif how in ("grow", "shrink"):
        ends = chosen[mesh.edges]
        chosen[mesh.edges[ends[:, 0] != ends[:, 1]]] = how == "grow"
    return np.flatnonzero(chosen)
