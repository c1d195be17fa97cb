"""Interpolate a smooth map of space between scattered points: local polyharmonic splines on a grid.

Each centre has a spline of its own, which interpolates the map at the points around the centre:

    f_c(x) = R x + t + P (x, 1) + sum_j w_j |x - x_j|^3 ,

with the best rigid motion (R, t) of these points and a linear polynomial P of the rest. The splines are
blended at the nodes of a grid: values f_n and linear maps G_n. At a point x of a cell with trilinear weights
w_n and the mean G = sum_n w_n G_n, the map is

    x' = sum_n w_n (f_n + (G_n + G) (x - x_n) / 2) ,

whose error is of third order in the size of the cell. Rigid motions are exact. Affine maps are exact where
the points of each spline span space.

Sources: J. Duchon, "Splines minimizing rotation-invariant semi-norms in Sobolev spaces", 1977 (|x|^3);
H. Wendland, "Fast evaluation of radial basis functions: methods based on partition of unity", 2002.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from sshade.core.kernels import kernel, subroutine
from sshade.core.threads import CHUNK, ThreadTeam, available_cpus

#: Number of points of a spline: the nearest ones, and in equal number the nearest ones of a thinned set.
POINTS = 50
#: Number of splines that are blended at a node.
BLENDED = 6
#: Cells of the grid along the diagonal of the bounding box.
CELLS = 128
#: Smallest extent of a spline's points in a direction along which its polynomial is linear, as a fraction of
#: their largest extent.
FLAT = 1e-3
#: Number of nodes that a thread evaluates at a time.
NODES = 2048
#: Number of splines that are solved at once.
BATCH = 512


@dataclass(frozen=True)
class Splines:
    """Local splines around centres.

    Attributes
    ----------
    tree : cKDTree
        Of the centres.
    points : (c, p) int
        Points of each spline; the first one is its centre.
    x : (k, 3) float64
        All points at rest.
    linear, offset : (c, 3, 3), (c, 3) float64
        Linear maps R + P and offsets: rigid motion and polynomial around the centre.
    weights : (c, p, 3) float64
    scale : (c,) float64
        Length by which distances are divided.
    """

    tree: cKDTree
    points: np.ndarray
    x: np.ndarray
    linear: np.ndarray
    offset: np.ndarray
    weights: np.ndarray
    scale: np.ndarray


def fit_splines(x: np.ndarray, y: np.ndarray, points: np.ndarray) -> Splines:
    """Fit a spline around each centre.

    Parameters
    ----------
    x, y : (k, 3) float64
        Points at rest, all different, and their images.
    points : (c, p) int
        Points of each spline, its centre first, see :func:`neighbours`.
    """
    c, p = points.shape
    linear, offset, scale = np.empty((c, 3, 3)), np.empty((c, 3)), np.empty(c)
    weights = np.empty((c, p, 3))
    for begin in range(0, c, BATCH):
        part = slice(begin, begin + BATCH)
        X, Y = x[points[part]], y[points[part]]
        origin, image = X[:, :1].copy(), Y[:, :1].copy()
        size = np.linalg.norm(X - origin, axis=2).max(axis=1)
        X = (X - origin) / size[:, None, None]
        R = _best_rotations(X, Y)
        Z = Y - image - size[:, None, None] * (X @ R.transpose(0, 2, 1))
        W, P = _solved(X, Z)
        weights[part], scale[part] = W, size
        linear[part] = R + P[:, 1:].transpose(0, 2, 1) / size[:, None, None]
        offset[part] = image[:, 0] + P[:, 0]
    return Splines(cKDTree(x[points[:, 0]]), points, x, linear, offset, weights, scale)


def neighbours(x: np.ndarray, thinned: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """Return the points (c, p) of each spline: its centre, the nearest points, and nearest thinned points.

    Parameters
    ----------
    x : (k, 3) float64
        Points at rest, all different.
    thinned : (t,) int
        Points of a set without clusters.
    centres : (c,) int
        Points that are centres.
    """
    p = min(POINTS, len(x))
    near = cKDTree(x).query(x[centres], k=p)[1].reshape(len(centres), p)
    if p == len(x):
        return near
    half = p // 2
    far = cKDTree(x[thinned]).query(x[centres], k=min(p, len(thinned)))[1].reshape(len(centres), -1)
    far = thinned[far]
    # Take thinned points that are not among the nearest half, then fill with the nearest points.
    known = (far[:, :, None] == near[:, None, :half]).any(axis=2)
    order = np.argsort(known, axis=1, kind="stable")
    far = np.take_along_axis(far, order, axis=1)
    points, width = near.copy(), min(p - half, far.shape[1])
    # A row with too few other thinned points keeps its nearest points, which include all thinned ones.
    rows = (~known).sum(axis=1) >= width
    points[rows, half : half + width] = far[rows, :width]
    return points


def _best_rotations(X: np.ndarray, Y: np.ndarray) -> np.ndarray:
    """Return the rotations R (c, 3, 3) for which R x is nearest to y, up to translations."""
    X, Y = X - X.mean(axis=1, keepdims=True), Y - Y.mean(axis=1, keepdims=True)
    U, _, Vt = np.linalg.svd(Y.transpose(0, 2, 1) @ X)
    U[:, :, 2] *= np.sign(np.linalg.det(U @ Vt))[:, None]
    return U @ Vt


def _solved(X: np.ndarray, Z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the weights (c, p, 3) and polynomials (c, 4, 3) of splines with points X and values Z."""
    c, p, _ = X.shape
    distance = np.linalg.norm(X[:, :, None] - X[:, None], axis=3)
    _, size, axes = np.linalg.svd(X - X.mean(axis=1, keepdims=True), full_matrices=False)
    flat = size < FLAT * size[:, :1]
    along = X @ axes.transpose(0, 2, 1)  # coordinates along the principal axes
    along[np.broadcast_to(flat[:, None], along.shape)] = 0.0
    A = np.zeros((c, p + 4, p + 4))
    A[:, :p, :p] = distance**3
    A[:, :p, p] = A[:, p, :p] = 1.0
    A[:, :p, p + 1 :], A[:, p + 1 :, :p] = along, along.transpose(0, 2, 1)
    for axis in range(3):
        A[:, p + 1 + axis, p + 1 + axis] = flat[:, axis]
    right = np.zeros((c, p + 4, 3))
    right[:, :p] = Z
    found = np.linalg.solve(A, right)
    P = found[:, p:].copy()
    P[:, 1:] = axes.transpose(0, 2, 1) @ P[:, 1:]
    return found[:, :p], P


