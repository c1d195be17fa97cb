"""Where the handles of M are on a proxy N that was sampled for them: at samples."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sshade.core.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.method.regions import HandleRegions
from sshade.problem.handles import Handles
from sshade.proxy.sample import Sampling, sample_proxy


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
