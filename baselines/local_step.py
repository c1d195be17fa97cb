"""The local step of ARAP on any graph or mesh, and the blending of the rigid motions of nodes."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from sshade.mesh.rotations import fit_rotations
from sshade.solver.terms.arap import Edges, Triangles


def spokes(V: np.ndarray, edges: np.ndarray, weights: np.ndarray) -> Edges:
    """Return the elements of the spokes energy.

    Parameters
    ----------
    V : (n, 3) float64
        Rest positions.
    edges : (e, 2) int
    weights : (e,) float64
    """
    i, j = edges.T
    return Edges(edges.astype(np.uint32), (weights[:, None] * (V[i] - V[j]))[:, None], weights[:, None])


class LocalStep:
    """The rotations of an ARAP energy, each fitted from its last value.

    Parameters
    ----------
    elements : Edges or Triangles
    n : int
        Number of vertices.

    Attributes
    ----------
    R : (n, 9) float64
        The rotations, first the identity; each call of :meth:`rotations` overwrites them.
    """

    def __init__(self, elements: Edges | Triangles, n: int) -> None:
        self._elements = elements
        self._Q, self._B = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)), np.empty((n, 3))
        self.R = np.tile(np.eye(3).ravel(), (n, 1))

    def rotations(self, u: np.ndarray) -> np.ndarray:
        """Fit the rotations to positions u (n, 3) and return them."""
        self._elements.covariances(u, self.R, 0, len(u))
        fit_rotations(self.R, self._Q)
        return self.R

    def forces(self, u: np.ndarray) -> np.ndarray:
        """Return the forces (n, 3) of the elements with the present rotations."""
        self._elements.forces(u, self.R, self._B, 0, len(u))
        return self._B


def blend(phi: csr_array, V: np.ndarray, *, rest: np.ndarray, nodes: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Move each vertex v to ``sum_m phi_m (R_m (v - p_m) + q_m)``.

    Parameters
    ----------
    phi : (n, p) sparse float64
        Each row adds up to 1.
    V : (n, 3) float64
    rest, nodes : (p, 3) float64
        Positions p of the nodes at rest, and q deformed.
    R : (p, 9) float64
        Rotations of the nodes.
    """
    shifts = nodes - np.einsum("pij,pj->pi", R.reshape(-1, 3, 3), rest)
    return np.einsum("vij,vj->vi", (phi @ R).reshape(-1, 3, 3), V) + phi @ shifts
