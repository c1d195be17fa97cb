"""A lattice of cubes around a surface, with trilinear interpolation from its nodes to the surface."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from sshade.mesh.mesh import Mesh

#: Corners of a cube, in units of its side.
CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
#: Spacing of the points on a triangle that find the cubes it passes through, in sides of a cube.
SPACING = 0.5


class Lattice(NamedTuple):
    """Cubes on a surface and, optionally, inside the surface.

    Attributes
    ----------
    V : (p, 3) float64
        Nodes.
    cubes : (c, 8) int64
        Nodes of each cube.
    edges : (e, 2) int64
        Edges of the cubes, without repetition.
    sharing : (e,) int64
        Number of cubes around each edge.
    carry : (n, p) sparse float64
        Trilinear weights, eight per row: ``carry @ V`` are the mesh's vertices.
    component : (p,) int
        Connected component of each node.
    """

    V: np.ndarray
    cubes: np.ndarray
    edges: np.ndarray
    sharing: np.ndarray
    carry: csr_array
    component: np.ndarray


def lattice(mesh: Mesh, *, cells: int, filled: bool) -> Lattice:
    """Lay an axis-aligned lattice around a mesh, centred on its bounding box.

    The surface may have a boundary, intersect itself, and need not be manifold.

    Parameters
    ----------
    mesh : Mesh
    cells : int
        Bounding-box diagonal divided by the side of a cube.
    filled : bool
        Add the cubes whose centres have a winding number above 0.5.
    """
    side = mesh.diagonal / cells
    low, high = mesh.V.min(axis=0), mesh.V.max(axis=0)
    count = np.floor((high - low) / side).astype(np.int64) + 2
    origin = 0.5 * (low + high) - 0.5 * side * count
    touched = np.unique(_cells_of(_points(mesh, SPACING * side), origin, side), axis=0)
    if filled:
        touched = np.concatenate([touched, _inside(mesh, origin, side, count)])
    own = _cells_of(mesh.V, origin, side)
    cubes, number = np.unique(np.concatenate([touched, own]), axis=0, return_inverse=True)
    node, corners = np.unique((cubes[:, None] + CORNERS).reshape(-1, 3), axis=0, return_inverse=True)
    corners = corners.reshape(-1, 8)
    along = [(a, b) for a in range(8) for b in range(a + 1, 8) if np.abs(CORNERS[a] - CORNERS[b]).sum() == 1]
    ends = np.concatenate([corners[:, pair] for pair in along])
    edges, sharing = np.unique(np.sort(ends, axis=1), axis=0, return_counts=True)
    shape = (len(node), len(node))
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=shape)
    inside = (mesh.V - origin) / side - own
    weights = np.where(CORNERS == 1, inside[:, None], 1 - inside[:, None]).prod(axis=2)
    places = np.repeat(np.arange(mesh.n), 8), corners[number.ravel()[len(touched) :]].ravel()
    return Lattice(
        V=origin + side * node,
        cubes=corners,
        edges=edges,
        sharing=sharing,
        carry=coo_array((weights.ravel(), places), shape=(mesh.n, len(node))).tocsr(),
        component=connected_components(graph, directed=False)[1],
    )


def _cells_of(points: np.ndarray, origin: np.ndarray, side: float) -> np.ndarray:
    """Return the cells (q, 3) int64 that contain points."""
    return np.floor((points - origin) / side).astype(np.int64)


def _points(mesh: Mesh, spacing: float) -> np.ndarray:
    """Sample the triangles, corners included, at most `spacing` apart along their sides."""
    corners = mesh.V[mesh.F]
    longest = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
    parts = np.maximum(np.ceil(longest / spacing).astype(np.int64), 1)
    points = [mesh.V]
    for n in np.unique(parts[parts > 1]):
        i, j = (index.ravel() for index in np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij"))
        i, j = i[i + j <= n], j[i + j <= n]
        weights = np.stack([i, j, n - i - j], axis=1) / n
        points.append(np.einsum("qc,fcd->fqd", weights, corners[parts == n]).reshape(-1, 3))
    return np.concatenate(points)


def _inside(mesh: Mesh, origin: np.ndarray, side: float, count: np.ndarray) -> np.ndarray:
    """Return the cells (q, 3) int64 inside the surface."""
    import igl

    cells = np.stack(np.meshgrid(*(np.arange(c) for c in count), indexing="ij"), axis=-1).reshape(-1, 3)
    # Move to the origin, because the winding numbers lose digits far from it.
    middle = origin + 0.5 * side * count
    centres = (cells + 0.5) * side + (origin - middle)
    winding = igl.fast_winding_number(mesh.V - middle, np.array(mesh.F), np.ascontiguousarray(centres))
    return cells[winding > 0.5]