def interpolate(splines: Splines, V: np.ndarray) -> np.ndarray:
    """Return the images (n, 3) of points V (n, 3)."""
    low = V.min(axis=0)
    cell = float(np.linalg.norm(V.max(axis=0) - low)) / CELLS
    size = ((V.max(axis=0) - low) / cell).astype(np.int64) + 2
    number, used = _number_nodes(V, low, cell, size)
    ijk = np.column_stack(np.unravel_index(used, size))
    nodes = low + cell * ijk
    k = min(BLENDED + 1, len(splines.scale))
    m = max(k - 1, 1)
    distance, centre = splines.tree.query(nodes, k=k, workers=available_cpus())
    distance, centre = distance.reshape(len(nodes), -1), centre.reshape(len(nodes), -1)
    share = np.maximum(1.0 - distance[:, :m] / np.maximum(distance[:, -1:], 1e-300), 0.0) ** 2
    share[share.sum(axis=1) == 0, 0] = 1.0
    share /= share.sum(axis=1, keepdims=True)
    values = np.empty((len(nodes), 12))
    blended = np.ascontiguousarray(centre[:, :m]), share, splines.points, splines.x, splines.linear
    fitted = splines.offset, splines.weights, splines.scale, values
    out = np.empty_like(V)
    with ThreadTeam(available_cpus() if len(nodes) > NODES else 1) as team:
        team.ranges(_evaluate, len(nodes), nodes, *blended, *fitted, rows=NODES)
        team.ranges(_place, len(V), V, low, cell, size, number, values, out, rows=CHUNK)
    return out


