"""Loop subdivision of vertex values, on a mesh that another program subdivided or :func:`split` split."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array, eye_array

from defaust.sources.winding import same_triangles
from sshade import InputError, Mesh
from sshade.mesh.incidence import sides_by_edge


def split(mesh: Mesh) -> Mesh:
    """Split each triangle into four at the midpoints of its edges; new vertices come last."""
    middles = mesh.n + sides_by_edge(mesh.F, mesh.n).edge  # of the sides 01, 12, 20
    corners = np.stack([mesh.F, middles, np.roll(middles, 1, axis=1)], axis=2).reshape(-1, 3)
    V = np.concatenate([mesh.V, mesh.V[mesh.edges].mean(axis=1)])
    return Mesh(V, np.concatenate([corners, middles]))


def loop_matrix(coarse: Mesh, fine: Mesh, *, steps: int) -> csr_array:
    """Matrix of Loop subdivision: from vertex values of a mesh to vertex values of its subdivision.

    Parameters
    ----------
    coarse : Mesh
        Closed and manifold.
    fine : Mesh
        The mesh after `steps` subdivisions of each triangle into four. Each subdivision must append its new
        vertices, as pymeshlab does. Positions do not matter.
    steps : int

    Returns
    -------
    (fine.n, coarse.n) sparse float64
        Each row adds up to 1.

    Raises
    ------
    InputError
        When `fine` is not such a subdivision.

    References
    ----------
    C. Loop, "Smooth subdivision surfaces based on triangles", 1987, with the weights of
    J. Warren, "Subdivision methods for geometric design", 1995.
    """
    # A closed mesh has 3 edges for 2 faces, and each step puts a vertex on each edge.
    counts = [coarse.n]
    for step in range(steps):
        counts.append(counts[-1] + 3 * coarse.m * 4**step // 2)
    if (fine.n, fine.m) != (counts[-1], coarse.m * 4**steps):
        raise InputError(
            f"the fine mesh has {fine.n} vertices and {fine.m} faces, but {steps} subdivisions of {coarse.n} "
            f"vertices and {coarse.m} faces give {counts[-1]} and {coarse.m * 4**steps}"
        )
    product, F = eye_array(fine.n, format="csr"), fine.F
    for count in counts[-2::-1]:
        step, F = _one_step(F, count)
        product = product @ step
    if not same_triangles(F, coarse.F):
        raise InputError("the fine mesh is no subdivision of the coarse mesh: their faces differ")
    return product


def _one_step(F: np.ndarray, n: int) -> tuple[csr_array, np.ndarray]:
    """Matrix of the last subdivision, and the faces before it; `n` counts the vertices before it.

    A subdivided face has three corner faces, each with one old and two new vertices, and a middle face with
    three new vertices. The old neighbours of a new vertex are therefore the ends of its edge, and together
    the edges of a middle face give the corners of the old face.
    """
    added = n <= F
    corner, middle = F[added.sum(axis=1) == 2], F[added.all(axis=1)]
    if 4 * len(middle) != len(F) or 4 * len(corner) != 3 * len(F):
        raise InputError(
            "the fine mesh does not number the vertices of each subdivision before the added ones"
        )
    old = corner[corner < n].repeat(2)
    pairs = np.unique(np.stack([corner[corner >= n], old], axis=1), axis=0)
    total = n + 3 * len(middle) // 2
    if not np.array_equal(pairs[:, 0], np.arange(n, total).repeat(2)):
        raise InputError("the fine mesh does not have a vertex on each edge of the coarse mesh")
    ends = pairs[:, 1].reshape(-1, 2)

    sums = ends[middle - n].sum(axis=2)
    corners = sums.sum(axis=1, keepdims=True) // 2 - sums  # opposite each of the three new vertices
    i, j = ends[:, 0], ends[:, 1]
    valence = np.bincount(ends.ravel(), minlength=n)
    weight = np.where(valence == 3, 3 / 16, 3 / (8 * valence))
    parts = (
        (np.arange(n), np.arange(n), 1 - valence * weight),
        (i, j, weight[i]),
        (j, i, weight[j]),
        (pairs[:, 0], pairs[:, 1], np.full(len(pairs), 3 / 8)),
        (middle.ravel(), corners.ravel(), np.full(middle.size, 1 / 8)),
    )
    rows, columns, values = (np.concatenate(part) for part in zip(*parts, strict=True))
    return coo_array((values, (rows, columns)), shape=(total, n)).tocsr(), corners
