"""Volume and area held during local/global iterations, exactly or with a weight.

A global step of the free problem solves ``L u = b``. With constraints C_q, the
volume and the area of a component over their rest values, it becomes ``L u = b
+ sum_q lambda_q grad C_q(u)``, with the multipliers of the step before; Newton's
method on their changes then moves along directions ``z_q = L^-1 grad C_q`` to
where ``C_q - goal_q + s_q lambda_q = 0``. An exact constraint has s = 0; a
weighted one is the penalty ``weight / 2 x rest energy x (C_q - goal_q)^2``, for
which ``s = 1 / (weight x rest area)``. In the end the multipliers change no more:
directions need not be those of the present shape, and new ones, a right-hand
side for each constraint, are found every few steps only.
"""

from __future__ import annotations

import logging
import math
from typing import NamedTuple

import numpy as np

from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.solver.volume_area import (
    AREA,
    ROUNDING,
    VOLUME,
    along,
    gather_columns,
    gradients,
    measure,
    newton,
    push,
    scatter_columns,
)

log = logging.getLogger(__name__)
#: Steps that share the directions, and how many where both constraints are exact: one may then not make
#: up for what the other lacks.
EVERY, EVERY_OF_BOTH = 8, 4

#: Relative error up to which an exact constraint counts as reached.
REACHED = 1e-6
#: Weight of an area that cannot be held exactly, and the steps after which it is given up.
RELAXED, GIVE_UP = 1.0, 30
#: A volume below this (x area^1.5) is that of a flat body: nothing to be relative to.
FLAT = 1e-9


class Wanted(NamedTuple):
    """What a solve is asked to hold.

    Attributes
    ----------
    volume, area : float
        Weights: 0 leaves it free, inf holds it exactly. In between, an error e
        (relative, of a component) costs ``weight / 2 x e^2`` times the
        component's rest energy: the energy of its rest shape shrunk to a point.
        Neither the unit of length nor the resolution matters.
    """

    volume: float = 0.0
    area: float = 0.0

    def checked(self) -> Wanted:
        """Itself; InputError on a weight that is negative or NaN."""
        for name, weight in self._asdict().items():
            if not weight >= 0:
                raise InputError(f"the {name} weight goes from 0 (free) to inf (exact); {weight} does not")
        return self


class Errors(NamedTuple):
    """Relative errors of a shape: the largest over components, NaN where none has a volume."""

    volume: float
    area: float


class Constraints:
    """The volumes and areas of a mesh's components, to be held in any number of solves.

    Parameters
    ----------
    mesh : Mesh
        Rest shape. Components that are not closed and consistently oriented, or
        are flat, have no volume to hold.
    position : (n,) int
        Place of each vertex in the order of the solver's arrays.
    """

    def __init__(self, mesh: Mesh, position: np.ndarray) -> None:
        owner = mesh.component[mesh.F[:, 0]]
        near = np.lexsort((position[mesh.F].min(axis=1), owner))
        self.faces = np.ascontiguousarray(position[mesh.F[near]], dtype=np.int32)
        self.start = np.searchsorted(owner[near], np.arange(mesh.component.max() + 2))
        self.component = np.empty(mesh.n, dtype=np.int32)
        self.component[position] = mesh.component
        rest = np.empty((mesh.n, 3))
        rest[position] = mesh.V
        self.rest = measure(self.faces, self.start, rest)
        self._lacking = _lacking_volume(mesh, self.rest)

    @property
    def has_volume(self) -> np.ndarray:
        """(c,) bool: which components enclose a volume that can be held."""
        return self._lacking == ""

    def hold(self, wanted: Wanted, *, corners: int) -> Hold | None:
        """What a solve needs to hold what is wanted; None if that is nothing.

        Parameters
        ----------
        wanted : Wanted
        corners : int
            How often the energy counts an edge.
        """
        if wanted.volume > 0 and not self.has_volume.all():
            log.warning("the volume constraint is %s", self._off())
        kinds = [VOLUME] * bool(wanted.volume > 0 and self.has_volume.any()) + [AREA] * (wanted.area > 0)
        return Hold(self, wanted, np.array(kinds), corners=corners) if kinds else None

    def errors(self, P: np.ndarray, wanted: Wanted) -> Errors:
        """How far positions P (n, 3), in the solver's order, are from what is wanted."""
        now, has = measure(self.faces, self.start, P), self.has_volume
        volume = np.abs(now[VOLUME, has] / self.rest[VOLUME, has] - 1)
        area = np.abs(now[AREA] / self.rest[AREA] - 1)
        return Errors(float(volume.max()) if len(volume) else math.nan, float(area.max()))

    def status(self, wanted: Wanted, errors: Errors) -> tuple[str, str]:
        """What became of the volume and of the area, in words for a row.

        Returns
        -------
        volume, area : str
            "free", "weighted", "exact", or "infeasible" where the last error of
            an exact one is above `REACHED`. The volume may be "off", and why.
        """
        words = []
        for weight, error in ((wanted.volume, errors.volume), (wanted.area, errors.area)):
            reached = "exact" if error <= REACHED else "infeasible"
            words.append("free" if weight == 0 else "weighted" if weight < math.inf else reached)
        if wanted.volume > 0 and not self.has_volume.all():
            words[0] = f"{words[0]}; {self._off()}" if self.has_volume.any() else self._off()
        return words[0], words[1]

    def _off(self) -> str:
        lacking = self._lacking[self._lacking != ""]
        where = f" on {len(lacking)} of {len(self._lacking)} components" * (len(lacking) < len(self._lacking))
        return f"off{where}: {', '.join(sorted(set(lacking.tolist())))}"


