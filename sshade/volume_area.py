"""Volume and area of triangle meshes by component: values, gradients, and Newton's method on both.

The volume's derivative with respect to vertex i is a third of the vector area
of the triangles at i. In that form, unlike with cross products of positions,
it depends on edges alone: nothing cancels far from the origin.

Faces of one component lie side by side, those of component k from ``start[k]``
on. Arrays of constraints have a row for each quantity held; `kind` says which.
"""

from __future__ import annotations

import numpy as np
from numba import njit

VOLUME, AREA = 0, 1
#: Error of an equation at which Newton's method stops.
CLOSE = 1e-12
#: An error below this that a step does not halve is rounding.
ROUNDING = 1e-9
#: Condition number beyond which two gradients count as parallel.
PARALLEL = 1e10
#: Evaluations of the equations at most; 3 are usual.
MOST_EVALUATIONS = 12


@njit(cache=True, nogil=True)
def measure(F, start, P):
    """Volume and area of each component.

    Parameters
    ----------
    F : (m, 3) int32
        Faces, component by component.
    start : (c + 1,) int64
        Where each component's faces begin.
    P : (n, 3) float64

    Returns
    -------
    (2, c) float64
        Signed volumes, which mean nothing where a component is not closed, and areas.
    """
    total = np.empty((2, len(start) - 1))
    for c in range(len(start) - 1):
        o = F[start[c], 0]
        volume = area = 0.0
        for t in range(start[c], start[c + 1]):
            i = F[t, 0]
            x, y, z = _cross(P, i, F[t, 1], F[t, 2])
            volume += (P[i, 0] - P[o, 0]) * x + (P[i, 1] - P[o, 1]) * y + (P[i, 2] - P[o, 2]) * z
            area += np.sqrt(x * x + y * y + z * z)
        total[0, c], total[1, c] = volume / 6.0, 0.5 * area
    return total


@njit(cache=True, nogil=True)
def gradients(F, start, kind, scale, P, G):
    """Derivatives of each quantity with respect to the vertices.

    Parameters
    ----------
    F, start, P
        As for :func:`measure`.
    kind : (q,) int64
        VOLUME or AREA.
    scale : (q, c) float64
        Factor on a quantity's gradient in a component; 0 leaves it out.
    G : (n, q, 3) float64
        Overwritten.
    """
    G[:] = 0.0
    for q in range(len(kind)):
        for c in range(len(start) - 1):
            if scale[q, c] != 0.0:
                if kind[q] == VOLUME:
                    _volume_gradient(F, start[c], start[c + 1], scale[q, c] / 6.0, P, G, q)
                else:
                    _area_gradient(F, start[c], start[c + 1], scale[q, c] / 2.0, P, G, q)


@njit(cache=True, nogil=True)
def newton(F, start, component, kind, scale, goal, compliance, Z, P):
    """Move P along Z to where ``scale C - goal + compliance x multiplier = 0``.

    The multipliers, one for each quantity and component, begin at zero. A
    Newton step is halved while it makes the worst equation of its component
    worse, and taken back if that does not help.

    Parameters
    ----------
    F, start, kind, scale
        As for :func:`gradients`; a scale of 0 leaves an equation out.
    component : (n,) int32
        Of each vertex.
    goal, compliance : (q, c) float64
    Z : (n, q, 3) float64
        Directions.
    P : (n, 3) float64
        Overwritten.

    Returns
    -------
    float
        Largest absolute value of an equation in the end.
    """
    count, held = len(start) - 1, len(kind)
    value, slope = np.empty((count, held)), np.empty((count, held, held))
    multiplier, move, taken = np.zeros((count, held)), np.zeros((count, held)), np.zeros((count, held))
    error, done = np.full(count, np.inf), np.zeros(count, dtype=np.bool_)
    for left in range(MOST_EVALUATIONS - 1, -1, -1):
        _along(F, start, kind, scale, P, Z, value, slope)
        busy = False
        for c in range(count):
            _equations(scale[:, c], goal[:, c], compliance[:, c], multiplier[c], value[c], slope[c])
            now = np.abs(value[c]).max()
            stalled = error[c] < ROUNDING and now > 0.5 * error[c]
            move[c] = 0.0
            if done[c]:
                continue
            if now > error[c]:
                share = 1.0 if stalled or left == 0 else 0.5
                move[c] = -share * taken[c]
                taken[c] *= 1.0 - share
            else:
                error[c] = now
                if now > CLOSE and left > 0 and not stalled:
                    _solve(slope[c], value[c], move[c])
                    taken[c] = move[c]
            done[c] = stalled or now <= CLOSE
            multiplier[c] += move[c]
            busy = busy or np.abs(move[c]).max() > 0.0
        if not busy:
            break
        for i in range(len(P)):
            c = component[i]
            for q in range(held):
                for d in range(3):
                    P[i, d] += move[c, q] * Z[i, q, d]
    return error.max()


