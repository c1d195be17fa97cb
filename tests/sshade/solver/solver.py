"""A system and its options in one object, for short tests."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from sshade import Mesh
from sshade.problem.options import Options, Stop
from sshade.solver.aim import Aim
from sshade.solver.local_global import solve
from sshade.solver.solution import Solution
from sshade.solver.system import System

OPTIONS = {option.name for option in fields(Options)}


class Solver:
    """Solves a :class:`System` again and again; options of the energy go to both."""

    def __init__(self, mesh: Mesh, index, *, energy: str = "spokes_and_rims", **given: Any) -> None:
        weights = {name: given.pop(name) for name in ("bending", "thickness") if name in given}
        self.system = System(mesh, np.asarray(index), Options(**weights), elements=energy, **given)

    def with_handles(self, index: np.ndarray, **given: Any) -> Solver:
        other = object.__new__(Solver)
        other.system = self.system.with_handles(index, **given)
        return other

    def solve(self, aim: Aim, *, tolerance=1e-5, max_iterations=1000, **given: Any) -> Solution:
        own = {name: given.pop(name) for name in OPTIONS - {"workers", "start"} if name in given}
        return solve(self.system, aim, Options(**own), stop=Stop(tolerance, max_iterations), **given)
