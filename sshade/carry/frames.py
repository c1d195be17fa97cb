"""What kinds of frames have in common: points of M encoded on N at rest, decoded on N'."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from sshade.carry.projection import Projection
from sshade.mesh.mesh import Mesh
from sshade.threads import ThreadTeam

#: A triangle whose doubled area is under this, times its longest edge squared, has no normal.
ZERO_AREA = 1e-12


class Frames(Protocol):
    """Local frames on a proxy N at rest, in which points keep their coordinates while N deforms."""

    @property
    def name(self) -> str:
        """Of the kind, as users give it; a saved binding keeps it."""

    def encode(self, V: np.ndarray, on: Projection) -> np.ndarray:
        """Coordinates of points in the frames of N at rest.

        Parameters
        ----------
        V : (n, 3) float64
        on : Projection
            Where on N each point belongs.

        Returns
        -------
        (n, 3) float64
        """

    def decode(
        self,
        local: np.ndarray,
        NV: np.ndarray,
        *,
        on: Projection,
        rotations: np.ndarray | None = None,
        team: ThreadTeam | None = None,
        out: np.ndarray | None = None,
    ) -> tuple[np.ndarray, int]:
        """Points with given coordinates in the frames of N'.

        Parameters
        ----------
        local : (n, 3) float64
            Coordinates from :meth:`encode`.
        NV : (k, 3) float64
            Vertices of N'.
        on : Projection
            The one that `local` was encoded with.
        rotations : (k, 3, 3) float64, optional
            Those of the vertices of N', where its solver gives them; only blended frames use them.
        team : ThreadTeam, optional
            Threads that share the points.
        out : (n, 3) float64, C-contiguous, optional
            Where the points go; by default to a new array.

        Returns
        -------
        V : (n, 3) float64
        degenerate : int
            Number of frames that N or N' leaves undefined, such as those of zero-area
            triangles; in their place stands the mean of the neighbours' (see
            :func:`sshade.carry.neighbours.fill_from_neighbours`).
        """


def in_rows(
    work: Callable[[int, int, np.ndarray], None],
    n: int,
    team: ThreadTeam | None,
    out: np.ndarray | None,
) -> np.ndarray:
    """Points (n, 3) that ``work(first, end, points)`` writes, range by range, in `out` if there is one."""
    V = np.empty((n, 3)) if out is None else out
    (team or ThreadTeam(1)).ranges(lambda first, end: work(first, end, V), n)
    return V


#: Makes the frames of a proxy: of N at rest, and (k,) int, the vertex of M that each of N's is.
FrameMaker = Callable[[Mesh, np.ndarray], Frames]
