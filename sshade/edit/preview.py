"""A coarser mesh that the browser draws during a drag, because it cannot draw a large mesh in time."""

from __future__ import annotations

from sshade.mesh.clusters import Clusters, cluster_vertices
from sshade.mesh.mesh import Mesh

#: Approximate number of vertices.
VERTICES = 20_000
#: Smallest ratio of the vertices of the mesh to the vertices of the preview.
LARGE = 2.5


def preview(mesh: Mesh) -> Clusters | None:
    """Cluster the vertices of a mesh; return None for a small mesh."""
    return None if mesh.n < LARGE * VERTICES else cluster_vertices(mesh, VERTICES)
