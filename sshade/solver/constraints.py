"""Volume and area held during local/global iterations, exactly or with a weight.

A global step of the free problem solves ``L u = b``. With constraints C_q, the
volume and the area of a component over their rest values, it becomes ``L u = b
+ sum_q lambda_q grad C_q(u)``, with the multipliers of the step before; Newton's
method on their changes then moves along directions ``z_q = L^-1 grad C_q`` to
where ``C_q - goal_q + s_q lambda_q = 0``. An exact constraint has s = 0; a
weighted one is the penalty ``weight / 2 x rest energy x (C_q - goal_q)^2``, for
which ``s = 1 / (weight x rest area)``. At convergence the multipliers do not change:
the directions need not be those of the present shape, and are renewed, a right-hand
side for each constraint, every few steps only.
"""

from __future__ import annotations

import logging
import math
from dataclasses import asdict, dataclass
from typing import NamedTuple

import numpy as np

from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.solver.assembly import faces_in_order, vertex_ranges
from sshade.solver.volume_area import (
    AREA,
    ROUNDING,
    VOLUME,
    Equations,
    Surface,
    add_gradients,
    along,
    gradients,
    measure,
    measured,
    newton,
    shift,
)
from sshade.threads import ThreadTeam

log = logging.getLogger(__name__)
#: Steps that share the directions; fewer where both constraints are exact, as an error of one direction
#: can then not be balanced along the other.
EVERY, EVERY_OF_BOTH = 8, 4

#: Relative error up to which an exact constraint counts as reached.
REACHED = 1e-6
#: Weight of an area that cannot be held exactly, and the steps after which it is given up.
RELAXED, GIVE_UP = 1.0, 30
#: A volume below this (x area^1.5) is that of a flat body: nothing to be relative to.
FLAT = 1e-9


@dataclass(frozen=True)
class VolumeArea:
    """What a solve is asked to hold.

    Parameters
    ----------
    volume, area : float
        Weights: 0 leaves it free, inf holds it exactly. In between, an error e
        (relative, of a component) costs ``weight / 2 x e^2`` times the
        component's rest energy: the energy of its rest shape shrunk to a point.
        Neither the unit of length nor the resolution matters.

    Raises
    ------
    InputError
        On a weight that is negative or NaN.
    """

    volume: float = 0.0
    area: float = 0.0

    def __post_init__(self) -> None:
        for name, weight in asdict(self).items():
            if not weight >= 0:
                raise InputError(f"the {name} weight goes from 0 (free) to inf (exact); {weight} does not")


class Errors(NamedTuple):
    """Relative errors of a shape: the largest over components, NaN where none has a volume, or an area."""

    volume: float
    area: float