@kernel
def _number_nodes(V, low, cell, size):
    """Number the nodes of the cells that contain points; return the numbers (all nodes) and the nodes."""
    number = np.full(size[0] * size[1] * size[2], -1, np.int32)
    for v in range(len(V)):
        i = int((V[v, 0] - low[0]) / cell)
        j = int((V[v, 1] - low[1]) / cell)
        k = int((V[v, 2] - low[2]) / cell)
        for corner in range(8):
            a, b, c = i + (corner & 1), j + (corner >> 1 & 1), k + (corner >> 2)
            number[(a * size[1] + b) * size[2] + c] = 0
    used = np.flatnonzero(number == 0)
    for n in range(len(used)):
        number[used[n]] = n
    return number, used


@kernel
def _evaluate(first, end, nodes, centre, share, points, x, linear, offset, weights, scale, values):
    """Write the value (3) and the linear map (9) of nodes `first` to `end` to their rows of `values`."""
    f, G = np.empty(3), np.empty((3, 3))
    for n in range(first, end):
        values[n, :] = 0.0
        for s in range(centre.shape[1]):
            w = share[n, s]
            if w == 0.0:
                continue
            _spline(nodes[n], centre[n, s], points, x, linear, offset, weights, scale, f, G)
            for r in range(3):
                values[n, r] += w * f[r]
                for t in range(3):
                    values[n, 3 + 3 * r + t] += w * G[r, t]


@subroutine
def _spline(at, c, points, x, linear, offset, weights, scale, f, G):
    """Write the value f (3,) and the linear map G (3, 3) of a spline at a point."""
    o = points[c, 0]
    for r in range(3):
        f[r] = offset[c, r]
        for t in range(3):
            G[r, t] = linear[c, r, t]
            f[r] += G[r, t] * (at[t] - x[o, t])
    unit = 1.0 / scale[c]
    for j in range(points.shape[1]):
        p = points[c, j]
        u, v, w = (at[0] - x[p, 0]) * unit, (at[1] - x[p, 1]) * unit, (at[2] - x[p, 2]) * unit
        square = u * u + v * v + w * w
        d = np.sqrt(square)
        g = 3.0 * d * unit
        for r in range(3):
            a = weights[c, j, r]
            f[r] += a * square * d
            G[r, 0] += a * g * u
            G[r, 1] += a * g * v
            G[r, 2] += a * g * w


@kernel
def _place(first, end, V, low, cell, size, number, values, out):
    mean, w8 = np.empty(9), np.empty(8)
    row = np.empty(8, np.int64)
    for v in range(first, end):
        x, y, z = (V[v, 0] - low[0]) / cell, (V[v, 1] - low[1]) / cell, (V[v, 2] - low[2]) / cell
        i, j, k = int(x), int(y), int(z)
        x, y, z = x - i, y - j, z - k
        mean[:] = 0.0
        for corner in range(8):
            a, b, c = corner & 1, corner >> 1 & 1, corner >> 2
            w = (x if a else 1.0 - x) * (y if b else 1.0 - y) * (z if c else 1.0 - z)
            n = number[((i + a) * size[1] + j + b) * size[2] + k + c]
            w8[corner], row[corner] = w, n
            for q in range(9):
                mean[q] += w * values[n, 3 + q]
        out[v, 0] = out[v, 1] = out[v, 2] = 0.0
        for corner in range(8):
            a, b, c = corner & 1, corner >> 1 & 1, corner >> 2
            dx, dy, dz = 0.5 * cell * (x - a), 0.5 * cell * (y - b), 0.5 * cell * (z - c)
            n, w = row[corner], w8[corner]
            for r in range(3):
                q = 3 * r
                out[v, r] += w * (
                    values[n, r]
                    + (values[n, 3 + q] + mean[q]) * dx
                    + (values[n, 4 + q] + mean[q + 1]) * dy
                    + (values[n, 5 + q] + mean[q + 2]) * dz
                )
