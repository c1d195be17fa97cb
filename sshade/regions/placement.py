"""Where the handles of M are on a proxy: at their own samples, or at the nearest samples of other handles."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sshade.core.errors import InputError
from sshade.mesh.incidence import numbered
from sshade.mesh.mesh import Mesh
from sshade.problem.handles import Handles
from sshade.problem.snapping import snap_to_vertices
from sshade.proxy.sample import Sampling, sample_proxy
from sshade.proxy.vertex_maps import sums_by_index
from sshade.regions.handle_regions import HandleRegions


class Placement:
    """Places handles of M on a proxy N, by a function of the handles."""

    def __init__(self, place: Callable[[Handles], Handles]) -> None:
        self._place = place

    def __call__(self, handles: Handles) -> Handles:
        """Return handles of N.

        Raises
        ------
        InputError
            Where the handles cannot be placed on N.
        """
        placed = self._place(handles)
        if handles.prescribed_rotations and not placed.prescribed_rotations:
            raise InputError("no handle with a rotation is a vertex of the proxy; raise the option vertices")
        return placed

    def learn(self, handles: Handles, V: np.ndarray) -> float:
        """Correct later placements for where M' (n, 3) missed the targets; return the largest distance."""
        return 0.0

    def forget(self) -> None:
        """End the corrections."""


#: Samples a mesh: ``sample(mesh, regions, seed)``.
Sampler = Callable[[Mesh, HandleRegions, tuple[int, int]], tuple[Sampling, Placement]]


def sample_with_handles(
    mesh: Mesh, regions: HandleRegions, seed: tuple[int, int]
) -> tuple[Sampling, Placement]:
    """Sample M with its handle vertices first, so that they are vertices and handles of N.

    Parameters
    ----------
    mesh : Mesh
    regions : HandleRegions
    seed : (int, int)

    Raises
    ------
    InputError
        See :func:`sshade.proxy.sample.sample_proxy`.
    """
    sampling = sample_proxy(mesh, regions.vertices, first=regions.first, seed=seed, graph=regions.metric)
    number = regions.number[sampling.samples]
    on = np.flatnonzero(number >= 0)
    return sampling, Placement(lambda handles: handles.sampled(number[on], on, mesh.V))


class NearestPlacement(Placement):
    """Places handles of M on the nearest vertices of a proxy N that was sampled for other handles.

    Parameters
    ----------
    mesh, proxy : Mesh
        M and N.
    rest : Handles
        Of M, at rest.

    Attributes
    ----------
    rest : Handles
        Of N, at rest. One handle of N may stand for several handles of M.

    Raises
    ------
    InputError
        When handles are far from the vertices of N; and see :meth:`sshade.Handles.from_positions`.
    """

    def __init__(self, mesh: Mesh, proxy: Mesh, rest: Handles) -> None:
        super().__init__(self._corrected)
        self._mesh, self._proxy = mesh, proxy
        try:
            _, nearest = snap_to_vertices(proxy, mesh.V[rest.index], rest.group)
        except InputError as error:
            raise InputError(
                "the proxy has no vertices near some of these handles, as inside of handle regions; make "
                f"another Deformer for them ({error})"
            ) from error
        self.rest = self._snapped(rest)
        number = numbered(self.rest.index, proxy.n)
        #: The handle of N that stands for each handle of M, and corrections of the targets of N's handles.
        self._stands_for, self._farthest = number[nearest], 2 * self.rest.snapping.distance
        self.forget()

    def forget(self) -> None:
        """Correct no target until the next :meth:`learn`."""
        self._shift = np.zeros((len(self.rest), 3))

    def _corrected(self, handles: Handles) -> Handles:
        """Return handles of N at targets corrected for where the last call missed."""
        snapped = self._snapped(handles)
        return snapped.at(snapped.target + self._shift, snapped.rotation)

    def learn(self, handles: Handles, V: np.ndarray) -> float:
        """Correct the targets on N for the distance of M' (n, 3) from the hard handles' targets.

        The correction is limited to the largest displacement that a rotation of the group can cause.

        Returns
        -------
        float
            The largest distance, in the unit of length.
        """
        missed, number = handles.target - V[handles.index], self._stands_for
        missed[~handles.hard] = 0.0
        count = np.bincount(number)
        self._shift += sums_by_index(number, missed, len(count)) / count[:, None]
        length = np.linalg.norm(self._shift, axis=1)
        self._shift *= (np.minimum(length, self._farthest) / np.where(length > 0, length, 1.0))[:, None]
        return float(np.linalg.norm(missed, axis=1).max())

    def _snapped(self, handles: Handles) -> Handles:
        return Handles.from_positions(
            self._proxy,
            self._mesh.V[handles.index],
            handles.target,
            group=handles.group,
            weight=handles.weight,
            rotation=handles.rotation,
            strict=False,  # a sample of the proxy stands for many vertices
        ).with_portions(self._proxy)