class Components:
    """The volumes and areas of a mesh's components, to be held in any number of solves.

    Parameters
    ----------
    mesh : Mesh
        Rest shape. Components that are not closed and consistently oriented, or
        are flat, have no volume to hold.
    place : (n,) int32
        Place of each vertex in the order of the solver's arrays.
    faces : (m, 3) uint32, optional
        The faces by their lowest places, if the solver has them: to be shared.
    """

    def __init__(self, mesh: Mesh, place: np.ndarray, faces: np.ndarray | None = None) -> None:
        by_vertex = faces_in_order(mesh.F, place)[0] if faces is None else faces
        component = np.empty(mesh.n, dtype=np.int32)
        component[place] = mesh.component
        faces, start = by_vertex, np.array([0, mesh.m])
        if mesh.connectivity.components > 1:
            owner = component[by_vertex[:, 0]]
            near = np.argsort(owner, kind="stable")
            faces = by_vertex[near]
            start = np.searchsorted(owner[near], np.arange(mesh.connectivity.components + 1))
        self.surface = Surface(faces, start, component, by_vertex, vertex_ranges(by_vertex, mesh.n))
        rest = np.empty((mesh.n, 3))
        rest[place] = mesh.V
        self.rest = measure(faces, start, rest)
        self._lacking = _lacking_volume(mesh, self.rest)

    @property
    def has_volume(self) -> np.ndarray:
        """(c,) bool: which components enclose a volume that can be held."""
        return self._lacking == ""

    def held(
        self,
        asked: VolumeArea,
        *,
        corners: int,
        team: ThreadTeam,
        volume_goal: float = 1.0,
        single: bool = False,
    ) -> HeldConstraints | None:
        """The constraints of a solve; None where it holds nothing.

        Parameters
        ----------
        asked : VolumeArea
        corners : int
            How often the energy counts an edge.
        team : ThreadTeam
        volume_goal : float
            What each volume is to be, over that of the rest shape; positive.
        single : bool
            Keep gradients and directions in single precision; what is held is as exact.
        """
        if asked.volume > 0 and not self.has_volume.all():
            log.warning("the volume constraint is %s", self._off())
        kinds = [VOLUME] * bool(asked.volume > 0 and self.has_volume.any()) + [AREA] * (asked.area > 0)
        if not kinds:
            return None
        return HeldConstraints(
            self,
            asked,
            np.array(kinds),
            corners=corners,
            team=team,
            volume_goal=volume_goal,
            single=single,
        )

    def errors(self, P: np.ndarray, *, volume_goal: float = 1.0) -> Errors:
        """How far volumes and areas at positions P (n, 3), in the solver's order, are from their goals."""
        now, has = measure(self.surface.F, self.surface.start, P), self.has_volume
        volume = np.abs(now[VOLUME, has] / self.rest[VOLUME, has] - volume_goal)
        has = self.rest[AREA] > 0
        area = np.abs(now[AREA, has] / self.rest[AREA, has] - 1)
        return Errors(*(float(error.max()) if len(error) else math.nan for error in (volume, area)))

    def status(self, asked: VolumeArea, errors: Errors) -> tuple[str, str]:
        """What became of the volume and of the area, in words for a row.

        Returns
        -------
        volume, area : str
            "free", "weighted", "exact", or "infeasible" where the last error of
            an exact one is above `REACHED`. The volume may be "off", and why.
        """
        words = []
        for weight, error in ((asked.volume, errors.volume), (asked.area, errors.area)):
            reached = "exact" if error <= REACHED else "infeasible"
            words.append("free" if weight == 0 else "weighted" if weight < math.inf else reached)
        if asked.volume > 0 and not self.has_volume.all():
            words[0] = f"{words[0]}; {self._off()}" if self.has_volume.any() else self._off()
        return words[0], words[1]

    def _off(self) -> str:
        lacking = self._lacking[self._lacking != ""]
        where = f" on {len(lacking)} of {len(self._lacking)} components" * (len(lacking) < len(self._lacking))
        return f"off{where}: {', '.join(sorted(set(lacking.tolist())))}"


