"""One list of triangles for meshes that differ in their winding only."""

from __future__ import annotations

import numpy as np

from sshade import Mesh
from sshade.mesh.cutting import faces_to_turn
from sshade.mesh.sides import sides_by_edge

#: Corners of a face that is turned over.
TURNED = [0, 2, 1]


def same_triangles(F: np.ndarray, G: np.ndarray) -> bool:
    """Whether two lists hold the same triangles, in whatever order, rotation and winding.

    Parameters
    ----------
    F, G : (m, 3), (k, 3) int
    """
    return F.shape == G.shape and np.array_equal(_canonical(F), _canonical(G))


def wound_outward(mesh: Mesh) -> Mesh:
    """Orient all triangles alike, counter-clockwise seen from outside.

    The order of the triangles is kept; of each only the winding may change.
    Outside is where the enclosed volume is positive; on a mesh with holes the
    volume of the cone to the centre of its box decides. A surface with one
    side only, or one that is not manifold, comes back inconsistent.
    """
    turn = faces_to_turn(mesh, sides_by_edge(mesh.F, mesh.n))
    oriented = Mesh(mesh.V, np.where(turn[:, None], mesh.F[:, TURNED], mesh.F))
    return Mesh(mesh.V, oriented.F[:, TURNED]) if oriented.volume < 0 else oriented


def _canonical(F: np.ndarray) -> np.ndarray:
    F = np.sort(F, axis=1)
    return F[np.lexsort(F.T[::-1])]
