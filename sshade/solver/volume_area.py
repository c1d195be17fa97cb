"""Volume and area of triangle meshes by component: values, gradients, and Newton's method on both.

The volume's derivative with respect to vertex i is a third of the vector area
of the triangles at i. In that form, unlike with cross products of positions,
it depends on edges alone: nothing cancels far from the origin.

To be measured, faces of one component lie side by side, those of component k from ``start[k]``
on; gradients are those of a range of vertices, from the faces that touch it. Arrays of constraints have a
row for each quantity held; `kind` says which.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from sshade.threads import ThreadTeam

VOLUME, AREA = 0, 1
#: Error of an equation at which Newton's method stops.
CLOSE = 1e-9
#: Error that a last step is expected to leave, so that it need not be measured.
CERTAIN = 1e-10
#: An error below this that a step does not halve is rounding.
ROUNDING = 1e-9
#: Condition number beyond which two gradients count as parallel.
PARALLEL = 1e10
#: Where a step shrinks an equation by less than this factor, slopes are computed anew.
SLOW = 0.1
#: Evaluations of the equations at most; 3 are usual.
MOST_EVALUATIONS = 12
#: Faces that a thread measures at a time.
FACES = 65_536


class Surface(NamedTuple):
    """The faces of a mesh, by components and by vertices.

    Attributes
    ----------
    F : (m, 3) int32 or uint32
        Faces, component by component.
    start : (c + 1,) int64
        Where each component's faces begin.
    component : (n,) int32
        Of each vertex.
    by_vertex : (m, 3) int32 or uint32
        Faces in the order of their lowest vertices; F where there is one component.
    ranges : list of (slice, int, int)
        Vertices for threads, and the faces by vertices that touch them:
        :func:`sshade.solver.assembly.vertex_ranges`.
    """

    F: np.ndarray
    start: np.ndarray
    component: np.ndarray
    by_vertex: np.ndarray
    ranges: list[tuple[slice, int, int]]


class Equations(NamedTuple):
    """The equations ``scale C_q(P) - 1 + compliance lambda_q = 0``, for each quantity q and component.

    Attributes
    ----------
    surface : Surface
    kind : (q,) int64
        VOLUME or AREA.
    scale : (q, c) float64
        One over the rest value; 0 where a component has none.
    compliance : (q, c) float64
        0 of what is to hold exactly.
    active : (q, c) bool
        Equations to be solved; the multipliers of others stay, and their directions are not used.
    """

    surface: Surface
    kind: np.ndarray
    scale: np.ndarray
    compliance: np.ndarray
    active: np.ndarray


@njit(cache=True, nogil=True)
def measure(F, start, P):
    """Volume and area of each component.

    Parameters
    ----------
    F : (m, 3) int32 or uint32
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
def volume_and_area(first, end, F, P, origin):
    """(2,) what a range of faces adds to the volume, by its cones from an origin, and to the area."""
    x, y, z = origin[0], origin[1], origin[2]
    volume = area = 0.0
    for t in range(first, end):
        i, j, k = F[t, 0], F[t, 1], F[t, 2]
        ax, ay, az = P[j, 0] - P[i, 0], P[j, 1] - P[i, 1], P[j, 2] - P[i, 2]
        bx, by, bz = P[k, 0] - P[i, 0], P[k, 1] - P[i, 1], P[k, 2] - P[i, 2]
        nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        volume += (P[i, 0] - x) * nx + (P[i, 1] - y) * ny + (P[i, 2] - z) * nz
        area += np.sqrt(nx * nx + ny * ny + nz * nz)
    return np.array([volume / 6.0, 0.5 * area])


def gradients(
    surface: Surface, kind: np.ndarray, scale: np.ndarray, P: np.ndarray, G: np.ndarray, *, team: ThreadTeam
) -> None:
    """Derivatives of each quantity with respect to the vertices.

    Parameters
    ----------
    surface : Surface
    kind : (q,) int64
        VOLUME or AREA.
    scale : (q, c) float64
        Factor on a quantity's gradient in a component; 0 leaves it out.
    P : (n, 3) float64
    G : (q, n, 3) float64 or float32
        Overwritten.
    team : ThreadTeam
    """

    def write(number: int) -> None:
        own, first, end = surface.ranges[number]
        G[:, first:end] = 0.0
        _add_gradients(surface.by_vertex[own], surface.component, kind, scale, P, G, 1, first, end)

    team(write, len(surface.ranges))


def add_gradients(
    surface: Surface, number: int, kind: np.ndarray, scale: np.ndarray, P: np.ndarray, B: np.ndarray
) -> None:
    """Add the :func:`gradients` of a range of vertices, summed over the quantities, to B (n, 3)."""
    own, first, end = surface.ranges[number]
    _add_gradients(surface.by_vertex[own], surface.component, kind, scale, P, B[None], 0, first, end)


