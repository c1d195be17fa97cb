"""A coarser mesh to look at while a large one is dragged: the browser could not draw all of it in time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sshade.mesh.mesh import Mesh

#: About how many vertices it has, by what draws: a graphics card, or the processor that computes it too.
VERTICES = {"card": 50_000, "processor": 8_000}
#: Meshes have one from so many times as many vertices on.
LARGE = 2
#: Cells along the diagonal at most, so that a number of 64 bits names each.
CELLS = 100_000


class Preview(NamedTuple):
    """Some vertices of a mesh, and triangles between them.

    Attributes
    ----------
    vertices : (k,) int64
        Their ids in the mesh, ascending.
    faces : (l, 3) int64
        Numbers in `vertices`. It is no manifold everywhere.
    """

    vertices: np.ndarray
    faces: np.ndarray


def preview(mesh: Mesh, drawn: str) -> Preview | None:
    """Clusters of a mesh's vertices, each the vertex that is nearest to its middle; None of a small mesh.

    Parameters
    ----------
    mesh : Mesh
        Any.
    drawn : str
        By what: a key of :data:`VERTICES`.

    Source: J. Rossignac, P. Borrel, "Multi-resolution 3D approximations for rendering complex scenes", 1993.
    """
    wanted = VERTICES[drawn]
    if mesh.n < LARGE * wanted:
        return None
    # A surface meets about 1.5 cells for each square of a cell that it covers.
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
    whole = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return Preview(vertices, faces[whole])
