"""Constraints on the volume and the area of a shape, exact or weighted, during local/global iterations.

The global step of the unconstrained problem solves ``L u = b``. Let C_q be the volume and the area of the
shape, divided by their goals, which are the values at rest or a given multiple. With constraints the step
solves ``L u = b + sum_q lambda_q grad C_q(u)`` for the multipliers lambda_q of the step before. Newton's
method then changes the multipliers and moves the shape along the directions ``z_q = L^-1 grad C_q`` until
``C_q - 1 + s_q lambda_q = 0``. An exact constraint has s = 0. A weighted constraint is the penalty
``weight / 2 x rest energy x (C_q - 1)^2``, for which ``s = 1 / (weight x rest area)``. The multipliers are
constant at convergence, so the directions may belong to an earlier shape. They are renewed every few steps
only, because each direction takes a linear solve.

An exact constraint yields before it fights the handles. Its pressure is its multiplier over the rest area, a
number without unit. Where a step would need more than the largest pressure of an aim, the constraint pushes
with this pressure instead and its equation is dropped: the penalty ``2 corners pressure x rest area x |C_q -
1|``, which is exact as long as less pressure is enough.

Iterates before the last one may miss the exact constraints by :data:`NEAR`. The safeguard of the iteration
compares Lagrangians instead of energies, because they do not depend on such errors to first order.

The volume's derivative with respect to vertex i is a third of the vector area of the triangles at i. This
form depends on edges alone, unlike the one with cross products of positions, and loses no digits far from
the origin. The derivative of the area jumps where a triangle collapses. It is therefore made continuous for
triangles that have become very slender.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from sshade.core.errors import InputError
from sshade.core.kernels import kernel
from sshade.core.threads import ROWS, ThreadTeam, in_ranges
from sshade.mesh.mesh import Mesh
from sshade.solver.laplacian import faces_in_order, vertex_ranges

log = logging.getLogger(__name__)

#: Numbers of the quantities.
VOLUME, AREA = 0, 1
#: Steps that share the directions. Two exact constraints need fewer, because an error of one direction cannot
#: be balanced along the other.
EVERY, EVERY_OF_BOTH = 8, 4
#: Largest relative error of an exact constraint that counts as fulfilled.
REACHED = 1e-6
#: Weight of an area that cannot be met exactly, and number of failed steps after which it keeps this weight.
RELAXED, GIVE_UP = 1.0, 30
#: Number of first steps in which constraints are exact, but in a drag. Poses of bodies need more pressure in
#: the first four.
EARLY = 10
#: Least volume of a body, as a multiple of area^1.5. A flat body has less, and no volume constraint.
FLAT = 1e-9
#: Error of an equation at which Newton's method stops at the end of a solve, and largest one for iterates
#: before. The second one is also at most the tolerance of the solve.
CLOSE, NEAR = 1e-9, 1e-5
#: The same for the multipliers of a global step, as a fraction of the error for iterates.
OF_STEP = 0.1
#: Predicted error below which a step is not measured again, where the values are needed.
CERTAIN = 1e-10
#: Most of an error that a first step leaves; a hundredth of it is usual.
LEFT = 0.01
#: Error that counts as rounding if a step does not halve it.
ROUNDING = 1e-9
#: Condition number beyond which two gradients count as parallel.
PARALLEL = 1e10
#: Ratio of successive errors above which Newton's method computes new slopes.
SLOW = 0.1
#: Largest number of evaluations of the equations; 3 are usual.
MOST_EVALUATIONS = 12
#: Actions of a planned step, see :func:`_plan`.
STAY, MOVE, MOVE_LAST, RENEW = range(4)
#: Slenderness of a triangle, which is its double area over the sum of two squared edges, below which its part
#: of the area's gradient falls to 0; and the same as a fraction of the slenderness at rest. The smaller one
#: counts. The exact gradient jumps where a triangle collapses, so that iterations between scattered handles
#: never converged. Values from 0.02 to 0.08 give the same shapes; 0.01 is too small.
SLENDER, SLENDER_AT_REST = 0.04, 0.1
#: The argument `slender` of :func:`add_gradients` for the gradient of a volume alone.
VOLUME_ALONE = np.empty(0, dtype=np.float32)
#: Number of faces that a thread measures at a time.
FACES = 65_536


#: ``solve(B, X)`` writes L^-1 B_q to X_q, for B and X (q, n, 3).
Solves = Callable[[np.ndarray, np.ndarray], None]


class ConstraintReport(NamedTuple):
    """How well a deformed shape keeps its volume and area.

    Attributes
    ----------
    volume_error, area_error : float or None
        Relative; NaN if the rest shape has no volume or no area, None if unknown.
    volume_constraint, area_constraint : str or None
        "free", "weighted", "exact", "yielding" where it pushes with the largest pressure, or "infeasible" if
        the error of an exact constraint is above :data:`REACHED`. The volume may be "off: " and the reason.
    volume_pressure, area_pressure : float or None
        Multipliers of the constraints over the rest area.
    """

    volume_error: float | None = None
    area_error: float | None = None
    volume_constraint: str | None = None
    area_constraint: str | None = None
    volume_pressure: float | None = None
    area_pressure: float | None = None


class ConstrainedSurface:
    """The faces of a mesh in the solver's order, with their volume and area at rest.

    Parameters
    ----------
    mesh : Mesh
        Rest shape. Constraints need a connected mesh, and the volume constraint a closed and consistently
        oriented one that is not flat.
    place : (n,) int32
        Place of each vertex in the solver's order.
    faces : (m, 3) uint32, optional
        The faces in the order of :func:`sshade.solver.laplacian.faces_in_order`, if the solver has them.

    Attributes
    ----------
    F : (m, 3) uint32
    ranges : list of (slice, int, int)
        See :func:`sshade.solver.laplacian.vertex_ranges`.
    slender : (m,) float32
        Least slenderness of each face that does not count as collapsed; see :data:`SLENDER`.
    rest : (2,) float64
        Volume and area at rest.
    without_volume : str
        Why there is no volume to constrain; empty if there is one.
    """

    def __init__(self, mesh: Mesh, place: np.ndarray, faces: np.ndarray | None = None) -> None:
        self.F = faces_in_order(mesh.F, place)[0] if faces is None else faces
        self.ranges, self.connected = vertex_ranges(self.F, mesh.n), mesh.connectivity.components == 1
        rest = np.empty((mesh.n, 3))
        rest[place] = mesh.V
        self.slender = np.empty(len(self.F), dtype=np.float32)
        in_ranges(_slender, len(self.F), self.F, rest, self.slender)
        self.rest = self.measure(rest, ThreadTeam(1))
        self.without_volume = _reason_for_no_volume(mesh, self.rest)

    def measure(self, P: np.ndarray, team: ThreadTeam) -> np.ndarray:
        """Return (2,) volume and area at positions P (n, 3); the same bits with any number of threads."""
        origin = P[self.F[0, 0]]
        return sum(_over(team, volume_and_area, len(self.F), self.F, P, origin, rows=FACES))


class Constraints:
    """Multipliers and directions of one solve. P and B are (n, 3) float64 in the solver's order.

    Volume and area may contradict each other. If Newton's method fails, the area has the weight
    :data:`RELAXED` in this step, and after :data:`GIVE_UP` failures in a row in all later ones.

    Parameters
    ----------
    surface : ConstrainedSurface
    volume, area : float
        Weights. 0 leaves the quantity unconstrained, inf fixes it exactly. With a weight in between, a
        relative error e costs ``weight / 2 x e^2`` times the rest energy, which is the energy of the rest
        shape shrunk to a point. Neither the unit of length nor the resolution matters.
    corners : int
        Number of times that the energy counts each edge.
    team : ThreadTeam
    single : bool
        Store gradients and directions in single precision. Exact constraints stay exact.

    Attributes
    ----------
    yields : (q,) bool
        Exact constraints that push with their largest pressure in the present step.
    early : bool
        Whether constraints would yield if the step were not among the first ones.
    early_steps : int
        Number of first steps in which constraints are exact in any case.

    Raises
    ------
    InputError
        When a mesh of several components has a constraint.
    """

    def __init__(
        self,
        surface: ConstrainedSurface,
        volume: float,
        area: float,
        *,
        corners: int,
        team: ThreadTeam,
        single: bool = False,
    ) -> None:
        if volume > 0 and surface.without_volume:
            log.info("the volume constraint is off: %s", surface.without_volume)
        self._kinds = [VOLUME] * (volume > 0 and not surface.without_volume)
        self._kinds += [AREA] * bool(area > 0 and surface.rest[AREA] > 0)
        if self._kinds and not surface.connected:
            raise InputError("constraints on volume and area need a connected mesh: solve for each component")
        self._surface, self._team, self._corners = surface, team, corners
        self._given = volume, area
        weights, self._area = np.array([volume, area]), surface.rest[AREA] or 1.0
        #: Weights asked for. `_lasting` has the weights from now on, and `_weight` the weights of this step.
        self._asked, self._every = weights[self._kinds], EVERY_OF_BOTH if np.isinf(weights).all() else EVERY
        count, n = len(self._kinds), surface.ranges[-1][2]
        self._G, self._Z = np.zeros((2, count, n, 3), dtype=np.float32 if single else np.float64)
        #: Derivatives of each quantity along each direction, the multipliers, and their last change.
        self._slope, self._multiplier, self._grown = np.empty((count, count)), *np.zeros((2, count))
        self._violation, self._steps, self._error, self._near = 0.0, 0, np.zeros(count), 0.0
        #: Values at the end of the last :meth:`_newton`; None if the last move was not measured.
        self._reached: np.ndarray | None = None
        self.yields = np.zeros(count, dtype=bool)
        self.early = False
        self.early_steps = EARLY
        #: Number of steps taken.
        self._taken = 0
        self.aim(1.0)

    def __len__(self) -> int:
        """Number of constrained quantities."""
        return len(self._kinds)

    def aim(self, volume_goal: float, pressure: tuple[float, float] = (math.inf, math.inf)) -> None:
        """Set the goal of the volume, as a multiple of its value at rest; an exact area is tried again.

        `pressure` has the largest pressures of an exact volume and an exact area.
        """
        goals, most = np.array([volume_goal, 1.0]), np.array(pressure)
        self._most = most[self._kinds] * self._area
        self._scale = 1.0 / self._surface.rest[self._kinds] / goals[self._kinds]
        self._lasting = self._weight = self._asked
        self._failures = 0

    def begin(self, tolerance: float) -> None:
        """Begin a solve with a tolerance, as of :func:`sshade.solver.local_global.solve`."""
        self._near = min(NEAR, tolerance)

    def penalty(self, P: np.ndarray, *, restored: bool = False) -> float:
        """Return the energy of the weighted constraints, and note the errors of the exact ones.

        If `restored`, P is the result of the last :meth:`restore`, which may have measured it.
        """
        if not self._kinds:
            return 0.0
        known = self._reached if restored else None
        value = self._surface.measure(P, self._team)[self._kinds] if known is None else known
        self._error, exact = self._scale * value - 1.0, np.isinf(self._weight)
        # The rest energy is 2 corners x area; with the penalty's 1/2 a factor of 1 remains.
        weighted = self._area * np.where(exact, 0.0, self._weight) * self._error**2
        weighted[self.yields] = 2.0 * np.abs(self._multiplier * self._error)[self.yields]
        self._error[~exact | self.yields] = 0.0
        return float((self._corners * weighted).sum())

    def report(self, P: np.ndarray, goal: float) -> ConstraintReport:
        """Describe volume and area at positions P (n, 3) after a solve with a goal of the volume."""
        surface, now = self._surface, self._surface.measure(P, ThreadTeam(1))
        pressure, yields = np.zeros(2), np.zeros(2, dtype=bool)
        pressure[self._kinds] = self._multiplier / self._area
        yields[self._kinds] = self.yields
        volume, area = self._given
        volume_error = area_error = math.nan
        if not surface.without_volume:
            volume_error = float(abs(now[VOLUME] / surface.rest[VOLUME] - goal))
        if surface.rest[AREA] > 0:
            area_error = float(abs(now[AREA] / surface.rest[AREA] - 1.0))
        off = f"off: {surface.without_volume}" if volume > 0 and surface.without_volume else ""
        return ConstraintReport(
            volume_error,
            area_error,
            off or _state(volume, volume_error, yields[VOLUME]),
            _state(area, area_error, yields[AREA]),
            float(pressure[VOLUME]),
            float(pressure[AREA]),
        )

    @property
    def correction(self) -> float:
        """Lagrangian with the present multipliers, minus the energy, where :meth:`penalty` measured last."""
        return -2.0 * self._corners * float(self._multiplier @ self._error)

    def add_forces(self, P: np.ndarray, B: np.ndarray) -> None:
        """Add ``sum_q lambda_q grad C_q(P)`` to B."""
        self._add_gradients(P, self._scale * self._multiplier, B[None])

    def write_gradients(self, P: np.ndarray, G: np.ndarray) -> None:
        """Write ``grad C_q(P)`` to G (q, n, 3)."""
        G[:] = 0.0
        self._add_gradients(P, self._scale, G)

    def _add_gradients(self, P: np.ndarray, scale: np.ndarray, G: np.ndarray) -> None:
        """Add ``scale_q grad C_q(P)`` to each G_q (q, n, 3), or all to G_0 (1, n, 3)."""
        surface, factor = self._surface, np.zeros(2)
        factor[self._kinds] = scale

        def add(number: int) -> None:
            own, first, end = surface.ranges[number]
            faces = surface.F[own], surface.slender[own]
            add_gradients(*faces, P, factor[VOLUME], factor[AREA], G[0], G[-1], first, end)

        self._team(add, len(surface.ranges))

    def renew_directions(self, P: np.ndarray, solve: Solves) -> None:
        """Move along ``L^-1 grad C_q(P)`` from now on."""
        self.write_gradients(P, self._G)
        solve(self._G, self._Z)
        self._slope[:] = self._along(self._G)

    def _along(self, G: np.ndarray) -> np.ndarray:
        """(q, q) derivatives ``sum_i G_i . Z_i`` of each quantity along each direction."""
        return sum(_over(self._team, _along, G.shape[1], G, self._Z))

    def add_moves(self, B: np.ndarray) -> None:
        """Add the gradients, times the changes of the multipliers in the last :meth:`project`, to B."""
        _over(self._team, _shift, len(B), B, self._G, self._grown)

    def project(self, P: np.ndarray, before: np.ndarray, solve: Solves) -> None:
        """Move P along the directions until the equations hold, and update the multipliers.

        Every few steps the directions are renewed at the positions `before` the step.
        """
        if self._steps % self._every == 0:
            self.renew_directions(before, solve)
        self._steps += 1
        self._weight, multiplier = self._lasting, self._multiplier
        may_fail = self._kinds[-1] == AREA and math.isinf(self._weight[-1])
        saved = P.copy() if np.isinf(self._weight).any() else P, multiplier.copy()
        rough: dict[str, Any] = {"left": LEFT}
        rough |= {"close": max(CLOSE, OF_STEP * self._near), "certain": max(CERTAIN, OF_STEP * self._near)}
        self._violation = self._newton(P, multiplier, **rough)
        exact = np.isinf(self._weight)
        self._taken += 1
        above = exact & (np.abs(multiplier) > self._most)
        self.yields = above & (self._taken > self.early_steps)
        self.early = bool(above.any() and not self.yields.any())
        if self.yields.any():
            self._yield(P, multiplier, *saved, rough)
        failed = may_fail and self._violation > REACHED and not self.yields[-1]
        self._failures = self._failures + 1 if failed else 0
        if failed:
            P[:], multiplier[:] = saved
            self._weight = np.append(self._weight[:-1], RELAXED)
            self.yields = np.zeros_like(self.yields)
            self._violation = self._newton(P, multiplier, **rough)
        if self._failures >= GIVE_UP:
            self._lasting = self._weight
        self._grown = multiplier - saved[1]
        if self._violation > REACHED:  # the multipliers would add up from step to step: start again from 0
            multiplier[:], self._steps = 0.0, 0

    def _yield(
        self, P: np.ndarray, multiplier: np.ndarray, P0: np.ndarray, before: np.ndarray, rough: dict[str, Any]
    ) -> None:
        """Take the step from P0 and the multipliers before again, with the largest pressure of what yields.

        With one constraint at its limit, the other may reach its own.
        """
        limit = np.sign(multiplier) * self._most
        for _ in range(len(multiplier)):
            P[:] = P0
            multiplier[:] = np.where(self.yields, limit, before)
            _over(self._team, _shift, len(P), P, self._Z, multiplier - before)
            self._violation = 0.0
            if self.yields.all():
                break
            self._violation = self._newton(P, multiplier, active=~self.yields, **rough)
            more = ~self.yields & np.isinf(self._weight) & (np.abs(multiplier) > self._most)
            if not more.any():
                break
            limit[more] = (np.sign(multiplier) * self._most)[more]
            self.yields |= more

    def restore(self, P: np.ndarray, *, exactly: bool = False) -> bool:
        """Move P until the exact constraints hold; False if their error is larger than after `project`.

        Without `exactly`, errors up to :data:`NEAR` and the tolerance count as none.
        """
        exact, self._reached = np.isinf(self._weight) & ~self.yields, None
        close = CLOSE if exactly else max(CLOSE, self._near)
        if not exact.any():
            return True
        violation = self._newton(P, np.zeros_like(self._multiplier), active=exact, close=close)
        return violation <= max(self._violation, close)

    def _newton(
        self,
        P: np.ndarray,
        multiplier: np.ndarray,
        *,
        active: np.ndarray | None = None,
        close: float,
        certain: float = CERTAIN,
        left: float = math.inf,
    ) -> float:
        """Move P along the directions until the active equations hold; return their largest error.

        Each multiplier grows by the move along its direction. Steps use the stored slopes as long as
        they shrink the worst equation tenfold; later steps use the slopes at P. A step that increases the
        error is halved, and undone if halving does not help.

        Parameters
        ----------
        P : (n, 3) float64
        multiplier : (q,) float64
        active : (q,) bool, optional
        close : float
            Error at which it stops.
        certain : float
            Predicted error up to which the last step is not measured. The prediction is returned. It comes
            from the gain of the step before.
        left : float
            Fraction of its error that a first step leaves at most.
        """
        active = np.ones(len(self._kinds), dtype=bool) if active is None else active
        compliance, best = 1.0 / (self._weight * self._area), math.inf
        goals = close, certain, left
        step, full_step, G = *np.zeros((2, len(active))), np.empty(0)
        for remaining in range(MOST_EVALUATIONS - 1, -1, -1):
            value = self._surface.measure(P, self._team)[self._kinds]
            residual = np.where(active, self._scale * value - 1.0 + compliance * multiplier, 0.0)
            equations = residual, active, compliance, self._slope, full_step, step
            action, error = _plan(*equations, best, *goals, remaining == 0, False)
            if action == RENEW:
                G = G if len(G) else np.empty_like(self._Z)
                self.write_gradients(P, G)
                self._slope[:] = self._along(G)
                action, error = _plan(*equations, best, *goals, remaining == 0, True)
            best, self._reached = error, value if action == STAY else None
            if action == STAY:
                break
            multiplier += step
            _over(self._team, _shift, len(P), P, self._Z, step)
            if action == MOVE_LAST:
                break
        return best


def enclosed_volume(V: np.ndarray, F: np.ndarray) -> float:
    """Return the volume inside the faces F (m, 3) uint32 of a closed surface at positions V (n, 3)."""
    origin = V[F[0, 0]]
    return float(sum(in_ranges(volume_and_area, len(F), F, V, origin))[0])


def _state(weight: float, error: float, yields: np.bool_) -> str:
    """Return the state of a constraint of which a relative error is left."""
    if weight == 0:
        return "free"
    if weight < math.inf:
        return "weighted"
    if yields:
        return "yielding"
    return "exact" if error <= REACHED else "infeasible"


def _reason_for_no_volume(mesh: Mesh, rest: np.ndarray) -> str:
    """Why a mesh has no volume to constrain; empty if it has one."""
    if not mesh.is_closed:
        return "boundary"
    if not mesh.is_oriented:
        return "orientation"
    return "flat" if abs(rest[VOLUME]) <= FLAT * rest[AREA] ** 1.5 else ""


def _over(team: ThreadTeam, work: Callable[..., Any], n: int, *arguments: Any, rows: int = ROWS) -> list[Any]:
    """Return the results of `work` for ranges of n rows; a single range needs no team."""
    return [work(0, n, *arguments)] if n <= rows else team.ranges(work, n, *arguments, rows=rows)


@kernel(fastmath={"contract"})
def volume_and_area(first, end, F, P, origin):
    """(2,) volume of the cones from an origin over a range of faces, and area of the faces."""
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


@kernel
def _slender(first, end, F, P, slender):
    """Write the least slenderness of the faces in a range for rest positions P (n, 3)."""
    for t in range(first, end):
        i, j, k = F[t, 0], F[t, 1], F[t, 2]
        ax, ay, az = P[j, 0] - P[i, 0], P[j, 1] - P[i, 1], P[j, 2] - P[i, 2]
        bx, by, bz = P[k, 0] - P[i, 0], P[k, 1] - P[i, 1], P[k, 2] - P[i, 2]
        x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        edges = ax * ax + ay * ay + az * az + bx * bx + by * by + bz * bz
        at_rest = np.sqrt(x * x + y * y + z * z) / edges if edges > 0.0 else 0.0
        slender[t] = min(SLENDER, SLENDER_AT_REST * at_rest)


@kernel(error_model="numpy", fastmath={"contract"})
def add_gradients(F, slender, P, volume, area, to_volume, to_area, first, end):
    """Add the gradients of volume and area, times the factors `volume` and `area`, to rows `first` to `end`.

    Arrays `to_volume` and `to_area` (n, 3) may be the same. F (m, 3) has at least the faces at these
    vertices, in the order of all faces. The gradient of the area is continuous where faces become more
    slender than `slender` (m,), which may be empty without an area.
    """
    volume, area = volume / 6.0, area / 2.0
    for t in range(len(F)):
        i, j, k = F[t, 0], F[t, 1], F[t, 2]
        ax, ay, az = P[j, 0] - P[i, 0], P[j, 1] - P[i, 1], P[j, 2] - P[i, 2]
        bx, by, bz = P[k, 0] - P[i, 0], P[k, 1] - P[i, 1], P[k, 2] - P[i, 2]
        x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        if volume != 0.0:
            vx, vy, vz = volume * x, volume * y, volume * z
            for corner in (i, j, k):
                if first <= corner < end:
                    to_volume[corner, 0] += vx
                    to_volume[corner, 1] += vy
                    to_volume[corner, 2] += vz
        if area == 0.0:
            continue
        edges = ax * ax + ay * ay + az * az + bx * bx + by * by + bz * bz
        length = max(np.sqrt(x * x + y * y + z * z), slender[t] * edges)
        if length > 0.0:
            size = area / length
            x, y, z = size * x, size * y, size * z
            # Each corner: the unit normal times the edge opposite. The three add up to nothing.
            jx, jy, jz = z * by - y * bz, x * bz - z * bx, y * bx - x * by
            kx, ky, kz = y * az - z * ay, z * ax - x * az, x * ay - y * ax
            corners = (i, -jx - kx, -jy - ky, -jz - kz), (j, jx, jy, jz), (k, kx, ky, kz)
            for corner, x, y, z in corners:
                if first <= corner < end:
                    to_area[corner, 0] += x
                    to_area[corner, 1] += y
                    to_area[corner, 2] += z


@kernel
def _plan(residual, active, compliance, slope, full_step, step, best, close, certain, left, final, fresh):
    """Plan the next Newton step for residuals (q,) of the equations.

    Parameters
    ----------
    residual, active, compliance : (q,)
    slope : (q, q)
        Derivatives along the directions; improved by Broyden's update.
    full_step, step : (q,)
        The last step from the best positions, and the step planned now; both are written.
    best : float
        Least error so far.
    close, certain, left : float
        See :meth:`Constraints._newton`.
    final : bool
        No evaluation follows.
    fresh : bool
        The slopes belong to the present positions.

    Returns
    -------
    int
        STAY; MOVE by `step`; MOVE_LAST, without another evaluation; or RENEW the slopes and plan again.
    float
        The least error, which a last move predicts.
    """
    error = 0.0
    for r in residual:
        error = max(error, abs(r))
    stalled = best < ROUNDING and error > 0.5 * best
    final = final or stalled
    if error > best:
        step[:] = (-1.0 if final else -0.5) * full_step
        full_step += step
        if not step.any():
            return STAY, best
        return MOVE_LAST if stalled else MOVE, best
    if not fresh:
        if error > SLOW * best:
            return RENEW, best
        square = (full_step * full_step).sum()
        if square > 0.0:
            for q in range(len(residual)):
                for p in range(len(residual)):
                    slope[q, p] += residual[q] * full_step[p] / square
    if not error > close or final:
        return STAY, error
    step[:] = 0.0
    if len(residual) == 1 or not active.all():
        for q in range(len(residual)):
            if active[q] and slope[q, q] + compliance[q] != 0.0:
                step[q] = -residual[q] / (slope[q, q] + compliance[q])
    else:
        a, b, c, d = slope[0, 0] + compliance[0], slope[0, 1], slope[1, 0], slope[1, 1] + compliance[1]
        determinant, square = a * d - b * c, a * a + b * b + c * c + d * d
        if PARALLEL * abs(determinant) > square:  # the condition is about square / determinant
            step[0] = (b * residual[1] - d * residual[0]) / determinant
            step[1] = (c * residual[0] - a * residual[1]) / determinant
        elif square > 0.0:  # the least-squares step
            step[0] = -(a * residual[0] + c * residual[1]) / square
            step[1] = -(b * residual[0] + d * residual[1]) / square
    full_step[:] = step
    if not step.any():
        return STAY, error
    predicted = error * (error / best if best < math.inf else left)
    return (MOVE_LAST, predicted) if predicted <= certain else (MOVE, error)


@kernel
def _along(first, end, G, Z):
    slope = np.zeros((len(G), len(G)))
    for q in range(len(G)):
        for p in range(len(G)):
            total = 0.0
            for i in range(first, end):
                total += G[q, i, 0] * Z[p, i, 0] + G[q, i, 1] * Z[p, i, 1] + G[q, i, 2] * Z[p, i, 2]
            slope[q, p] = total
    return slope


@kernel
def _shift(first, end, P, Z, move):
    """Add ``sum_q move_q Z_q`` to a range of P (n, 3)."""
    for q in range(len(Z)):
        m = move[q]
        for i in range(first, end):
            for d in range(3):
                P[i, d] += m * Z[q, i, d]
