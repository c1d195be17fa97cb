"""The as-rigid-as-possible energy of one solve: the local step and the forces of all its terms."""

from __future__ import annotations

import numpy as np

from sshade.core.threads import ThreadTeam
from sshade.mesh.rotations import fit_rotations, quaternions
from sshade.problem.majority import MajorityMotion
from sshade.problem.options import Options
from sshade.solver.system import System
from sshade.solver.terms import Pulls, Term
from sshade.solver.terms.arap import Arap
from sshade.solver.terms.bending import Bending
from sshade.solver.terms.inertia import Inertia
from sshade.solver.terms.struts import Strutting

#: Vertices of the mesh (j,), each once, and their prescribed rotations (j, 3, 3).
Prescribed = tuple[np.ndarray, np.ndarray]


class Energy:
    """The energy of a bound system under given targets: the sum of its terms.

    The name of its first term, "spokes" or "spokes_and_rims", is a :data:`sshade.problem.options.Energy`.

    Parameters
    ----------
    system : System
    options : Options
        `stiffness`, `strain` and `strain_limit`; see :mod:`sshade.solver.terms.arap`.
    team : ThreadTeam

    Attributes
    ----------
    R : (n, 9) float64
        Rotation matrices of the last local step, row by row, in the solver's order.
    forces : (n, 3) float64
        Minus half of the gradient at the last local step, divided by
        :attr:`sshade.solver.system.System.corners`. Global steps may overwrite it.
    """

    def __init__(self, system: System, options: Options, *, team: ThreadTeam) -> None:
        n, ranges = system.mesh.n, system.ranges
        self._system, self._ranges, self._team = system, ranges, team
        self._arap = Arap(system.elements, ranges, system.rest, options)
        self._pulls = Pulls(system.springs, ranges, corners=system.corners)
        #: The first term overwrites covariances and forces.
        self._terms: list[Term] = [self._arap, self._pulls]
        if system.plate:
            self._terms.insert(1, Bending(system.plate, ranges))
        if system.struts:
            self._terms.append(Strutting(system.struts, ranges))
        self._inertia: Inertia | None = None
        if system.inertia is not None:
            mesh = system.mesh
            self._inertia = Inertia(
                system.inertia,
                (mesh.V - mesh.origin)[system.vertex],
                origin=mesh.origin,
                area=mesh.area,
                ranges=ranges,
                corners=system.corners,
            )
            self._terms.append(self._inertia)
        self._Q, self.R, self.forces = np.tile([1.0, 0, 0, 0], (n, 1)), np.empty((n, 9)), np.empty((n, 3))

    @property
    def weight(self) -> np.ndarray | None:
        """(m,) strain weights of the triangles at the last local step; None for the quadratic energy."""
        return self._arap.weight

    def aim(
        self,
        targets: np.ndarray,
        prescribed: Prescribed | None,
        fraction: np.ndarray | None,
        majority: MajorityMotion | None = None,
    ) -> None:
        """Set the targets of handles, the prescribed rotations, the pull fractions, and the majority motion.

        Parameters
        ----------
        targets : (k, 3) float64
            Relative to the mesh's origin.
        prescribed : Prescribed, optional
        fraction : (k,) float64, optional
            Fraction of the stiffness of each soft handle, in [0, 1]; 1 if missing.
        majority : MajorityMotion, optional
            Without one, inertia is off.
        """
        self._pulls.aim(targets, fraction)
        if self._inertia:
            self._inertia.aim(majority)
        vertex, rotations = prescribed or (np.empty(0, dtype=np.int64), np.empty((0, 3, 3)))
        order = np.argsort(self._system.place[vertex])
        rotations = np.array(rotations, dtype=np.float64)[order]
        self._prescribed = self._system.place[vertex][order], rotations

    def begin_with(self, rotations: np.ndarray) -> None:
        """Begin the search for rotations at the rotations (n, 3, 3) of the mesh's vertices."""
        self._Q[:] = quaternions(rotations)[0][self._system.vertex]

    def local_step(self, u: np.ndarray) -> float:
        """Fit the rotations to positions u (n, 3), and compute the forces there.

        Returns
        -------
        float
            The energy minus :attr:`sshade.solver.system.System.rest_energy`.
        """

        def fit(number: int) -> float:
            energy = 0.0
            for term in self._terms:
                energy += term.local(number, u, self.R)
            energy -= 2.0 * self._rotate(number)
            for term in self._terms:
                term.turn(number, self.R)
            return energy

        def force(number: int) -> float:
            energy = 0.0
            for term in self._terms:
                energy += term.forces(number, u, self.R, self.forces)
            return energy

        # The sum of the fits is the quadratic energy without a constant, the rest energy. With strain weights
        # the energy is known only after the forces.
        quadratic = sum(self._team(fit, len(self._ranges)))
        total = sum(self._team(force, len(self._ranges)))
        return quadratic if self.weight is None else total - self._system.rest_energy

    def _rotate(self, number: int) -> float:
        """Replace covariances S in R by rotations, fitted or prescribed; return ``sum tr(R S)``."""
        _, first, end = self._ranges[number]
        place, rotations = self._prescribed
        own = slice(*np.searchsorted(place, (first, end)))
        place, rotations = place[own], rotations[own]
        S = self.R[place].reshape(-1, 3, 3)
        total = fit_rotations(self.R[first:end], self._Q[first:end])
        if len(place):
            fitted = self.R[place].reshape(-1, 3, 3)
            total += float(np.einsum("iab,iba->", rotations - fitted, S))
            self.R[place] = rotations.reshape(-1, 9)
        return total
