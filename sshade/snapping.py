"""Snap positions to the nearest vertices of a mesh, and explain positions that are too far away."""

from __future__ import annotations

import numpy as np

from sshade.errors import InputError
from sshade.mesh.mesh import Mesh, bounds
from sshade.threads import in_ranges

#: Largest distance of a position from its vertex, as a fraction of the bounding-box diagonal. Positions
#: farther away belong to another mesh, unless they are within a mean edge length.
FARTHEST_SNAP = 0.05

#: Ratios of units of length that files are written in: millimetres, centimetres, inches, feet, metres.
UNITS = (1000.0, 100.0, 1000.0 / 25.4, 1.0 / 0.3048, 25.4, 12.0, 10.0)

#: Number of vertices from which on only the vertices near the positions enter a tree.
LARGE = 100_000
#: Step between the vertices that give a first estimate of the distances, and number of grid cells along the
#: longest side of the bounding box.
STRIDE, CELLS = 64, 64


def snap_to_vertices(mesh: Mesh, source: np.ndarray, group: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the distances (k,) float64 of positions to their nearest vertices, and the vertices (k,) int64.

    Parameters
    ----------
    mesh : Mesh
        Any mesh.
    source : (k, 3) float64
        Positions, in the mesh's coordinates.
    group : (k,) int
        Group of each position, for the error message.

    Raises
    ------
    InputError
        If a position is farther from the mesh than :data:`FARTHEST_SNAP` allows.
    """
    from scipy.spatial import cKDTree

    near = np.arange(mesh.n) if mesh.n < LARGE else _vertices_around(mesh.V, source)
    distance, place = cKDTree(mesh.V[near]).query(source)
    if distance.max() > FARTHEST_SNAP * mesh.diagonal:
        _refuse_far(source, distance, group, mesh)
    return distance, near[place]


def _vertices_around(V: np.ndarray, source: np.ndarray) -> np.ndarray:
    """Return a set of vertices, in ascending order, that contains the nearest vertex of each position.

    The nearest of a few vertices bounds the distance. In a grid whose cells are as wide, the nearest vertex
    lies in the cell of its position or in an adjacent cell. A tree of all vertices would take far longer.
    """
    from scipy.spatial import cKDTree

    reach = float(cKDTree(V[::STRIDE]).query(source)[0].max())
    low, high = bounds(V)
    width = max(reach * (1 + 1e-9), float((high - low).max()) / CELLS) or 1.0
    flag = np.zeros(((high - low) / width).astype(int) + 1, dtype=bool)
    for x, y, z in np.unique(np.floor((source - low) / width).astype(int), axis=0):
        flag[max(x - 1, 0) : x + 2, max(y - 1, 0) : y + 2, max(z - 1, 0) : z + 2] = True

    def flagged(first: int, end: int) -> np.ndarray:
        x, y, z = ((V[first:end] - low) / width).astype(int).T
        return first + np.flatnonzero(flag[x, y, z])

    return np.concatenate(in_ranges(flagged, len(V)))


def _refuse_far(source: np.ndarray, distance: np.ndarray, group: np.ndarray, mesh: Mesh) -> None:
    """Raise InputError if positions are too far from the mesh; name the worst and the likely cause."""
    from scipy.spatial import cKDTree

    limit = max(FARTHEST_SNAP * mesh.diagonal, mesh.mean_edge)
    worst = int(np.argmax(distance))
    if distance[worst] <= limit:
        return
    far, extent = int((distance > limit).sum()), float(np.linalg.norm(np.ptp(source, axis=0)))
    # Positions shrunk to a point would fit every mesh that passes by the origin.
    factors = [factor for unit in UNITS for factor in (unit, 1.0 / unit) if extent * factor > limit]
    tree = cKDTree(mesh.V)
    off = [float(tree.query(source * factor)[0].max()) for factor in factors]
    if factors and min(off) <= limit:
        cause = f"times {factors[int(np.argmin(off))]:.6g} they would be on it, in another unit of length"
    elif 2 * far > len(source):
        boxes = f"their box has a diagonal of {extent:.3g}, that of the mesh {mesh.diagonal:.3g}"
        cause = f"{boxes}; another frame, or an offset"
    else:
        cause = "mend or remove these, the others are near it"
    number = int((group[:worst] == group[worst]).sum())
    raise InputError(
        f"handle {number} of group {group[worst]} is {distance[worst]:.3g} from the nearest vertex, "
        f"{distance[worst] / mesh.diagonal:.3g} times the mesh's diagonal; {far} of {len(source)} handles "
        f"given by position are farther than {limit / mesh.diagonal:.2g} times it: {cause}"
    )
