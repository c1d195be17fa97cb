"""A tree of boxes over the faces of a mesh."""

from __future__ import annotations

import numpy as np
from numba import njit

from sshade.threads import ThreadTeam

#: Leaves whose boxes a thread fits at a time.
CHUNK = 8192


def bounds(V: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest coordinates (3,) of positions (n, 3); NaN where there is one."""
    # Along the axis of a three-column array NumPy takes twenty times as long.
    columns = [V[:, c] for c in range(3)]
    return np.array([x.min() for x in columns]), np.array([x.max() for x in columns])


def curve_order(V: np.ndarray, F: np.ndarray) -> np.ndarray:
    """The order of faces along a Morton curve, in which those near each other lie together.

    Parameters
    ----------
    V : (n, 3) float64
    F : (m, 3) int64

    Returns
    -------
    (m,) int64
    """
    return np.argsort(_morton(V, F), kind="stable")


def box_tree(
    V: np.ndarray, F: np.ndarray, *, leaf_size: int, team: ThreadTeam
) -> tuple[np.ndarray, np.ndarray]:
    """The boxes of faces, and a complete binary tree over them.

    A box is (low, high) in six numbers. Node i of the tree, counted from 1, has
    the children 2i and 2i + 1; the last half of the nodes are leaves, a power of
    two, of `leaf_size` faces each. An unused leaf has an empty box, which
    overlaps nothing.

    Parameters
    ----------
    V : (n, 3) float64
    F : (m, 3) int64
        In the order of :func:`curve_order`, of these positions or of others like them.
    leaf_size : int
    team : ThreadTeam

    Returns
    -------
    face_boxes : (m, 6) float64
    boxes : (2 * leaves, 6) float64
        Row 0 is unused.
    """
    filled = -(-len(F) // leaf_size)
    leaves = 1 << (filled - 1).bit_length()
    face_boxes, boxes = np.empty((len(F), 6)), np.empty((2 * leaves, 6))

    def chunk(number: int) -> None:
        leaf_range = number * CHUNK, min(leaves, (number + 1) * CHUNK)
        _fit_leaves(V, F, leaf_size, *leaf_range, face_boxes, boxes)

    team(chunk, -(-leaves // CHUNK))
    _fit_inner_nodes(boxes)
    return face_boxes, boxes


@njit(cache=True, nogil=True)
def _fit_leaves(V, F, leaf_size, first, end, face_boxes, boxes):
    """Set the boxes of the leaves from `first` to `end`, and of their faces."""
    m, leaves = len(F), len(boxes) // 2
    for leaf in range(first, end):
        node = leaves + leaf
        for c in range(3):
            boxes[node, c], boxes[node, c + 3] = np.inf, -np.inf
        for f in range(leaf * leaf_size, min(m, (leaf + 1) * leaf_size)):
            for c in range(3):
                x, y, z = V[F[f, 0], c], V[F[f, 1], c], V[F[f, 2], c]
                low, high = min(x, y, z), max(x, y, z)
                face_boxes[f, c], face_boxes[f, c + 3] = low, high
                boxes[node, c] = min(boxes[node, c], low)
                boxes[node, c + 3] = max(boxes[node, c + 3], high)


@njit(cache=True, nogil=True)
def _fit_inner_nodes(boxes):
    """Set the boxes of all nodes but the leaves to hold those of their children."""
    for node in range(len(boxes) // 2 - 1, 0, -1):
        for c in range(3):
            boxes[node, c] = min(boxes[2 * node, c], boxes[2 * node + 1, c])
            boxes[node, c + 3] = max(boxes[2 * node, c + 3], boxes[2 * node + 1, c + 3])


@njit(cache=True, nogil=True)
def _morton(V, F):
    """(m,) int64 position of the middle of each face's box along a Morton curve, 20 bits an axis."""
    middle = np.empty((len(F), 3))
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for f in range(len(F)):
        for c in range(3):
            x, y, z = V[F[f, 0], c], V[F[f, 1], c], V[F[f, 2], c]
            middle[f, c] = 0.5 * (min(x, y, z) + max(x, y, z))
            low[c], high[c] = min(low[c], middle[f, c]), max(high[c], middle[f, c])
    extent = max(high[0] - low[0], high[1] - low[1], high[2] - low[2])
    scale = (2**20 - 1) / extent if extent > 0 else 0.0
    code = np.zeros(len(F), dtype=np.int64)
    for f in range(len(F)):
        for c in range(3):
            bits = np.int64((middle[f, c] - low[c]) * scale)
            # The usual magic numbers: each step moves half of the bits apart.
            bits = (bits | (bits << 32)) & 0x1F00000000FFFF
            bits = (bits | (bits << 16)) & 0x1F0000FF0000FF
            bits = (bits | (bits << 8)) & 0x100F00F00F00F00F
            bits = (bits | (bits << 4)) & 0x10C30C30C30C30C3
            bits = (bits | (bits << 2)) & 0x1249249249249249
            code[f] |= bits << c
    return code