@njit(cache=True, nogil=True)
def gather_columns(G, rows, X):
    """Write G (n, q, 3) of the vertices `rows` (f,) to columns 3.. of X (f, 3 + 3 q)."""
    for r in range(len(rows)):
        for q in range(G.shape[1]):
            for d in range(3):
                X[r, 3 + 3 * q + d] = G[rows[r], q, d]


@njit(cache=True, nogil=True)
def scatter_columns(X, rows, Z):
    """Write columns 3.. of X (f, 3 + 3 q) to the vertices `rows` (f,) of Z (n, q, 3)."""
    for r in range(len(rows)):
        for q in range(Z.shape[1]):
            for d in range(3):
                Z[rows[r], q, d] = X[r, 3 + 3 * q + d]


@njit(cache=True, nogil=True)
def _cross(P, i, j, k):
    """Twice the vector area of a triangle."""
    ax, ay, az = P[j, 0] - P[i, 0], P[j, 1] - P[i, 1], P[j, 2] - P[i, 2]
    bx, by, bz = P[k, 0] - P[i, 0], P[k, 1] - P[i, 1], P[k, 2] - P[i, 2]
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@njit(cache=True, nogil=True)
def _volume_gradient(F, first, end, scale, P, G, q):
    for t in range(first, end):
        i, j, k = F[t, 0], F[t, 1], F[t, 2]
        x, y, z = _cross(P, i, j, k)
        x, y, z = scale * x, scale * y, scale * z
        for corner in (i, j, k):
            G[corner, q, 0] += x
            G[corner, q, 1] += y
            G[corner, q, 2] += z


@njit(cache=True, nogil=True)
def _area_gradient(F, first, end, scale, P, G, q):
    for t in range(first, end):
        i, j, k = F[t, 0], F[t, 1], F[t, 2]
        x, y, z = _cross(P, i, j, k)
        length = np.sqrt(x * x + y * y + z * z)
        if length == 0.0:  # no direction is better than another
            continue
        x, y, z = scale * x / length, scale * y / length, scale * z / length
        # Each corner: the unit normal times the edge opposite.
        for corner, a, b in ((i, j, k), (j, k, i), (k, i, j)):
            ex, ey, ez = P[b, 0] - P[a, 0], P[b, 1] - P[a, 1], P[b, 2] - P[a, 2]
            G[corner, q, 0] += y * ez - z * ey
            G[corner, q, 1] += z * ex - x * ez
            G[corner, q, 2] += x * ey - y * ex


@njit(cache=True, nogil=True)
def _along(F, start, kind, scale, P, Z, value, slope):
    """Scaled values (c, q) of each quantity at P, and derivatives (c, q, q) along each direction of Z."""
    for c in range(len(start) - 1):
        for q in range(len(kind)):
            value[c, q] = 0.0
            slope[c, q, :] = 0.0
            if scale[q, c] != 0.0:
                if kind[q] == VOLUME:
                    value[c, q] = _volume_along(F, start[c], start[c + 1], P, Z, slope[c, q])
                else:
                    value[c, q] = _area_along(F, start[c], start[c + 1], P, Z, slope[c, q])
                value[c, q] *= scale[q, c]
                slope[c, q] *= scale[q, c]


