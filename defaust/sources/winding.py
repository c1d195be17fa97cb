"""Consistent orientation of meshes that list the same triangles."""

from __future__ import annotations

import numpy as np

from sshade import Mesh
from sshade.mesh.cutting import orientation
from sshade.mesh.incidence import sides_by_edge

#: Order of the corners that turns a face over.
TURNED = [0, 2, 1]


def same_triangles(F: np.ndarray, G: np.ndarray) -> bool:
    """Whether two lists (m, 3) and (k, 3) hold the same triangles, in any order, rotation and orientation."""
    return F.shape == G.shape and np.array_equal(_canonical(F), _canonical(G))


def wound_outward(mesh: Mesh) -> Mesh:
    """Orient all triangles consistently, counter-clockwise seen from outside.

    The order of the triangles stays. Outside is where the enclosed volume is positive; holes are closed by
    cones to the centre of the bounding box. A non-orientable or non-manifold surface stays inconsistent.
    """
    turn, _ = orientation(mesh, sides_by_edge(mesh.F, mesh.n))
    oriented = Mesh(mesh.V, np.where(turn[:, None], mesh.F[:, TURNED], mesh.F))
    return Mesh(mesh.V, oriented.F[:, TURNED]) if oriented.volume < 0 else oriented


def _canonical(F: np.ndarray) -> np.ndarray:
    F = np.sort(F, axis=1)
    return F[np.lexsort(F.T[::-1])]