class Hold:
    """The constraints of one solve, with their work arrays; see :meth:`Constraints.hold`.

    Attributes
    ----------
    columns : int
        Right-hand sides that it adds to a global step.
    """

    def __init__(self, constraints: Constraints, wanted: Wanted, kinds: np.ndarray, *, corners: int) -> None:
        rest, n = constraints.rest, len(constraints.component)
        on = np.stack([constraints.has_volume, np.ones_like(constraints.has_volume)])[kinds]
        self._mesh = constraints.faces, constraints.start
        self._component, self._kinds, self._area = constraints.component, kinds, rest[AREA]
        self._scale = np.where(on, 1.0, 0.0) / np.where(on, rest[kinds], 1.0)
        self._goal = np.where(on, 1.0, 0.0)
        self._weight = np.where(on, np.array([wanted.volume, wanted.area])[kinds, None], math.inf)
        self._now, self._corners = self._weight, corners
        self._G, self._Z = np.zeros((2, n, len(kinds), 3))
        self._slope = np.empty((on.shape[1], len(kinds), len(kinds)))
        self._failures, self._miss = np.zeros((2, on.shape[1]))
        self._multiplier = np.zeros((on.shape[1], len(kinds)))
        self.columns, self._steps = 3 * len(kinds), 0
        both = math.isinf(wanted.volume) and math.isinf(wanted.area)
        self._every = EVERY_OF_BOTH if both else EVERY

    def penalty(self, P: np.ndarray) -> float:
        """What weighted constraints add to the energy of positions P (n, 3)."""
        weight = np.where(np.isinf(self._now), 0.0, self._now)
        if not weight.any():
            return 0.0
        error = self._scale * measure(*self._mesh, P)[self._kinds] - self._goal
        # The rest energy of a component is 2 corners x area; of the penalty's 1/2 a 1 remains.
        return float((weight * self._corners * self._area * error**2).sum())

    @property
    def turns(self) -> bool:
        """Whether the next step needs new directions."""
        return self._steps % self._every == 0

    def push(self, P: np.ndarray, B: np.ndarray) -> None:
        """Write to B (n, 3) what the multipliers add to right-hand sides at positions P (n, 3)."""
        B[:] = 0.0
        push(*self._mesh, self._kinds, self._scale * self._multiplier.T, P, B)

    def gather(self, P: np.ndarray, rows: np.ndarray, X: np.ndarray) -> None:
        """Write the gradients at P (n, 3) of the vertices `rows` to columns 3.. of X (f, 3 + columns)."""
        gradients(*self._mesh, self._kinds, self._scale, P, self._G)
        gather_columns(self._G, rows, X)

    def turn(self, X: np.ndarray, rows: np.ndarray) -> None:
        """Take the solutions in columns 3.. of X for directions."""
        scatter_columns(X, rows, self._Z)
        along(self._G, self._component, self._Z, self._slope)

    def pull(self, P: np.ndarray) -> None:
        """Move P (n, 3) to where the constraints hold.

        Where a component's exact constraints cannot be met together, its area
        gets the weight `RELAXED` until the next step; after `GIVE_UP` such
        steps in a row, for good.
        """
        self._steps += 1
        area = (self._kinds == AREA)[:, None]
        exact_area = (area & np.isinf(self._weight)).any(axis=0)
        before = (P.copy(), self._multiplier.copy()) if exact_area.any() else (P, self._multiplier)
        self._now = self._weight
        self._miss = self._newton(P, np.ones_like(self._weight, dtype=bool), self._multiplier)
        failed = exact_area & (self._miss > REACHED)
        if failed.any():
            again = failed[self._component]
            P[again], self._multiplier[failed] = before[0][again], before[1][failed]
            self._now = np.where(area & failed, RELAXED, self._weight)
            only = np.broadcast_to(failed, self._now.shape)
            self._miss = np.where(failed, self._newton(P, only, self._multiplier), self._miss)
        lost = self._miss > REACHED
        if lost.any():  # their multipliers would add up from step to step: begin anew
            self._multiplier[lost], self._steps = 0.0, 0
        self._failures = np.where(failed, self._failures + 1, 0)
        self._weight = np.where(self._failures >= GIVE_UP, self._now, self._weight)

    def restore(self, P: np.ndarray) -> bool:
        """Move P (n, 3) to where the exact constraints hold, along the present directions.

        False where they are missed by more than they were then.
        """
        exact = np.isinf(self._now)
        if not exact.any():
            return True
        miss = self._newton(P, exact, np.zeros_like(self._multiplier))
        return bool((miss <= np.maximum(self._miss, ROUNDING)).all())

    def _newton(self, P: np.ndarray, only: np.ndarray, multiplier: np.ndarray) -> np.ndarray:
        scale, goal = np.where(only, (self._scale, self._goal), 0.0)
        equations = self._kinds, scale, goal, 1.0 / (self._now * self._area)
        return newton(*self._mesh, self._component, *equations, self._Z, self._slope, multiplier, P)


def _lacking_volume(mesh: Mesh, rest: np.ndarray) -> np.ndarray:
    """(c,) str: why a component has no volume to hold, or nothing."""
    volume, area = rest
    lacking = np.where(np.abs(volume) < FLAT * area**1.5, "flat", "").astype("<U11")
    if not (mesh.is_closed and mesh.is_oriented):
        directed = (mesh.F * mesh.n + np.roll(mesh.F, -1, axis=1)).ravel()
        ways, times = np.unique(directed, return_counts=True)
        lacking[mesh.component[ways[times > 1] // mesh.n]] = "orientation"
        lacking[mesh.component[mesh.boundary_edges[:, 0]]] = "boundary"
    return lacking