@njit(cache=True, nogil=True)
def _volume_along(F, first, end, P, Z, slope):
    o, volume = F[first, 0], 0.0
    for t in range(first, end):
        i, j, k = F[t, 0], F[t, 1], F[t, 2]
        x, y, z = _cross(P, i, j, k)
        volume += (P[i, 0] - P[o, 0]) * x + (P[i, 1] - P[o, 1]) * y + (P[i, 2] - P[o, 2]) * z
        for q in range(len(slope)):
            slope[q] += (
                (Z[i, q, 0] + Z[j, q, 0] + Z[k, q, 0]) * x
                + (Z[i, q, 1] + Z[j, q, 1] + Z[k, q, 1]) * y
                + (Z[i, q, 2] + Z[j, q, 2] + Z[k, q, 2]) * z
            )
    slope /= 6.0
    return volume / 6.0


@njit(cache=True, nogil=True)
def _area_along(F, first, end, P, Z, slope):
    area = 0.0
    for t in range(first, end):
        i, j, k = F[t, 0], F[t, 1], F[t, 2]
        x, y, z = _cross(P, i, j, k)
        length = np.sqrt(x * x + y * y + z * z)
        area += length
        if length == 0.0:
            continue
        ax, ay, az = P[j, 0] - P[i, 0], P[j, 1] - P[i, 1], P[j, 2] - P[i, 2]
        bx, by, bz = P[k, 0] - P[i, 0], P[k, 1] - P[i, 1], P[k, 2] - P[i, 2]
        # The normal's derivative is da x b + a x db; in triple products (b x n) da + (n x a) db.
        ux, uy, uz = by * z - bz * y, bz * x - bx * z, bx * y - by * x
        vx, vy, vz = y * az - z * ay, z * ax - x * az, x * ay - y * ax
        for q in range(len(slope)):
            slope[q] += (
                ux * (Z[j, q, 0] - Z[i, q, 0])
                + uy * (Z[j, q, 1] - Z[i, q, 1])
                + uz * (Z[j, q, 2] - Z[i, q, 2])
                + vx * (Z[k, q, 0] - Z[i, q, 0])
                + vy * (Z[k, q, 1] - Z[i, q, 1])
                + vz * (Z[k, q, 2] - Z[i, q, 2])
            ) / length
    slope *= 0.5
    return 0.5 * area


@njit(cache=True, nogil=True)
def _equations(scale, goal, compliance, multiplier, value, slope):
    """Turn values and slopes into residuals and their Jacobian; an equation left out reads 0 = 0."""
    for q in range(len(scale)):
        if scale[q] != 0.0:
            value[q] += compliance[q] * multiplier[q] - goal[q]
            slope[q, q] += compliance[q]
        else:
            value[q] = 0.0
            slope[q, :] = 0.0
            slope[:, q] = 0.0
            slope[q, q] = 1.0


@njit(cache=True, nogil=True)
def _solve(J, r, x):
    """Newton step ``J x = -r`` of one or two unknowns; least squares where J is nearly singular."""
    if len(r) == 1:
        x[0] = -r[0] / J[0, 0] if J[0, 0] != 0.0 else 0.0
        return
    a, b, c, d = J[0, 0], J[0, 1], J[1, 0], J[1, 1]
    determinant, square = a * d - b * c, a * a + b * b + c * c + d * d
    if PARALLEL * abs(determinant) > square:  # the condition is about square / determinant
        x[0], x[1] = (b * r[1] - d * r[0]) / determinant, (c * r[0] - a * r[1]) / determinant
    elif square > 0.0:
        x[0], x[1] = -(a * r[0] + c * r[1]) / square, -(b * r[0] + d * r[1]) / square
    else:
        x[:] = 0.0