def along(G: np.ndarray, component: np.ndarray, Z: np.ndarray, *, count: int, team: ThreadTeam) -> np.ndarray:
    """Derivatives of each quantity along each direction, by component: ``sum_i G_i . Z_i``.

    Parameters
    ----------
    G, Z : (q, n, 3) float64 or float32
        Gradients, from :func:`gradients`, and directions.
    component : (n,) int32
        Of each vertex.
    count : int
        c, the number of components.
    team : ThreadTeam

    Returns
    -------
    (c, q, q) float64
    """
    parts = team.ranges(lambda *own: _along(*own, G, component, Z, count), len(component))
    return sum(parts[1:], start=parts[0])


def measured(surface: Surface, P: np.ndarray, *, team: ThreadTeam) -> np.ndarray:
    """:func:`measure`, by a thread team where there is one component; bits do not depend on their number."""
    F, start, *_ = surface
    if len(start) > 2:
        return measure(F, start, P)
    origin = P[F[0, 0]]
    parts = team.ranges(lambda *own: volume_and_area(*own, F, P, origin), len(F), rows=FACES)
    return sum(parts[1:], start=parts[0])[:, None]


def newton(
    equations: Equations,
    Z: np.ndarray,
    slope: np.ndarray,
    multiplier: np.ndarray,
    P: np.ndarray,
    *,
    team: ThreadTeam,
) -> np.ndarray:
    """Move P along Z to where the equations hold; each multiplier grows by the move along its direction.

    Steps use the slopes given while they shrink the worst equation of a component
    tenfold, then those at P. A step that makes it worse is halved, and taken back
    if that does not help. What a step leaves is not measured where it is certain: where with as much of
    a gain as the step before it comes to :data:`CERTAIN` at most, and it gains more.

    Parameters
    ----------
    equations : Equations
    Z : (q, n, 3) float64
        Directions.
    slope : (c, q, q) float64
        Derivatives of ``scale C`` along Z somewhere near P. Overwritten with better ones.
    multiplier : (c, q) float64
        lambda, of which P has the forces in it already. Overwritten.
    P : (n, 3) float64
        Overwritten.
    team : ThreadTeam

    Returns
    -------
    (c,) float64
        The largest absolute value of a component's active equations in the end, or a bound to it.
    """
    surface, kind, scale, compliance, active = equations
    component, count, G = surface.component, scale.shape[1], np.empty((0, 0, 3))
    residual, step, last = np.zeros((3, count, len(kind)))
    error, done = np.full(count, np.inf), np.zeros(count, dtype=np.bool_)
    for left in range(MOST_EVALUATIONS - 1, -1, -1):
        value = measured(surface, P, team=team)
        now = _evaluate(value, kind, scale, compliance, active, multiplier, residual)
        slow = bool(((SLOW * error < now) & (now <= error)).any())
        if slow:
            G = G if len(G) else np.empty(Z.shape, dtype=Z.dtype)
            gradients(surface, kind, scale, P, G, team=team)
            slope[:] = along(G, component, Z, count=count, team=team)
        state = slope, multiplier, step, last, error, done
        if not _take_step(slow, left == 0, now, active, compliance, residual, *state):
            break
        team.ranges(lambda *own: shift(*own, P, component, Z, step), len(P))
        if done.all():
            break
    return error


@njit(cache=True, nogil=True)
def _evaluate(value, kind, scale, compliance, active, multiplier, residual):
    """Write what the active equations are off to `residual` (c, q); return the largest of each component.

    `value` (2, c) are volumes and areas.
    """
    largest = np.empty(len(residual))
    for c in range(len(residual)):
        for q in range(len(kind)):
            if active[q, c]:
                residual[c, q] = scale[q, c] * value[kind[q], c] - 1.0
                residual[c, q] += compliance[q, c] * multiplier[c, q]
        largest[c] = np.abs(residual[c]).max()
    return largest


@njit(cache=True, nogil=True)
def _take_step(slow, out, now, active, compliance, residual, slope, multiplier, step, last, error, done):
    """Write the next step of each component to `step` (c, q), and add it to multipliers; False if all are 0.

    `now` (c,) are the errors here, `error` those of the best place so far; `slow`: slopes are those
    here; `out`: it is the last evaluation.
    """
    for c in range(len(now)):
        step[c] = 0.0
        if done[c]:
            continue
        certain = False
        stalled = error[c] < ROUNDING and now[c] > 0.5 * error[c]
        final = stalled or out
        if now[c] > error[c]:
            share = 1.0 if final else 0.5
            step[c] = -share * last[c]
            last[c] *= 1.0 - share
        else:
            if not slow:
                _broyden(slope[c], residual[c], last[c])
            left = now[c] * now[c] / error[c] if error[c] < np.inf else np.inf
            error[c] = now[c]
            if now[c] > CLOSE and not final:
                newton_step(slope[c], active[:, c], compliance[:, c], residual[c], step[c])
                last[c] = step[c]
                if left <= CERTAIN:
                    error[c], certain = left, True
        done[c] = stalled or certain or now[c] <= CLOSE
        multiplier[c] += step[c]
    return np.any(step != 0.0)


