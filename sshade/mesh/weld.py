"""How far a copy of a vertex may be from its place; commands check it before they import numba."""

from __future__ import annotations

from numbers import Real

from sshade.core.errors import InputError

#: Largest distance of a copy of a vertex from its place, on each axis, as a fraction of the bounding-box
#: diagonal: the default, and the largest value that a user can choose.
NEAR, FARTHEST_COPY = 1e-9, 1e-3
#: Largest distance of two copies from each other, as a fraction of the shortest edge at either.
COPY = 1e-3


def check_weld(weld: float) -> None:
    """Raise InputError unless a distance of copies from their place is in its range."""
    if not isinstance(weld, Real) or not 0 <= weld <= FARTHEST_COPY:
        raise InputError(f"weld is a fraction of the diagonal from 0 to {FARTHEST_COPY:g}, not {weld!r}")
