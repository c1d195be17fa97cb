"""The animation of a session: keys, and the poses between them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sshade.edit.grouping import Grouping
from sshade.edit.groups import Group
from sshade.edit.keys import LONGEST, Key, posed
from sshade.errors import InputError

#: Seconds between two shown poses from which the second does not continue the first.
JUMP = 0.5


class Animating(Grouping):
    """Groups with poses at some times; see :class:`sshade.edit.work.Work` for the parameters."""

    #: Time of the pose that was shown last.
    _sought = 0.0

    def key(self, time: float) -> None:
        """Store the current pose at a time, and replace a key that is there.

        Raises
        ------
        InputError
            When there are no groups, or the time is negative or too late.
        """
        if not 0 <= time <= LONGEST:
            raise InputError(f"a time is a number of seconds from 0 to {LONGEST:g}, not {time:g}")
        with self._lock:
            self._require_groups()
            others = [key for key in self.state.keys if key.time != time]
            keys = sorted([*others, Key(time, self.state.groups)], key=lambda key: key.time)
            self._push(replace(self.state, keys=tuple(keys)))

    def unkey(self, time: float) -> None:
        """Remove the key at a time; raise InputError when there is none."""
        with self._lock:
            keys = tuple(key for key in self.state.keys if key.time != time)
            if len(keys) == len(self.state.keys):
                raise InputError(f"there is no key at {time:g} s")
            self._push(replace(self.state, keys=keys))

    def seek(self, time: float) -> np.ndarray:
        """Show the mesh in the pose of a time, as a drag does, and return its positions (n, 3).

        Raises
        ------
        InputError
            When there are no groups or keys, or the mesh cannot be bound.
        """
        self._require_groups()
        moving = [group.number for group in self.state.groups if not group.link]
        self._jumped |= abs(time - self._sought) > JUMP
        self._sought = time
        return self._follow(lambda: replace(self.state, groups=self._posed(time)), moving)

    def pose(self, time: float) -> None:
        """Move the groups to the pose of a time; raise InputError when there are no groups or keys."""
        with self._lock:
            self._require_groups()
            self._push(replace(self.state, groups=self._posed(time)))
            self._jumped = True

    def _posed(self, time: float) -> tuple[Group, ...]:
        if not self.state.keys:
            raise InputError("there is no key; store a pose first")
        return posed(self.mesh, self.state.groups, self.state.keys, time)

    def _require_groups(self) -> None:
        if not self.state.groups:
            raise InputError("there are no groups to animate; pick vertices and make them movable")
