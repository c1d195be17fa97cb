"""A coarser mesh that the browser draws during a drag, because it cannot draw a large mesh in time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sshade.mesh.mesh import Mesh, repeats_vertex

#: Approximate number of vertices for a graphics card, and for a processor, which also computes the shape.
VERTICES = {"card": 50_000, "processor": 8_000}
#: Smallest ratio of the vertices of the mesh to the vertices of the preview.
LARGE = 2
#: Greatest number of cells along the diagonal, so that 64 bits can number all cells.
CELLS = 100_000


class Preview(NamedTuple):
    """Some vertices of a mesh and triangles between them, which need not be a manifold.

    Attributes
    ----------
    vertices : (k,) int64
        Ids in the mesh, ascending.
    faces : (l, 3) int64
        Places in `vertices`.
    """

    vertices: np.ndarray
    faces: np.ndarray


def preview(mesh: Mesh, drawn: str) -> Preview | None:
    """Cluster the vertices of a mesh in the cells of a grid; return None for a small mesh.

    Each cluster is represented by the vertex nearest to its mean.

    Parameters
    ----------
    mesh : Mesh
    drawn : {"card", "processor"}
        Device that draws the preview.

    Source: J. Rossignac, P. Borrel, "Multi-resolution 3D approximations for rendering complex scenes", 1993.
    """
    wanted = VERTICES[drawn]
    if mesh.n < LARGE * wanted:
        return None
    # A surface meets about 1.5 cells for each area of a cell side.
    size = max(np.sqrt(1.5 * mesh.area / wanted), mesh.diagonal / CELLS)
    cell = ((mesh.V - mesh.V.min(axis=0)) / size).astype(np.int64)
    key = (cell[:, 0] * (CELLS + 1) + cell[:, 1]) * (CELLS + 1) + cell[:, 2]
    _, cluster, count = np.unique(key, return_inverse=True, return_counts=True)
    middle = np.stack([np.bincount(cluster, x) for x in mesh.V.T], axis=1) / count[:, None]
    distance = np.linalg.norm(mesh.V - middle[cluster], axis=1)
    nearest = np.lexsort((distance, cluster))[np.cumsum(count) - count]
    vertices = np.sort(nearest)
    number = np.empty(len(count), dtype=np.int64)
    number[cluster[vertices]] = np.arange(len(vertices))
    faces = number[cluster][mesh.F]
    return Preview(vertices, faces[~repeats_vertex(faces)])
