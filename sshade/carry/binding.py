"""A mesh bound to a proxy: what carries any deformation of the proxy back to the mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from sshade.carry.frames import FrameMaker, Frames
from sshade.carry.projection import Projection, Projector, project_to_fans
from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.sampling.proxy import Sampling, proxy_mesh
from sshade.threads import ThreadTeam


@dataclass(frozen=True, eq=False)
class Binding:
    """A mesh M bound to a proxy N: M' for any N' of N's connectivity.

    Parameters
    ----------
    mesh : Mesh
        M.
    sampling : Sampling
    proxy : Mesh
        N at rest.
    projection : Projection
        Where each vertex of M lies on N.
    frames : Frames
        Of N at rest.
    local : (n, 3) float64
        Coordinates of M's vertices in the frames.
    seconds : mapping
        Time of the stages ``remesh`` and ``bind``.
    """

    mesh: Mesh
    sampling: Sampling
    proxy: Mesh
    projection: Projection
    frames: Frames
    local: np.ndarray
    seconds: Mapping[str, float]

    def carry(
        self,
        NV: np.ndarray,
        *,
        rotations: np.ndarray | None = None,
        team: ThreadTeam | None = None,
        out: np.ndarray | None = None,
    ) -> tuple[np.ndarray, int]:
        """M' for the vertices of N', and the number of frames that N or N' leaves undefined.

        Parameters
        ----------
        NV : (k, 3) float64
            Vertices of N', in the proxy's numbering.
        rotations : (k, 3, 3) float64, optional
            Of N's vertices to those of N', for ``blended`` frames; by default fitted to the
            edges around each.
        team : ThreadTeam, optional
            Threads that share M's vertices.
        out : (n, 3) float64, C-contiguous, optional
            Where M' goes; by default to a new array.

        Returns
        -------
        V : (n, 3) float64
        degenerate : int

        Raises
        ------
        InputError
            When `NV` or `rotations` do not fit the proxy's vertices, a position is not
            finite, or a matrix is no rotation.
        """
        NV = np.ascontiguousarray(NV, dtype=np.float64)
        if NV.shape != self.proxy.V.shape:
            raise InputError(f"the proxy has vertices of shape {self.proxy.V.shape}, not {NV.shape}")
        if not np.isfinite(NV).all():
            raise InputError("a vertex of the deformed proxy has a NaN or infinite coordinate")
        if rotations is not None and np.shape(rotations) != (self.proxy.n, 3, 3):
            raise InputError(
                f"the proxy needs rotations of shape {(self.proxy.n, 3, 3)}, not {np.shape(rotations)}"
            )
        return self.frames.decode(self.local, NV, on=self.projection, rotations=rotations, team=team, out=out)


def bind_proxy(
    mesh: Mesh, sampling: Sampling, *, frames: FrameMaker, projection: Projector = project_to_fans
) -> Binding:
    """Project M's vertices onto a proxy N and encode them in its frames.

    Parameters
    ----------
    mesh : Mesh
        M: manifold, oriented, one component.
    sampling : Sampling
        N, as a sampling of M.
    frames : callable
        Makes the frames of N; see :data:`sshade.carry.frames.FrameMaker`.
    projection : callable
        P, by default onto the fan around a vertex's sample; see :data:`sshade.carry.projection.Projector`.

    Raises
    ------
    InputError
        Those of `frames`.
    """
    begin = perf_counter()
    proxy = proxy_mesh(mesh, sampling)
    # Far from the origin, rounding would decide between triangles that are equally near.
    V, near = mesh.V, proxy
    if mesh.origin.any():
        V, near = V - mesh.origin, Mesh(proxy.V - mesh.origin, proxy.F)
    on_proxy = projection(V, near, sampling)
    made = frames(proxy, sampling.samples)
    local = made.encode(mesh.V, on_proxy)
    return Binding(mesh, sampling, proxy, on_proxy, made, local, {"bind": perf_counter() - begin})
