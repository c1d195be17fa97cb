"""The handle vertices of a system: hard handles are fixed, soft handles are pulled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sshade.problem.handle_checks import checked_index
from sshade.solver.ordered_mesh import OrderedMesh


@dataclass(frozen=True, eq=False)
class BoundHandles:
    """Handle vertices and their places in the solver's order.

    Attributes
    ----------
    index : (k,) int64
        Handle vertices of the mesh, each once.
    hard : (h,) int64
        Numbers of the hard handles in `index`.
    fixed : (h,) int
        Their places.
    soft : (s,) int64
        Numbers of the soft handles in `index`, by ascending place.
    pulled : (s,) int
        Their places.
    stiffness : (s,) float64
        See :attr:`sshade.Handles.stiffness`.
    """

    index: np.ndarray
    hard: np.ndarray
    fixed: np.ndarray
    soft: np.ndarray
    pulled: np.ndarray
    stiffness: np.ndarray

    @classmethod
    def of(cls, ordered: OrderedMesh, index: np.ndarray, stiffness: np.ndarray | None) -> BoundHandles:
        """Bind handle vertices (k,); stiffness (k,) is inf, the default, for hard handles.

        Raises
        ------
        InputError
            On vertices that are out of range, given twice or missing in a component.
        """
        index = checked_index(index, once=True)
        ordered.mesh.require_handles(index)
        stiffness = np.full(len(index), np.inf) if stiffness is None else stiffness
        place = ordered.place[index]
        hard = np.flatnonzero(np.isinf(stiffness))
        soft = np.flatnonzero(np.isfinite(stiffness))
        soft = soft[np.argsort(place[soft])]
        return cls(index, hard, place[hard], soft, place[soft], stiffness[soft])
