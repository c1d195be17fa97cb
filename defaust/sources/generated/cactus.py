"""A cactus: the smooth union of five capsules, triangulated at any resolution."""

from __future__ import annotations

import numpy as np

from defaust.sources.generated.lattices import split_quads

#: Ends of the axis and radius of each capsule: one for the trunk, two for each arm.
CAPSULES = (
    ((0.0, 0.0, 0.0), (0.0, 0.0, 6.0), 0.7),
    ((0.0, 0.0, 2.0), (-1.8, 0.0, 2.0), 0.4),
    ((-1.8, 0.0, 2.0), (-1.8, 0.0, 3.7), 0.4),
    ((0.0, 0.0, 2.8), (1.6, 0.0, 2.8), 0.35),
    ((1.6, 0.0, 2.8), (1.6, 0.0, 4.2), 0.35),
)
#: Width of the blend where capsules meet.
BLEND = 0.08
#: Distance from the capsules' axes within which the whole surface lies.
MARGIN = 1.0
#: Maximum number of vertices of a lattice; larger meshes are subdivided.
LATTICE = 150_000
#: Accepted relative error of the number of vertices, and maximum number of lattices tried.
CLOSE, ATTEMPTS = 0.02, 8
#: Rounds of moving each vertex to the mean of its neighbours and back onto the surface.
ROUNDS = 10
#: Decimals of coordinates. Last bits of exponentials depend on the processor.
DECIMALS = 8
#: Number of points at which the union is evaluated together.
BLOCK = 1 << 20


def cactus(vertices: int) -> tuple[np.ndarray, np.ndarray]:
    """Triangulate the cactus. It stands along +z; its arms point to -x and +x.

    A surface net of a regular lattice is relaxed along the surface. Meshes of more than
    :data:`LATTICE` vertices are subdivided from coarser meshes, with new vertices on the surface.

    Parameters
    ----------
    vertices : int
        Approximate number of vertices, met to a few per cent.

    Returns
    -------
    (n, 3) float64, (m, 3) int64
    """
    import igl

    doublings = 0
    while vertices > LATTICE * 4**doublings:
        doublings += 1
    wanted = vertices / 4**doublings
    step = (45.0 / wanted) ** 0.5  # the surface area is about 45
    for _ in range(ATTEMPTS):
        V, quads = _surface_net(step)
        if abs(len(V) - wanted) <= CLOSE * wanted:
            break
        step *= (len(V) / wanted) ** 0.5
    V = _relaxed(V, quads)
    a, b, c, d = quads.T
    shorter = np.linalg.norm(V[a] - V[c], axis=1) <= np.linalg.norm(V[b] - V[d], axis=1)
    F = split_quads(quads, shorter)
    for _ in range(doublings):
        V, F = igl.upsample(V, F)
        V = _onto_surface(V)
    return V.round(DECIMALS), F


def union(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Evaluate the smooth union -b log(sum of exp(-d_i / b)) of the distances d_i to the capsules, b = BLEND.

    Parameters
    ----------
    points : (k, 3) float64

    Returns
    -------
    (k,) float64
        Value, negative inside.
    (k, 3) float64
        Gradient.
    """
    blocks = [_union(points[begin : begin + BLOCK]) for begin in range(0, len(points), BLOCK)]
    value, gradient = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    return value, gradient


def _union(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    distances, directions = [], []
    for a, b, radius in CAPSULES:
        axis = np.subtract(b, a)
        along = np.clip((points - a) @ axis / (axis @ axis), 0.0, 1.0)
        away = points - a - along[:, None] * axis
        length = np.linalg.norm(away, axis=1)
        distances.append(length - radius)
        directions.append(away / np.maximum(length, 1e-12)[:, None])
    d = np.array(distances)
    nearest = d.min(axis=0)
    weight = np.exp((nearest - d) / BLEND)
    total = weight.sum(axis=0)
    gradient = np.einsum("ik,ikc->kc", weight / total, np.array(directions))
    return nearest - BLEND * np.log(total), gradient


def _surface_net(step: float) -> tuple[np.ndarray, np.ndarray]:
    """Extract a surface net: a vertex in each lattice cell on the surface, a quad for each lattice edge cut.

    S. F. F. Gibson, "Constrained elastic surface nets", 1998.
    """
    ends = np.array([end for a, b, _ in CAPSULES for end in (a, b)])
    low, high = ends.min(axis=0) - MARGIN, ends.max(axis=0) + MARGIN
    axes = [np.arange(a, b + step, step) for a, b in zip(low, high, strict=True)]
    shape = tuple(map(len, axes))
    inside = np.empty(shape, dtype=bool)
    for i, x in enumerate(axes[0]):
        sheet = np.stack(np.meshgrid([x], axes[1], axes[2], indexing="ij"), axis=-1)
        inside[i] = (union(sheet.reshape(-1, 3))[0] < 0).reshape(shape[1:])
    corners = [
        inside[i : i + shape[0] - 1, j : j + shape[1] - 1, k : k + shape[2] - 1]
        for i, j, k in np.ndindex(2, 2, 2)
    ]
    passed = np.logical_or.reduce(corners) & ~np.logical_and.reduce(corners)
    ids = np.cumsum(passed, dtype=np.int64).reshape(passed.shape) - 1
    V = low + step * (np.argwhere(passed) + 0.5)
    quads = []
    for axis in range(3):
        along = np.moveaxis(inside, axis, 0)
        cell = np.moveaxis(ids, axis, 0)
        cut = np.argwhere(along[:-1] != along[1:])
        x, y, z = cut.T
        ring = np.stack([cell[x, y - dj, z - dk] for dj, dk in ((0, 0), (1, 0), (1, 1), (0, 1))], axis=1)
        # Moving axis y to the front mirrors the lattice; x and z do not.
        outward = along[x, y, z] != (axis == 1)
        quads.append(np.where(outward[:, None], ring, ring[:, ::-1]))
    return V, np.concatenate(quads)


def _relaxed(V: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Spread vertices evenly over the surface by Laplacian smoothing."""
    from scipy.sparse import coo_array

    # Neighbours are all corners of a quad: with its sides alone, quads collapse along a diagonal.
    ends = quads[:, [*np.repeat(range(4), 4)]].ravel(), quads[:, [*range(4)] * 4].ravel()
    adjacency = coo_array((np.ones(len(ends[0])), ends), shape=(len(V), len(V))).tocsr()
    degree = adjacency.sum(axis=1)[:, None]
    V = _onto_surface(V)
    for _ in range(ROUNDS):
        V = _onto_surface((adjacency @ V) / degree)
    return V


def _onto_surface(V: np.ndarray) -> np.ndarray:
    """Move nearby points onto the surface by Newton steps along the gradient."""
    for _ in range(3):
        value, gradient = union(V)
        V = V - (value / np.einsum("kc,kc->k", gradient, gradient))[:, None] * gradient
    return V
