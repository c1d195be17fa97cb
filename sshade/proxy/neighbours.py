"""Replace undefined frames and maps by the mean of their neighbours."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sshade.mesh.sides import sides_by_edge


def fill_from_neighbours(
    values: np.ndarray,
    known: np.ndarray,
    *,
    pairs: np.ndarray,
    onto: Callable[[np.ndarray], np.ndarray] | None = None,
) -> np.ndarray:
    """Replace unknown 3 x 3 matrices by the mean of their known neighbours, ring by ring inwards.

    Parameters
    ----------
    values : (k, 3, 3) float64
    known : (k,) bool
        Entries that are defined.
    pairs : (e, 2) int
        Pairs of neighbouring entries.
    onto : callable, optional
        Maps the means (j, 3, 3) of a ring to admissible matrices, for example to the nearest rotations.

    Returns
    -------
    (k, 3, 3) float64
        `values` itself if all are known. The identity where no known entry is connected.
    """
    if known.all():
        return values
    flat, known = np.where(known[:, None], values.reshape(-1, 9), 0.0), known.copy()
    one, two = np.concatenate([pairs, pairs[:, ::-1]]).T
    while True:
        use = known[two] & ~known[one]
        ready = np.unique(one[use])
        if len(ready) == 0:
            flat[~known] = np.eye(3).ravel()
            return flat.reshape(-1, 3, 3)
        count = np.bincount(one[use], minlength=len(known))
        mean = sums_by_index(one[use], flat[two[use]], len(known))[ready] / count[ready, None]
        flat[ready] = mean if onto is None else onto(mean.reshape(-1, 3, 3)).reshape(-1, 9)
        known[ready] = True


def sums_by_index(index: np.ndarray, rows: np.ndarray, count: int) -> np.ndarray:
    """Return the sums (count, r) of rows (m, r) with the same index (m,)."""
    return np.stack([np.bincount(index, column, count) for column in rows.T], axis=1)


def adjacent_triangles(F: np.ndarray) -> np.ndarray:
    """Return the pairs (p, 2) of triangles that share an edge; F (l, 3) int must be manifold."""
    sides = sides_by_edge(F, int(F.max()) + 1)
    first = sides.start[:-1][sides.faces == 2]
    return np.stack([sides.side[first], sides.side[first + 1]], axis=1) // 3
