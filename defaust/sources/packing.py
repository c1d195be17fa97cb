"""Meshes packed for the package: positions on a lattice of 16 bits, neighbours stored one after another."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.sparse.csgraph import reverse_cuthill_mckee

from sshade import Mesh
from sshade.mesh.adjacency import edge_graph

#: Lattice steps along the longest side of the bounding box.
STEPS = 2**16 - 1
#: Bytes of a stored difference.
BYTES = 3


def pack(mesh: Mesh) -> dict[str, np.ndarray]:
    """Arrays that compress well, of a mesh of less than 4 million vertices, which is renumbered.

    Positions are rounded to a cubic lattice of which :data:`STEPS` steps span the longest side of the
    bounding box, so that no coordinate moves by more than half a step. Vertices are numbered by the
    reverse Cuthill-McKee order and faces sorted; what is stored are differences, byte by byte.

    Returns
    -------
    dict
        ``corner`` (3,) and ``step`` () float64, ``vertices`` (3, n, 3) and ``faces`` (3, m, 3) uint8.
    """
    corner = mesh.V.min(axis=0)
    step = (mesh.V.max(axis=0) - corner).max() / STEPS
    order = reverse_cuthill_mckee(edge_graph(mesh).matrix.tocsr(), symmetric_mode=True)
    number = np.empty(mesh.n, dtype=np.int64)
    number[order] = np.arange(mesh.n)
    lattice = np.round((mesh.V[order] - corner) / step).astype(np.int64)
    F = number[mesh.F]
    F = np.take_along_axis(F, (F.argmin(axis=1)[:, None] + np.arange(3)) % 3, axis=1)
    F = F[np.lexsort(F.T[::-1])]
    F = np.diff(F, axis=1, prepend=0)
    F[:, 0] = np.diff(F[:, 0], prepend=0)
    return {
        "corner": corner,
        "step": np.float64(step),
        "vertices": _planes(np.diff(lattice, axis=0, prepend=0)),
        "faces": _planes(F),
    }


def unpack(arrays: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) float64 and faces (m, 3) int64 of the arrays of :func:`pack`."""
    V = arrays["corner"] + arrays["step"] * np.cumsum(_integers(arrays["vertices"]), axis=0)
    F = _integers(arrays["faces"])
    F[:, 0] = np.cumsum(F[:, 0])
    return V, np.cumsum(F, axis=1)


def _planes(integers: np.ndarray) -> np.ndarray:
    """(BYTES, k, 3) uint8 of signed integers (k, 3), the small ones zero in all planes but the first."""
    unsigned = np.where(integers < 0, -2 * integers - 1, 2 * integers)
    return np.stack([(unsigned >> 8 * k & 0xFF).astype(np.uint8) for k in range(BYTES)])


def _integers(planes: np.ndarray) -> np.ndarray:
    """(k, 3) int64 signed integers of their planes."""
    unsigned = sum(plane.astype(np.int64) << 8 * k for k, plane in enumerate(planes))
    return np.where(unsigned & 1, -(unsigned >> 1) - 1, unsigned >> 1)
