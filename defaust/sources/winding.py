"""One list of triangles for meshes that differ in their winding only."""

from __future__ import annotations

import numpy as np

from sshade import Mesh


def same_triangles(F: np.ndarray, G: np.ndarray) -> bool:
    """Whether two lists hold the same triangles, in whatever order, rotation and winding.

    Parameters
    ----------
    F, G : (m, 3), (k, 3) int
    """
    return F.shape == G.shape and np.array_equal(_canonical(F), _canonical(G))


def wound_outward(mesh: Mesh) -> Mesh:
    """The mesh with all triangles running the same way round, counter-clockwise seen from outside.

    The order of the triangles is kept; of each only the winding may change.
    Outside is where the enclosed volume is positive; on a mesh with holes the
    volume of the cone to the centre of its box decides. A surface with one
    side only, or one that is not manifold, comes back inconsistent.
    """
    F = mesh.F
    if not mesh.is_oriented:
        import igl

        # Compared row by row: igl may rotate the corners too.
        F = np.where(_is_even(F, igl.bfs_orient(F)[0])[:, None], F, F[:, [0, 2, 1]])
    oriented = Mesh(mesh.V, F)
    return Mesh(mesh.V, F[:, [0, 2, 1]]) if oriented.volume < 0 else oriented


def _is_even(F: np.ndarray, G: np.ndarray) -> np.ndarray:
    """(m,) whether row i of G is a rotation of row i of F, not its reversal."""
    return np.stack([(np.roll(F, k, axis=1) == G).all(axis=1) for k in range(3)]).any(axis=0)


def _canonical(F: np.ndarray) -> np.ndarray:
    F = np.sort(F, axis=1)
    return F[np.lexsort(F.T[::-1])]
