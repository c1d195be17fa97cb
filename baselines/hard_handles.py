"""Check of the handles for methods that know positions alone."""

from __future__ import annotations

from sshade.core.errors import InputError
from sshade.problem.handles import Handles


def require_hard(handles: Handles, method: str) -> None:
    """Raise InputError if a handle is soft or has a rotation, which `method` cannot use."""
    if not handles.hard.all():
        raise InputError(f"{method} takes no soft handles: leave their weights out, or use method fast")
    if handles.prescribed_rotations:
        raise InputError(f"{method} takes no rotations of handles: leave them out, or use method fast")
