"""The states of an editor, with a way back and forth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sshade.edit.state import State

#: States kept, and bytes of their shapes; those of older states are computed again when they are needed.
STATES, BYTES = 1000, 500_000_000


class History:
    """A list of states, one of which is the present one.

    Parameters
    ----------
    first : State
    """

    def __init__(self, first: State) -> None:
        self._states, self._at = [first], 0

    @property
    def state(self) -> State:
        """The present one."""
        return self._states[self._at]

    @property
    def can_undo(self) -> bool:
        """Whether there is one before it."""
        return self._at > 0

    @property
    def can_redo(self) -> bool:
        """Whether there is one after it."""
        return self._at < len(self._states) - 1

    def push(self, state: State) -> None:
        """Make a state the present one; those that were undone are gone."""
        self._states = [*self._states[: self._at + 1], state][-STATES:]
        self._at = len(self._states) - 1

    def go(self, steps: int) -> None:
        """Go so many states on, or back, as far as there are any."""
        self._at = min(max(self._at + steps, 0), len(self._states) - 1)

    def settle(self, state: State, shape: np.ndarray) -> None:
        """The shape of a state is known, and so that of others that differ in what is picked alone."""
        for i, other in enumerate(self._states):
            if other.same_shape(state):
                self._states[i] = replace(other, shape=shape)
        self._drop_shapes()

    def _drop_shapes(self) -> None:
        """Forget the shapes of the oldest states where all together are too large."""
        kept = {id(self.state.shape): 0 if self.state.shape is None else self.state.shape.nbytes}
        for i in range(len(self._states) - 1, -1, -1):
            shape = self._states[i].shape
            if shape is None or id(shape) in kept:
                continue
            if sum(kept.values()) + shape.nbytes > BYTES:
                self._states[i] = replace(self._states[i], shape=None)
            else:
                kept[id(shape)] = shape.nbytes
