"""A tree of boxes over the faces of a mesh."""

from __future__ import annotations

import numpy as np


def box_tree(V: np.ndarray, F: np.ndarray, leaf_size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The order of the faces along a Morton curve, their boxes in it, and a complete binary tree over them.

    A box is (low, high) in six numbers. Node i of the tree, counted from 1, has
    the children 2i and 2i + 1; the last half of the nodes are leaves, a power of
    two, of `leaf_size` faces each. An unused leaf has an empty box, which
    overlaps nothing.
    """
    corners = V[F]
    low, high = corners.min(axis=1), corners.max(axis=1)
    order = np.argsort(_morton(0.5 * (low + high)), kind="stable")
    low, high = low[order], high[order]
    filled = -(-len(F) // leaf_size)
    leaves = 1 << max(0, int(np.ceil(np.log2(filled))))
    boxes = np.empty((2 * leaves, 6))
    boxes[:, :3], boxes[:, 3:] = np.inf, -np.inf
    start = np.arange(0, len(F), leaf_size)
    boxes[leaves : leaves + filled, :3] = np.minimum.reduceat(low, start)
    boxes[leaves : leaves + filled, 3:] = np.maximum.reduceat(high, start)
    level = leaves
    while level > 1:
        below = boxes[level : 2 * level]
        boxes[level // 2 : level, :3] = np.minimum(below[0::2, :3], below[1::2, :3])
        boxes[level // 2 : level, 3:] = np.maximum(below[0::2, 3:], below[1::2, 3:])
        level //= 2
    return order, np.hstack([low, high]), boxes


def _morton(points: np.ndarray) -> np.ndarray:
    """(m,) uint64 position of each point along a Morton curve, 20 bits an axis."""
    extent = float(np.ptp(points, axis=0).max())
    grid = (points - points.min(axis=0)) * ((2**20 - 1) / extent if extent > 0 else 0.0)
    code = np.zeros(len(points), dtype=np.uint64)
    for axis in range(3):
        bits = grid[:, axis].astype(np.uint64)
        # The usual magic numbers: each step moves half of the bits apart.
        for shift, mask in (
            (32, 0x1F00000000FFFF),
            (16, 0x1F0000FF0000FF),
            (8, 0x100F00F00F00F00F),
            (4, 0x10C30C30C30C30C3),
            (2, 0x1249249249249249),
        ):
            bits = (bits | (bits << np.uint64(shift))) & np.uint64(mask)
        code |= bits << np.uint64(axis)
    return code
