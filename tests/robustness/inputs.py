"""The sound files that tests of commands begin with."""

import numpy as np

from sshade import Handles
from sshade.files.meshes import write_mesh
from sshade.files.task_files import write_handles
from tests.shapes import bumpy, end_handles

BODY = bumpy(2)


def pose(V: np.ndarray) -> Handles:
    """Return handles: the lowest tenth along z stays, the highest tenth moves sideways and up."""
    return end_handles(V, shift=np.ptp(V[:, 2]) * np.array([0.1, 0, 0.05]))


def write_sound() -> None:
    write_mesh("body.ply", BODY.V, BODY.F)
    write_handles("pose.json", pose(BODY.V))
