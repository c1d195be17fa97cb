"""A coarser mesh that the browser draws during a drag, because it cannot draw a large mesh in time."""

from __future__ import annotations

from sshade.mesh.clusters import Clusters, cluster_vertices
from sshade.mesh.mesh import Mesh

#: Approximate number of vertices for a graphics card, and for a processor, which also computes the shape.
VERTICES = {"card": 50_000, "processor": 8_000}
#: Smallest ratio of the vertices of the mesh to the vertices of the preview.
LARGE = 2


def preview(mesh: Mesh, drawn: str) -> Clusters | None:
    """Cluster the vertices of a mesh; return None for a small mesh.

    Parameters
    ----------
    mesh : Mesh
    drawn : {"card", "processor"}
        Device that draws the preview.
    """
    wanted = VERTICES[drawn]
    return None if mesh.n < LARGE * wanted else cluster_vertices(mesh, wanted)
