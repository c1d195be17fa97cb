"""The keyword options that everything takes which minimises an as-rigid-as-possible energy.

One list of names, types and defaults: a method takes them as ``**options:
Unpack[SolverOptions]``, with defaults of its own where it says so.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import Any, Literal, TypedDict, Unpack

from sshade.errors import InputError
from sshade.solver.constraints import VolumeArea
from sshade.solver.strain_softening import StrainSoftening

Energy = Literal["spokes", "spokes_and_rims"]
Start = Literal["rest", "rigid"]


class EnergyOptions(TypedDict, total=False):
    """Terms of the energy beyond the published one.

    Attributes
    ----------
    volume, area : float
        Weights of the constraints on the volume that each component encloses and on
        its area, without unit: 0 leaves it free, inf holds it exactly; see
        :class:`sshade.solver.constraints.VolumeArea`. Components with a boundary keep a
        free volume, with a warning.
    stiffness, strain, limit : float
        Residual stiffness of strongly strained triangles, in (0, 1], the strain about
        which they soften, and the one about which they are stiff again, inf for none; of spokes and
        rims only; see :mod:`sshade.solver.strain_softening`. A stiffness of 1 is the energy as published.
    """

    volume: float
    area: float | None
    stiffness: float | None
    strain: float
    limit: float | None


class IterationOptions(TypedDict, total=False):
    """Where an iteration begins and when it stops.

    Attributes
    ----------
    tolerance : float
        Residual under which it stops: the largest move of a vertex in one plain
        iteration over the rest shape's bounding-box diagonal. 0 never stops early.
    max_iterations : int
        Cutoff; the paper's is 1000.
    start : {"rest", "rigid"}
        See :func:`sshade.solver.start.initial_guess`.
    """

    tolerance: float
    max_iterations: int
    start: Start


class SolverOptions(EnergyOptions, IterationOptions, total=False):
    """:class:`EnergyOptions`, :class:`IterationOptions`, and what the factorised system depends on.

    Attributes
    ----------
    parts : float
        How strongly each handle group pulls what is near it along with its own rigid motion, without
        unit: see :mod:`sshade.solver.parts`. 0 is the energy as published.
    bending : float
        Length over which a fold is spread, over the square root of the mesh's area: see
        :mod:`sshade.solver.bending`. 0 is the energy as published.
    """

    parts: float | None
    bending: float | None


#: The published energy, the paper's cutoff.
DEFAULTS: SolverOptions = {
    "volume": 0.0,
    "area": 0.0,
    "stiffness": 1.0,
    "strain": 0.02,
    "limit": inf,
    "parts": 0.0,
    "bending": 0.0,
    "tolerance": 1e-5,
    "max_iterations": 1000,
    "start": "rest",
}


def complete(given: Mapping[str, Any], **defaults: Unpack[SolverOptions]) -> dict[str, Any]:
    """All solver options: those given and not None, else a method's own defaults, else :data:`DEFAULTS`.

    Raises
    ------
    TypeError
        On a name that is no option.
    InputError
        On a negative weight or length, an infinite one of parts or of bending, a stiffness out of (0, 1], or
        a strain or a limit that is not positive.
    """
    unknown = [name for name in given if name not in DEFAULTS]
    if unknown:
        raise TypeError(f"unexpected keyword argument {unknown[0]!r}; the options are {', '.join(DEFAULTS)}")
    own = {name: value for name, value in given.items() if value is not None}
    options: dict[str, Any] = {**DEFAULTS, **defaults, **own}
    VolumeArea(options["volume"], options["area"])
    StrainSoftening(options["stiffness"], options["strain"], options["limit"])
    if not 0 <= options["parts"] < inf:
        raise InputError(f"the weight of parts is a number from 0 (none), not {options['parts']}")
    if not 0 <= options["bending"] < inf:
        raise InputError(f"the length of bending is a number from 0 (none), not {options['bending']}")
    return options


def energy_options(options: Mapping[str, Any]) -> dict[str, Any]:
    """Those of :func:`complete` options that belong to the energy."""
    return {name: options[name] for name in EnergyOptions.__annotations__}
