"""Reduce any mesh to fewer vertices for a display: clusters of vertices in the cells of a grid."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sshade.mesh.mesh import Mesh, repeats_vertex

#: Greatest number of cells along the diagonal, so that 64 bits can number all cells.
CELLS = 100_000


class Clusters(NamedTuple):
    """Some vertices of a mesh and triangles between them, which need not be a manifold.

    Attributes
    ----------
    vertices : (k,) int64
        Ids in the mesh, ascending: the vertex of each cluster that is nearest to the mean of the cluster.
    faces : (l, 3) int64
        Places in `vertices`.
    cell : (n,) int64
        Cluster of each vertex of the mesh, as a place in `vertices`.
    """

    vertices: np.ndarray
    faces: np.ndarray
    cell: np.ndarray


def cluster_vertices(mesh: Mesh, wanted: int) -> Clusters:
    """Cluster the vertices of a mesh in the cells of a grid.

    Parameters
    ----------
    mesh : Mesh
    wanted : int
        Approximate number of clusters. At most twice as many are returned.

    Source: J. Rossignac, P. Borrel, "Multi-resolution 3D approximations for rendering complex scenes", 1993.
    """
    # A surface meets about 1.5 cells for each area of a cell side.
    size = max(np.sqrt(1.5 * mesh.area / wanted), mesh.diagonal / CELLS)
    low = mesh.V.min(axis=0)
    while True:
        cell = ((mesh.V - low) / size).astype(np.int64)
        key = (cell[:, 0] * (CELLS + 1) + cell[:, 1]) * (CELLS + 1) + cell[:, 2]
        _, cluster, count = np.unique(key, return_inverse=True, return_counts=True)
        if len(count) <= 2 * wanted:
            break
        size *= 1.5  # small pieces far from each other
    middle = np.stack([np.bincount(cluster, x) for x in mesh.V.T], axis=1) / count[:, None]
    distance = np.linalg.norm(mesh.V - middle[cluster], axis=1)
    nearest = np.lexsort((distance, cluster))[np.cumsum(count) - count]
    vertices = np.sort(nearest)
    number = np.empty(len(count), dtype=np.int64)
    number[cluster[vertices]] = np.arange(len(vertices))
    place = number[cluster]
    faces = place[mesh.F]
    return Clusters(vertices, faces[~repeats_vertex(faces)], place)
