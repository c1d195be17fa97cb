"""The goal for the volume of a component."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from sshade.core.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.method.regions import enclosed_volume
from sshade.problem.options import Options

log = logging.getLogger(__name__)

#: Largest default weight of the area with a volume goal. A body that grows needs more area.
GOAL_AREA = 0.1
#: Least volume of a component with a goal, as a multiple of area^1.5. The ratio of two volumes near zero
#: means nothing.
FLAT = 1e-5
#: Relative error of a goal from which on a warning is logged.
MISSED = 0.01


def with_goal(mesh: Mesh, options: Options, *, area: bool) -> Options:
    """Return the options of a component: a volume goal limits the default weight of the area.

    Parameters
    ----------
    mesh : Mesh
        The component: an oriented manifold.
    options : Options
    area : bool
        Whether the user gave a weight of the area.

    Raises
    ------
    InputError
        When the component has a goal and no volume at rest.
    """
    if options.volume_goal is None:
        return options
    if not mesh.is_closed:
        raise InputError("volume_goal needs a closed surface, and this one has a boundary: close its holes")
    if not abs(mesh.volume) > FLAT * mesh.area**1.5:
        raise InputError("volume_goal needs a volume at rest to compare with, and this surface is flat")
    return options if area else replace(options, area=min(options.area, GOAL_AREA))


def goal_error(mesh: Mesh, V: np.ndarray, volume_goal: float) -> float:
    """Return the relative error of the volume of M' (n, 3)."""
    F = mesh.F.astype(np.uint32)
    return abs(enclosed_volume(V, F) / (volume_goal * enclosed_volume(mesh.V, F)) - 1)


def warn_of_missed(error: float) -> None:
    """Warn of a volume whose relative error is above :data:`MISSED`."""
    if error > MISSED:
        log.warning("the volume of the mesh is %.2g %% from its goal", 100 * error)
