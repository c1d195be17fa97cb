"""Sets of vertices as a person picks them."""

from __future__ import annotations

import numpy as np

from sshade.errors import InputError
from sshade.mesh.mesh import Mesh

#: Ways to pick: with vertices given, and from those picked alone.
WAYS = ("replace", "add", "remove", "all", "none", "invert", "grow", "shrink")


def selected(mesh: Mesh, before: np.ndarray, vertices: np.ndarray, how: str) -> np.ndarray:
    """The vertices picked after a step.

    Parameters
    ----------
    mesh : Mesh
    before : (j,) int64
        Those picked before.
    vertices : (k,) int
        Those given, for "replace", "add" and "remove".
    how : str
        One of :data:`WAYS`; "grow" adds the neighbours of those picked, "shrink" removes those
        with a neighbour that is not.

    Returns
    -------
    (j',) int64
        Ascending.

    Raises
    ------
    InputError
        On another word, or a vertex out of range.
    """
    if how not in WAYS:
        raise InputError(f"{how!r} is no way to pick; use {', '.join(WAYS)}")
    if vertices.ndim != 1 or (len(vertices) and (vertices.min() < 0 or vertices.max() >= mesh.n)):
        raise InputError(f"vertices to pick are numbers from 0 to {mesh.n - 1}")
    picked = np.zeros(mesh.n, dtype=bool)
    picked[before] = how not in ("replace", "none")
    if how in ("replace", "add"):
        picked[vertices] = True
    elif how == "remove":
        picked[vertices] = False
    elif how == "all":
        picked[:] = True
    elif how == "invert":
        picked = ~picked
    elif how in ("grow", "shrink"):
        grows = how == "grow"
        across = mesh.edges[picked[mesh.edges].any(axis=1) & ~picked[mesh.edges].all(axis=1)]
        picked[across] = grows
    return np.flatnonzero(picked)
