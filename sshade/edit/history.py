"""States of the editor for undo and redo."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sshade.edit.state import State

#: Number of kept states, and bytes of their shapes. Shapes of older states are computed again on demand.
STATES, BYTES = 1000, 500_000_000


class History:
    """A list of states and a current state.

    Parameters
    ----------
    first : State
    """

    def __init__(self, first: State) -> None:
        self._states, self._at = [first], 0

    @property
    def state(self) -> State:
        """Current state."""
        return self._states[self._at]

    @property
    def can_undo(self) -> bool:
        """Whether there is an earlier state."""
        return self._at > 0

    @property
    def can_redo(self) -> bool:
        """Whether there is a later state."""
        return self._at < len(self._states) - 1

    def push(self, state: State) -> None:
        """Append a state and make it the current one; states that were undone are dropped."""
        self._states = [*self._states[: self._at + 1], state][-STATES:]
        self._at = len(self._states) - 1

    def go(self, steps: int) -> None:
        """Go forth, or back if `steps` is negative, as far as there are states."""
        self._at = min(max(self._at + steps, 0), len(self._states) - 1)

    def store_shape(self, state: State, shape: np.ndarray) -> None:
        """Store the converged shape of a state, also for states that differ in the selection only."""
        for i, other in enumerate(self._states):
            if other.same_shape(state):
                self._states[i] = replace(other, shape=shape)
        self._drop_shapes()

    def _drop_shapes(self) -> None:
        """Drop the oldest shapes until all shapes fit in :data:`BYTES`."""
        kept = {id(self.state.shape): 0 if self.state.shape is None else self.state.shape.nbytes}
        for i in range(len(self._states) - 1, -1, -1):
            shape = self._states[i].shape
            if shape is None or id(shape) in kept:
                continue
            if sum(kept.values()) + shape.nbytes > BYTES:
                self._states[i] = replace(self._states[i], shape=None)
            else:
                kept[id(shape)] = shape.nbytes
