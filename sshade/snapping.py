"""Handles given by position: the vertices that they mean, and what is wrong where those are far."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sshade.errors import InputError
from sshade.mesh.mesh import Mesh, bounds
from sshade.threads import in_ranges

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

#: Farthest that a position may be from its handle vertex (x diagonal), or a mean edge where that is longer:
#: beyond, it is not one of this mesh.
FARTHEST_SNAP = 0.05

#: Units of length over others that files are written in: millimetres, centimetres, inches, feet.
UNITS = (1000.0, 100.0, 1000.0 / 25.4, 1.0 / 0.3048, 25.4, 12.0, 10.0)


#: Vertices from which on a tree is made of those around positions only, every how many-th tells how far
#: these go, and cells along the mesh.
LARGE, STRIDE, CELLS = 100_000, 64, 64


def snap_to_vertices(mesh: Mesh, source: np.ndarray, group: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The distances (k,) of positions (k, 3) to their nearest vertices, and these (k,) int64.

    Parameters
    ----------
    mesh : Mesh
    source : (k, 3) float64
    group : (k,) int
        Of each handle, for the message.

    Raises
    ------
    InputError
        When one is farther than :data:`FARTHEST_SNAP` allows.
    """
    from scipy.spatial import cKDTree

    if mesh.n < LARGE:
        distance, index = cKDTree(mesh.V).query(source)
    else:
        near = _around(mesh.V, source)
        distance, index = cKDTree(mesh.V[near]).query(source)
        index = near[index]
    if distance.max() > FARTHEST_SNAP * mesh.diagonal:
        _refuse_far(source, distance, group, mesh, cKDTree(mesh.V))
    return distance, index


def _around(V: np.ndarray, source: np.ndarray) -> np.ndarray:
    """Vertices, in ascending order, among which are the nearest ones of positions.

    No nearest vertex is farther away than the nearest of a few; so it lies in the cell of its position or in
    one beside that, of a grid of cells that are as wide. A tree of all would take many times as long.
    """
    from scipy.spatial import cKDTree

    few = V[::STRIDE]
    reach = float(cKDTree(few).query(source)[0].max())
    low, high = bounds(V)
    cell = max(reach * (1 + 1e-9), float((high - low).max()) / CELLS) or 1.0
    flag = np.zeros(((high - low) / cell).astype(int) + 1, dtype=bool)
    for x, y, z in np.unique(np.floor((source - low) / cell).astype(int), axis=0):
        flag[max(x - 1, 0) : x + 2, max(y - 1, 0) : y + 2, max(z - 1, 0) : z + 2] = True

    def flagged(first: int, end: int) -> np.ndarray:
        x, y, z = ((V[first:end] - low) / cell).astype(int).T
        return first + np.flatnonzero(flag[x, y, z])

    return np.concatenate(in_ranges(flagged, len(V)))


def _refuse_far(
    source: np.ndarray, distance: np.ndarray, group: np.ndarray, mesh: Mesh, tree: cKDTree
) -> None:
    """Raise InputError where handles are farther than FARTHEST_SNAP allows: which, and why they may be."""
    limit = max(FARTHEST_SNAP * mesh.diagonal, mesh.mean_edge)
    worst = int(np.argmax(distance))
    if distance[worst] <= limit:
        return
    number = int((group[:worst] == group[worst]).sum())
    many, factors = int((distance > limit).sum()), [*UNITS, *(1.0 / unit for unit in UNITS)]
    wide = float(np.linalg.norm(np.ptp(source, axis=0)))
    # A box that shrinks to a point is on the mesh wherever that passes by the origin.
    factors = [factor for factor in factors if wide * factor > limit]
    off = [float(tree.query(source * factor)[0].max()) for factor in factors]
    if factors and min(off) <= limit:
        cause = f"times {factors[int(np.argmin(off))]:.6g} they would be on it, in another unit of length"
    elif 2 * many > len(source):
        boxes = f"their box has a diagonal of {wide:.3g}, that of the mesh {mesh.diagonal:.3g}"
        cause = f"{boxes}; another frame, or an offset"
    else:
        cause = "mend or remove these, the others are near it"
    raise InputError(
        f"handle {number} of group {group[worst]} is {distance[worst]:.3g} from the nearest vertex, "
        f"{distance[worst] / mesh.diagonal:.3g} times the mesh's diagonal; {many} of {len(source)} handles "
        f"given by position are farther than {limit / mesh.diagonal:.2g} times it: {cause}"
    )
