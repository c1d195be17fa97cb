"""A bent tube whose limbs nearly touch. Projection to the nearest point of a proxy fails on it."""

from __future__ import annotations

import numpy as np

from sshade.core.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.problem.task import DeformationTask, Handles

#: Multiples of the tube's radius: length of the parallel part of the limbs, length of the part where they
#: diverge, and radius of the bend, which is wide enough to keep its inner side smooth.
SIDE_BY_SIDE, PARTING, BEND = 5.0, 3.0, 2.0
#: Number of handles at each end.
HANDLES = 30


def hairpin_task(*, gap: float = 0.02, angle: float = 40.0, around: int = 60) -> DeformationTask:
    """Make the task of opening a hairpin at its bend, like an arm lifted off a body. One end is fixed.

    Parameters
    ----------
    gap : float
        Distance between the limbs, as a multiple of their radius.
    angle : float
        Rotation of the moved end about the centre of the bend, in degrees.
    around : int
        Number of vertices around the tube.

    Raises
    ------
    InputError
        See :func:`hairpin`.
    """
    mesh = hairpin(gap=gap, around=around)
    x, _, z = mesh.V.T
    # Slightly more than the round ends.
    ends = [np.flatnonzero((z < 1.5) & (np.sign(x) == side)) for side in (-1, 1)]
    index = np.concatenate([end[np.linspace(0, len(end) - 1, HANDLES).astype(int)] for end in ends])
    dynamic = x[index] > 0
    centre = np.array([0.0, 0.0, 1.0 + SIDE_BY_SIDE + PARTING])
    cos, sin = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    turn = np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]])
    turned = (mesh.V[index] - centre) @ turn.T + centre
    target = np.where(dynamic[:, None], turned, mesh.V[index])
    return DeformationTask(
        f"hairpin/gap_{gap:g}",
        mesh,
        Handles(index, target, dynamic=dynamic, group=dynamic.astype(int)),
        meta={"gap": gap, "angle": angle},
    )


def hairpin(*, gap: float, around: int) -> Mesh:
    """Make a closed tube of radius 1 with round ends at z = 0 and limbs at x < 0 and x > 0.

    Parameters
    ----------
    gap, around
        See :func:`hairpin_task`.

    Raises
    ------
    InputError
        When the gap is not between 0 and 1, or `around` is less than 8.
    """
    if not 0 < gap < 1:
        raise InputError(f"a hairpin's gap must lie between 0 and 1, not be {gap:g}")
    if around < 8:
        raise InputError(f"a hairpin needs at least 8 vertices around, not {around}")
    step = 2 * np.pi / around
    x, z, tilt = _centre_line(gap, step)
    polar = step * np.arange(1, round(np.pi / 2 / step))  # rings of the round ends
    x = np.concatenate([np.full(len(polar), x[0]), x, np.full(len(polar), x[-1])])
    z = np.concatenate([1 - np.cos(polar), z, 1 - np.cos(polar[::-1])])
    radius = np.ones(len(x))
    radius[: len(polar)] = np.sin(polar)
    radius[len(x) - len(polar) :] = np.sin(polar[::-1])
    tilt = np.pad(tilt, len(polar), mode="edge")

    turn = step * (np.arange(around) + 0.5 * (np.arange(len(x))[:, None] % 2))
    across = radius[:, None] * np.cos(turn)  # in the plane of the bend
    rings = np.stack(
        [
            x[:, None] + across * np.cos(tilt)[:, None],
            radius[:, None] * np.sin(turn),
            z[:, None] - across * np.sin(tilt)[:, None],
        ],
        axis=2,
    )
    poles = [[x[0], 0.0, 0.0], [x[-1], 0.0, 0.0]]
    return Mesh(np.concatenate([rings.reshape(-1, 3), poles]), _faces(len(x), around))


def _centre_line(gap: float, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sample the centre line at about `step`; return x, z and the direction as an angle from +z."""
    fine = np.linspace(0, 1, 2001)
    along = SIDE_BY_SIDE + PARTING
    parted = np.clip((fine * along - SIDE_BY_SIDE) / PARTING, 0, 1)
    side = 1 + gap / 2 + (BEND - 1 - gap / 2) * parted**2 * (3 - 2 * parted)
    angle = np.pi * fine[1:-1]
    x = np.concatenate([-side, -BEND * np.cos(angle), side[::-1]])
    z = 1 + np.concatenate([along * fine, along + BEND * np.sin(angle), along * fine[::-1]])
    length = np.concatenate([[0], np.cumsum(np.hypot(np.diff(x), np.diff(z)))])
    at = np.linspace(0, length[-1], round(length[-1] / step) + 1)
    tilt = np.unwrap(np.arctan2(np.gradient(x, length), np.gradient(z, length)))
    return np.interp(at, length, x), np.interp(at, length, z), np.interp(at, length, tilt)


def _faces(rings: int, around: int) -> np.ndarray:
    """Faces between rings that alternate by half a step, and of the two poles, numbered after the rings."""
    row, here = np.meshgrid(np.arange(rings - 1), np.arange(around), indexing="ij")
    following = (here + 1) % around
    low, low_next = row * around + here, row * around + following
    high, high_next = low + around, low_next + around
    even = (row % 2 == 0)[..., None]
    first = np.where(even, np.stack([low, low_next, high], 2), np.stack([low, high_next, high], 2))
    second = np.where(even, np.stack([low_next, high_next, high], 2), np.stack([low, low_next, high_next], 2))
    ring = np.arange(around)
    last = (rings - 1) * around
    begin = np.stack([np.full(around, rings * around), (ring + 1) % around, ring], axis=1)
    end = np.stack([np.full(around, rings * around + 1), last + ring, last + (ring + 1) % around], axis=1)
    return np.concatenate([begin, first.reshape(-1, 3), second.reshape(-1, 3), end])