class HeldConstraints:
    """Multipliers and directions of one solve; a :class:`sshade.solver.interfaces.Constraints`.

    The multiplier of a constraint grows by each move along its direction. With
    which weights the constraints are held at a step, :class:`InfeasibleAreas` decides.
    """

    def __init__(
        self,
        components: Components,
        asked: VolumeArea,
        kinds: np.ndarray,
        *,
        corners: int,
        team: ThreadTeam,
        volume_goal: float,
        single: bool,
    ) -> None:
        self._team = team
        rest, has = components.rest, components.has_volume
        on = np.stack([has, rest[AREA] > 0])[kinds]
        weight = np.where(on, np.array([asked.volume, asked.area])[kinds, None], math.inf)
        # A component in a line or a point has no area; it holds nothing, and any number does.
        self._area, self._corners = np.where(rest[AREA] > 0, rest[AREA], 1.0), corners
        self._equations = Equations(
            components.surface,
            kinds,
            scale=np.empty(on.shape),
            compliance=np.zeros(on.shape),
            active=on,
        )
        self._asked, self._rest_scale = weight, on / np.where(on, rest[kinds], 1.0)
        self.retry(volume_goal)
        precision = np.float32 if single else np.float64
        self._G, self._Z = np.zeros((2, len(kinds), len(components.surface.component), 3), dtype=precision)
        self._slope = np.empty((on.shape[1], len(kinds), len(kinds)))
        self._violation = np.zeros(on.shape[1])
        self._multiplier, self._grown = np.zeros((2, on.shape[1], len(kinds)))
        self.count, self._steps = len(kinds), 0
        both = math.isinf(asked.volume) and math.isinf(asked.area)
        self._every = EVERY_OF_BOTH if both else EVERY

    def retry(self, volume_goal: float) -> None:
        """Hold exactly again what could not be held, as targets have moved, and volumes at another goal."""
        goal = np.where(self._equations.kind == VOLUME, volume_goal, 1.0)
        self._equations.scale[:] = self._rest_scale / goal[:, None]
        self._policy = InfeasibleAreas(self._equations.kind, self._asked)
        self._weight = self._asked

    @property
    def renews_directions(self) -> bool:
        return self._steps % self._every == 0

    def penalty(self, P: np.ndarray) -> float:
        weight = np.where(np.isinf(self._weight), 0.0, self._weight)
        if not weight.any():
            return 0.0
        surface, kinds, scale, *_ = self._equations
        error = scale * measured(surface, P, team=self._team)[kinds] - 1.0
        # The rest energy of a component is 2 corners x area; of the penalty's 1/2 a 1 remains.
        return float((weight * self._corners * self._area * error**2).sum())

    def add_forces(self, number: int, P: np.ndarray, B: np.ndarray) -> None:
        surface, kinds, scale, *_ = self._equations
        add_gradients(surface, number, kinds, scale * self._multiplier.T, P, B)

    def gradients(self, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        surface, kinds, scale, *_ = self._equations
        gradients(surface, kinds, scale, P, self._G, team=self._team)
        return self._G, self._Z

    def take_directions(self) -> None:
        component, count = self._equations.surface.component, len(self._slope)
        self._slope[:] = along(self._G, component, self._Z, count=count, team=self._team)

    def add_moves(self, G: np.ndarray) -> None:
        component = self._equations.surface.component
        self._team.ranges(lambda *own: shift(*own, G, component, self._G, self._grown), len(G))

    def project(self, P: np.ndarray) -> None:
        self._steps += 1
        policy, multiplier = self._policy, self._multiplier
        self._weight = policy.weight
        before = P.copy() if policy.may_fail.any() else P, multiplier.copy()
        self._violation = self._newton(P, multiplier)
        failed = policy.may_fail & (self._violation > REACHED)
        if failed.any():
            again = failed[self._equations.surface.component]
            P[again], multiplier[failed] = before[0][again], before[1][failed]
            self._weight = policy.relaxed(failed)
            self._violation = np.where(failed, self._newton(P, multiplier, only=failed), self._violation)
        self._grown = multiplier - before[1]
        lost = self._violation > REACHED
        if lost.any():  # their multipliers would add up from step to step: begin anew
            multiplier[lost], self._steps = 0.0, 0
        policy.record(failed)

    def restore(self, P: np.ndarray) -> bool:
        exact = np.isinf(self._weight)
        if not exact.any():
            return True
        violation = self._newton(P, np.zeros_like(self._multiplier), only=exact)
        return bool((violation <= np.maximum(self._violation, ROUNDING)).all())

    def _newton(self, P: np.ndarray, multiplier: np.ndarray, *, only: np.ndarray | bool = True) -> np.ndarray:
        """Newton's method on the equations, or on those of them `only` (q, c) or (c,) bool."""
        equations = self._equations._replace(
            compliance=1.0 / (self._weight * self._area), active=self._equations.active & only
        )
        return newton(equations, self._Z, self._slope, multiplier, P, team=self._team)


class InfeasibleAreas:
    """Which exact areas are held with a weight, as they cannot be met together with the volume.

    Where Newton's method fails on a component, its area has the weight `RELAXED` at this
    step; after `GIVE_UP` such steps in a row, for good.

    Parameters
    ----------
    kinds : (q,) int64
    weight : (q, c) float64
        Those asked for.

    Attributes
    ----------
    weight : (q, c) float64
        Those of the next step.
    """

    def __init__(self, kinds: np.ndarray, weight: np.ndarray) -> None:
        self._areas, self.weight = (kinds == AREA)[:, None], weight
        self._failures = np.zeros(weight.shape[1])

    @property
    def may_fail(self) -> np.ndarray:
        """(c,) bool: components whose area is to hold exactly."""
        return (self._areas & np.isinf(self.weight)).any(axis=0)

    def relaxed(self, failed: np.ndarray) -> np.ndarray:
        """(q, c) weights of a step at which the components `failed` (c,) bool."""
        return np.where(self._areas & failed, RELAXED, self.weight)

    def record(self, failed: np.ndarray) -> None:
        """Count a step at which the components `failed` (c,) bool."""
        self._failures = np.where(failed, self._failures + 1, 0)
        self.weight = self.relaxed(self._failures >= GIVE_UP)


def _lacking_volume(mesh: Mesh, rest: np.ndarray) -> np.ndarray:
    """(c,) str: why a component has no volume to hold, or nothing."""
    volume, area = rest
    lacking = np.where(np.abs(volume) <= FLAT * area**1.5, "flat", "").astype("<U11")
    if not (mesh.is_closed and mesh.is_oriented):
        directed = (mesh.F * mesh.n + np.roll(mesh.F, -1, axis=1)).ravel()
        ways, times = np.unique(directed, return_counts=True)
        lacking[mesh.component[ways[times > 1] // mesh.n]] = "orientation"
        lacking[mesh.component[mesh.boundary_edges[:, 0]]] = "boundary"
    return lacking