@njit(cache=True, nogil=True)
def _cross(P, i, j, k):
    """Twice the vector area of a triangle."""
    ax, ay, az = P[j, 0] - P[i, 0], P[j, 1] - P[i, 1], P[j, 2] - P[i, 2]
    bx, by, bz = P[k, 0] - P[i, 0], P[k, 1] - P[i, 1], P[k, 2] - P[i, 2]
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@njit(cache=True, nogil=True)
def _along(first, end, G, component, Z, count):
    slope = np.zeros((count, len(G), len(G)))
    for q in range(len(G)):
        for p in range(len(G)):
            for i in range(first, end):
                dot = G[q, i, 0] * Z[p, i, 0] + G[q, i, 1] * Z[p, i, 1] + G[q, i, 2] * Z[p, i, 2]
                slope[component[i], q, p] += dot
    return slope


@njit(cache=True, nogil=True, error_model="numpy")
def _add_gradients(F, component, kind, scale, P, G, apart, first, end):
    """Add the gradient of quantity q to rows `first` to `end` of ``G[apart x q]``: 0 sums them up.

    F (m, 3) are at least the faces that touch these vertices, in the order of all.
    """
    factor, to_volume, to_area = np.zeros((2, scale.shape[1])), 0, 0
    for q in range(len(kind)):
        if kind[q] == VOLUME:
            factor[VOLUME], to_volume = scale[q] / 6.0, apart * q
        else:
            factor[AREA], to_area = scale[q] / 2.0, apart * q
    for t in range(len(F)):
        i, j, k = F[t, 0], F[t, 1], F[t, 2]
        volume, area = factor[VOLUME, component[i]], factor[AREA, component[i]]
        ax, ay, az = P[j, 0] - P[i, 0], P[j, 1] - P[i, 1], P[j, 2] - P[i, 2]
        bx, by, bz = P[k, 0] - P[i, 0], P[k, 1] - P[i, 1], P[k, 2] - P[i, 2]
        x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        if volume != 0.0:
            vx, vy, vz = volume * x, volume * y, volume * z
            for corner in (i, j, k):
                if first <= corner < end:
                    G[to_volume, corner, 0] += vx
                    G[to_volume, corner, 1] += vy
                    G[to_volume, corner, 2] += vz
        length = np.sqrt(x * x + y * y + z * z)
        if area != 0.0 and length > 0.0:  # without a normal, no direction is better than another
            size = area / length
            x, y, z = size * x, size * y, size * z
            # Each corner: the unit normal times the edge opposite. The three add up to nothing.
            jx, jy, jz = z * by - y * bz, x * bz - z * bx, y * bx - x * by
            kx, ky, kz = y * az - z * ay, z * ax - x * az, x * ay - y * ax
            if first <= i < end:
                G[to_area, i, 0] -= jx + kx
                G[to_area, i, 1] -= jy + ky
                G[to_area, i, 2] -= jz + kz
            if first <= j < end:
                G[to_area, j, 0] += jx
                G[to_area, j, 1] += jy
                G[to_area, j, 2] += jz
            if first <= k < end:
                G[to_area, k, 0] += kx
                G[to_area, k, 1] += ky
                G[to_area, k, 2] += kz


@njit(cache=True, nogil=True)
def _broyden(J, left, step):
    """Broyden's update of the slopes J (q, q), where a step has left so much of the equations."""
    square = 0.0
    for p in range(len(step)):
        square += step[p] * step[p]
    if square > 0.0:
        for q in range(len(left)):
            for p in range(len(step)):
                J[q, p] += left[q] * step[p] / square


@njit(cache=True, nogil=True)
def newton_step(J, active, compliance, r, x):
    """Newton step ``(J + diag(compliance)) x = -r`` for one or two unknowns; 0 of those not active.

    The least-squares one where two gradients are parallel.
    """
    x[:] = 0.0
    if not active.all() or len(r) == 1:
        for q in range(len(r)):
            slope = J[q, q] + compliance[q]
            if active[q] and slope != 0.0:
                x[q] = -r[q] / slope
        return
    a, b, c, d = J[0, 0] + compliance[0], J[0, 1], J[1, 0], J[1, 1] + compliance[1]
    determinant, square = a * d - b * c, a * a + b * b + c * c + d * d
    if PARALLEL * abs(determinant) > square:  # the condition is about square / determinant
        x[0], x[1] = (b * r[1] - d * r[0]) / determinant, (c * r[0] - a * r[1]) / determinant
    elif square > 0.0:
        x[0], x[1] = -(a * r[0] + c * r[1]) / square, -(b * r[0] + d * r[1]) / square


@njit(cache=True, nogil=True)
def shift(first, end, P, component, Z, move):
    """Add to a range of P (n, 3) Z (q, n, 3) times what its component moves along each, `move` (c, q)."""
    for q in range(len(Z)):
        for i in range(first, end):
            m = move[component[i], q]
            for d in range(3):
                P[i, d] += m * Z[q, i, d]
