"""Find the vertices in boxes, snap positions to the nearest vertices, and explain positions too far away."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sshade.core.errors import InputError, counted
from sshade.core.threads import in_ranges
from sshade.mesh.mesh import Mesh, bounds
from sshade.mesh.rigid import rigid_motion
from sshade.problem.similarity import LPS_RAS

#: Largest distance of a position from its vertex, as a fraction of the bounding-box diagonal. Positions
#: farther away belong to another mesh, unless they are within a mean edge length.
FARTHEST_SNAP = 0.05

#: Greatest distance of a target from the mean of all targets of its vertex, as a multiple of the largest
#: distance of their positions from the vertex. A surface that is stretched threefold stays below.
EXPLAINED = 3.0

#: Ratios of units of length that files are written in: millimetres, centimetres, inches, feet, metres.
UNITS = (1000.0, 100.0, 1000.0 / 25.4, 1.0 / 0.3048, 25.4, 12.0, 10.0)

#: Number of vertices from which on only the vertices near the positions enter a tree.
LARGE = 100_000
#: Step between the vertices that give a first estimate of the distances, and number of grid cells along the
#: longest side of the bounding box.
STRIDE, CELLS = 64, 64


def vertices_in(V: np.ndarray, boxes: ArrayLike) -> np.ndarray:
    """Find the vertices in some axis-aligned boxes. The sides belong to the boxes.

    Parameters
    ----------
    V : (n, 3) float64
    boxes : (b, 2, 3) float64
        Lowest and highest corner of each box.

    Returns
    -------
    (k,) int64, ascending

    Raises
    ------
    InputError
        When no vertex lies in the boxes.
    """
    inside = np.zeros(len(V), dtype=bool)
    for low, high in np.asarray(boxes, dtype=np.float64):
        x, y, z = ((a <= v) & (v <= b) for a, v, b in zip(low, V.T, high, strict=True))
        inside |= x & y & z
    if not inside.any():
        spans = ", ".join(f"{low:.4g} to {high:.4g}" for low, high in zip(*bounds(V), strict=True))
        raise InputError(
            f"no vertex lies in its boxes; the mesh spans {spans} in x, y and z, and a box is its lowest "
            "corner and its highest one"
        )
    return np.flatnonzero(inside)


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


def corrected_targets(
    mesh: Mesh,
    index: np.ndarray,
    source: np.ndarray,
    target: np.ndarray,
    *,
    dynamic: np.ndarray,
    group: np.ndarray,
    rotation: np.ndarray | None,
) -> np.ndarray:
    """Return targets (k, 3) of vertices `index` for targets of the positions `source` beside them.

    See :meth:`sshade.Handles.from_positions`.
    """
    moved, offset = target.copy(), mesh.V[index] - source
    moved[~dynamic] = mesh.V[index[~dynamic]]
    turned = np.zeros(len(index), dtype=bool)
    if rotation is not None:
        turned = dynamic & np.isfinite(rotation).all(axis=(1, 2))
        moved[turned] += np.einsum("iab,ib->ia", rotation[turned], offset[turned])
    for g in np.unique(group[dynamic & ~turned]):
        rows = dynamic & ~turned & (group == g)
        R, _ = rigid_motion(source[rows], target[rows])
        moved[rows] += offset[rows] @ R.T
    return moved


class MergedHandles(NamedTuple):
    """Handles of a group at one vertex as one handle, m of k.

    Attributes
    ----------
    first : (m,) int64
        First handle of each merged handle.
    number : (k,) int64
        Merged handle of each handle.
    target : (m, 3) float64
        Mean targets.
    distance : (k,) float64
        Distance of each handle's target from the mean.
    vertex, group : (k,) int64
        Vertex and group of each handle.
    """

    first: np.ndarray
    number: np.ndarray
    target: np.ndarray
    distance: np.ndarray
    vertex: np.ndarray
    group: np.ndarray

    def largest(self, values: np.ndarray) -> np.ndarray:
        """Return the largest of the values (k,) of each merged handle."""
        begin = np.searchsorted(np.sort(self.number), np.arange(len(self.first)))
        return np.maximum.reduceat(values[np.argsort(self.number, kind="stable")], begin)

    def require_agreement(self, limit: np.ndarray) -> None:
        """Raise InputError if the target of a handle is farther than `limit` (k,) from the mean."""
        if (self.distance > limit).any():
            bad = int(np.argmax(self.distance - limit))
            count = int((self.number == self.number[bad]).sum())
            raise InputError(
                f"{count} positions of group {self.group[bad]} have the same nearest vertex, "
                f"{self.vertex[bad]}, and contradictory targets, {self.distance[bad]:.3g} from their mean; "
                "give the vertex one target"
            )


def merged_by_vertex(index: np.ndarray, group: np.ndarray, target: np.ndarray) -> MergedHandles:
    """Merge handles of a group at one vertex, sorted by group and vertex."""
    _, first, number, count = np.unique(
        np.stack([group, index], axis=1), axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    number = number.ravel()
    sums = np.stack([np.bincount(number, target[:, c]) for c in range(3)], axis=1)
    mean = sums / count[:, None]
    distance = np.linalg.norm(target - mean[number], axis=1)
    return MergedHandles(first, number, mean, distance, index, group)


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

    limit, worst = FARTHEST_SNAP * mesh.diagonal, int(np.argmax(distance))
    if distance[worst] <= limit:  # as usual; all edges of a large mesh take gigabytes
        return
    limit = max(limit, mesh.mean_edge)
    if distance[worst] <= limit:
        return
    far, extent = int((distance > limit).sum()), float(np.linalg.norm(np.ptp(source, axis=0)))
    # Positions shrunk to a point would fit every mesh that passes by the origin.
    factors = [factor for unit in UNITS for factor in (unit, 1.0 / unit) if extent * factor > limit]
    changes = [("with x and y negated", LPS_RAS, "coordinate system (LPS, RAS)")]
    changes += [(f"times {factor:.6g}", np.full(3, factor), "unit of length") for factor in factors]
    tree = cKDTree(mesh.V)
    off = [float(tree.query(source * axes)[0].max()) for _, axes, _ in changes]
    if min(off) <= limit:
        change, _, other = changes[int(np.argmin(off))]
        cause = f"{change} they would be on it, in another {other}"
    elif 2 * far > len(source):
        boxes = f"their box has a diagonal of {extent:.3g}, that of the mesh {mesh.diagonal:.3g}"
        cause = f"{boxes}; give positions with the axes and the origin of the mesh"
    else:
        cause = "mend or remove these, the others are near it"
    number = int((group[:worst] == group[worst]).sum())
    are = counted(far, f"of {len(source)} given by position is", f"of {len(source)} given by position are")
    raise InputError(
        f"handle {number} of group {group[worst]} is {distance[worst]:.3g} from the nearest vertex, "
        f"{distance[worst] / mesh.diagonal:.3g} times the mesh's diagonal; {are} farther than "
        f"{limit / mesh.diagonal:.2g} times it: {cause}"
    )
