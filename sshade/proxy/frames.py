"""Local frames of a proxy: points of M get coordinates on N at rest, and positions from them on N'."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np

from sshade.core.errors import InputError
from sshade.core.threads import ThreadTeam
from sshade.mesh.mesh import Mesh
from sshade.proxy.projection import Projection

#: Largest doubled area, over the squared longest edge, of a triangle that has no normal. Far smaller than
#: :data:`sshade.mesh.faces.NO_AREA`: a needle without usable cotangents may still have a normal.
ZERO_AREA = 1e-12

#: Writes the positions of the points ``first`` to ``end``: ``place(first, end, local, on, V)``.
Placer = Callable[[int, int, np.ndarray, Projection, np.ndarray], None]


class Frames(ABC):
    """Local frames on a proxy N at rest, in which points keep their coordinates while N deforms."""

    @property
    @abstractmethod
    def name(self) -> str:
        """Kind of the frames, as users choose it; a saved binding keeps it."""

    @abstractmethod
    def encode(self, V: np.ndarray, on: Projection) -> np.ndarray:
        """Return the coordinates of points in the frames of N at rest.

        Parameters
        ----------
        V : (n, 3) float64
            Points.
        on : Projection
            Their projections onto N.

        Returns
        -------
        (n, 3) float64
        """

    @abstractmethod
    def posed(self, NV: np.ndarray, rotations: np.ndarray | None, team: ThreadTeam) -> tuple[Placer, int]:
        """Return a function that places points on N', and the number of undefined frames.

        Parameters are as in :meth:`decode`.
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
        """Return the points with given coordinates in the frames of N'.

        Parameters
        ----------
        local : (n, 3) float64
            Coordinates from :meth:`encode`.
        NV : (k, 3) float64
            Vertices of N'.
        on : Projection
            The projections that `local` was encoded with.
        rotations : (k, 3, 3) float64, optional
            Rotations of the vertices of N, if a solver provides them. Only blended frames use them.
        team : ThreadTeam, optional
            Threads that divide the points; by default the calling thread alone.
        out : (n, 3) float64, C-contiguous, optional
            Array for the points; by default a new one.

        Returns
        -------
        V : (n, 3) float64
        degenerate : int
            Number of frames that N or N' leaves undefined, for example at zero-area triangles. The mean of
            neighbouring frames replaces them (:func:`sshade.proxy.vertex_maps.fill_from_neighbours`).
        """
        V, team = np.empty((len(local), 3)) if out is None else out, team or ThreadTeam(1)
        place, degenerate = self.posed(NV, rotations, team)
        team.ranges(place, len(local), local, on, V)
        return V, degenerate


#: Makes the frames of a proxy N at rest. The second argument (k,) int holds the samples, vertices of M.
FrameMaker = Callable[[Mesh, np.ndarray], Frames]


def checked_out(out: np.ndarray | None, shape: tuple[int, ...]) -> np.ndarray:
    """Return the array that a caller gave for positions, or a new one.

    Raises
    ------
    InputError
        Unless it is a writable, C-contiguous float64 array of this shape; kernels write into it unchecked.
    """
    if out is None:
        return np.empty(shape)
    fits = isinstance(out, np.ndarray) and out.shape == shape and out.dtype == np.float64
    if not (fits and out.flags.c_contiguous and out.flags.writeable):
        raise InputError(f"`out` must be a writable, contiguous float64 array of shape {shape}")
    return out
