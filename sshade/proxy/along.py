"""Move other meshes along with a deformed mesh, such as the clothes and the hair of a body.

Samples s_k of the mesh have the rotations R_k that fit best to the edges around them. A point x moves to

    x' = sum_k w_k (R_k (x - s_k) + s_k') ,   w_k = (1 - |x - s_k| / r)^2 / sum ,

over the samples within the radius r = min(d_NEAREST, REACH (d_1 + h)), where d_i is the distance of the i-th
nearest sample and h the spacing of the samples. Near the surface r is small, so that tight clothes follow the
surface below them. Farther away r is large, so that a skirt between two legs stretches; the nearest sample
alone would tear it. Rigid motions of the mesh move the points rigidly.
"""

from __future__ import annotations

import logging

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from sshade.core.errors import InputError, counted
from sshade.core.threads import available_cpus
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.mesh import Mesh, bounds, require_mesh
from sshade.problem.task import DeformationResult
from sshade.proxy.blended import nearest_rotations
from sshade.proxy.sample import sample_farthest
from sshade.proxy.vertex_maps import VertexMaps

log = logging.getLogger(__name__)

#: Number of samples of the mesh, and of the nearest ones that move a point.
SAMPLES, NEAREST = 3000, 300
#: Radius within which samples move a point, over the distance of the nearest one plus the spacing of samples.
REACH = 2.0
#: Factor on the radius that keeps a weight above zero where all samples are equally far away.
BEYOND = 1 + 1e-6
#: Largest distance of a point from the bounding box, as a fraction of its diagonal.
FARTHEST = 0.5
#: Distance of a point from the mesh from which on it is named, as a fraction of the diagonal.
FAR = 0.05
#: Number of points that are moved at a time, so that their weights need little memory.
ROWS = 10_000


def move_along(mesh: Mesh, posed: DeformationResult | np.ndarray, points: np.ndarray) -> np.ndarray:
    """Move points along with a mesh: the vertices of clothes, hair and other meshes near it.

    Parameters
    ----------
    mesh : Mesh
        The mesh at rest. It may have several components, boundaries and edges of many faces.
    posed : DeformationResult or (n, 3) float64
        Posed vertices of the mesh.
    points : (m, 3) float64
        Positions at rest, on the mesh, inside it or near it.

    Returns
    -------
    (m, 3) float64

    Raises
    ------
    InputError
        If `posed` has another shape or is not finite, or as :func:`require_near`.

    Examples
    --------
    >>> import numpy as np
    >>> from sshade import Mesh, move_along
    >>> V = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    >>> mesh = Mesh(V, np.array([[0, 1, 2], [0, 2, 3]]))
    >>> move_along(mesh, V + [0, 0, 2], [[0.5, 0.2, 0.1]]).round(6).tolist()
    [[0.5, 0.2, 2.1]]
    """
    moved, distance = moved_with_distance(mesh, posed, points)
    if (farthest := distance.max(initial=0.0)) > FAR:
        log.warning("points are up to %s", how_far(farthest))
    return moved


def how_far(distance: float) -> str:
    """Return words for points that are far from a mesh; a distance of 1 is the bounding-box diagonal."""
    return f"{100 * distance:.2g} % of the diagonal away from the mesh; check that they are where they belong"


def moved_with_distance(
    mesh: Mesh, posed: DeformationResult | np.ndarray, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Move points as :func:`move_along`; return also their distances (m,) from the mesh, over its diagonal.

    A distance is the one from the nearest sample less the spacing of samples, so that it is never too large.
    """
    require_mesh(mesh, "move_along")
    V = mesh.checked(posed.vertices if isinstance(posed, DeformationResult) else posed, "pose")
    X = require_near(mesh, points) - mesh.origin
    first = np.zeros(1, dtype=np.int64)
    samples = sample_farthest(mesh, vertex_graph(mesh), min(SAMPLES, mesh.n), first=first).samples
    rest, R = mesh.V[samples] - mesh.origin, nearest_rotations(VertexMaps.at_rest(mesh)(V)[0][samples])
    motions = np.concatenate([R.reshape(-1, 9), V[samples] - np.einsum("kij,kj->ki", R, rest)], axis=1)
    tree, spacing = cKDTree(rest), np.sqrt(mesh.area / len(samples))
    placed, distance = np.empty(X.shape), np.empty(len(X))
    for begin in range(0, len(X), ROWS):
        part = X[begin : begin + ROWS]
        weights, distance[begin : begin + ROWS] = _weights(tree, part, spacing)
        mean = weights @ motions
        turned = np.einsum("nij,nj->ni", mean[:, :9].reshape(-1, 3, 3), part)
        placed[begin : begin + ROWS] = turned + mean[:, 9:]
    return placed, np.maximum(distance - spacing, 0.0) / mesh.diagonal


def require_near(mesh: Mesh, points: np.ndarray) -> np.ndarray:
    """Return points (m, 3) as float64; raise InputError if they cannot move along with a mesh.

    Raises
    ------
    InputError
        On another shape, a NaN or infinite coordinate, or a point outside the bounding box by more than
        :data:`FARTHEST` of its diagonal.
    """
    X = np.asarray(points, dtype=np.float64)
    if X.ndim != 2 or X.shape[1] != 3:
        raise InputError(f"points must be an (m, 3) array, not one of shape {X.shape}")
    if len(bad := np.flatnonzero(~np.isfinite(X).all(axis=1))):
        raise InputError(f"point {bad[0]} has a NaN or infinite coordinate")
    low, high = bounds(mesh.V)
    distance, allowed = np.linalg.norm(X - X.clip(low, high), axis=1), FARTHEST * mesh.diagonal
    if far := int((distance > allowed).sum()):
        worst = int(np.argmax(distance))
        are = counted(far, f"of {len(X)} points is", f"of {len(X)} points are")
        raise InputError(
            f"{are} too far from the box of the mesh: point {worst} by {distance[worst]:.3g}, where "
            f"{allowed:.3g} is allowed, {100 * FARTHEST:.0f} % of the diagonal; leave them out, or check the "
            "units"
        )
    return X


def _weights(tree: cKDTree, X: np.ndarray, spacing: float) -> tuple[csr_array, np.ndarray]:
    """Return the weights (m, k) of samples for points X (m, 3), and distances (m,) of the nearest samples."""
    near = min(NEAREST, tree.n)
    d, sample = tree.query(X, np.arange(1, near + 1), workers=available_cpus())
    r = np.minimum(BEYOND * d[:, -1:], REACH * (d[:, :1] + spacing))
    w = np.maximum(1 - d / np.maximum(r, np.finfo(float).tiny), 0) ** 2
    w /= w.sum(axis=1, keepdims=True)
    entries = w.ravel(), sample.ravel(), np.arange(0, w.size + 1, near)
    return csr_array(entries, shape=(len(X), tree.n)), d[:, 0]
