"""The binding of a mesh to its proxy by frames: prolongs any deformation of the proxy to the mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from time import perf_counter
from typing import Literal

import numpy as np

from sshade.core.errors import InputError
from sshade.core.threads import ThreadTeam
from sshade.mesh.mesh import Mesh
from sshade.proxy.blended import BlendedFrames
from sshade.proxy.frames import FrameMaker, Frames, checked_out
from sshade.proxy.projection import Projection, Projector, project_to_fans
from sshade.proxy.sample import Sampling, proxy_mesh
from sshade.proxy.triangle import TriangleFrames

FrameKind = Literal["triangle", "blended"]


def frame_maker(frames: FrameKind | FrameMaker) -> FrameMaker:
    """Return a function that makes frames of a named kind.

    Parameters
    ----------
    frames : {"triangle", "blended"} or FrameMaker
        ``triangle``: the paper's rigid frames (:mod:`sshade.proxy.triangle`). ``blended``: frames at the
        proxy's vertices, blended over each triangle (:mod:`sshade.proxy.blended`). A function is returned
        itself.

    Raises
    ------
    InputError
        On an unknown name.
    """
    if callable(frames):
        return frames
    makers: dict[str, FrameMaker] = {
        "triangle": lambda proxy, _: TriangleFrames.at_rest(proxy),
        "blended": lambda proxy, _: BlendedFrames(proxy),
    }
    if frames not in makers:
        raise InputError(f"unknown frames {frames!r}; use one of {', '.join(makers)}")
    return makers[frames]


@dataclass(frozen=True, eq=False)
class Binding:
    """A mesh M bound to a proxy N: gives M' for any deformed N'.

    Parameters
    ----------
    mesh : Mesh
        M.
    sampling : Sampling
        Samples of M, their cells, and the faces of N.
    proxy : Mesh
        N at rest.
    projection : Projection
        Projection of each vertex of M onto N.
    frames : Frames
        Frames of N at rest.
    local : (n, 3) float64
        Coordinates of M's vertices in the frames.
    seconds : mapping
        Wall-clock seconds of the stages ``remesh`` and ``bind``.
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
        """Return the vertices of M' for the vertices of N'.

        Parameters
        ----------
        NV : (k, 3) float64
            Vertices of N', in the proxy's numbering and the mesh's unit.
        rotations : (k, 3, 3) float64, optional
            Rotations of N's vertices, for ``blended`` frames; all other frames ignore them. By default they
            are fitted to the edges around each vertex.
        team : ThreadTeam, optional
            Threads that divide M's vertices; by default the calling thread alone.
        out : (n, 3) float64, C-contiguous, optional
            Array for M'; by default a new one.

        Returns
        -------
        V : (n, 3) float64
            Vertices of M'.
        degenerate : int
            Number of frames that N or N' leaves undefined. Neighbouring frames replace them.

        Raises
        ------
        InputError
            If the shapes of `NV` or `rotations` do not match the proxy, a position is not finite, a matrix
            for ``blended`` frames is not a rotation, or `out` is another array.
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
        out = checked_out(out, self.local.shape)
        return self.frames.decode(self.local, NV, on=self.projection, rotations=rotations, team=team, out=out)

    def prolong(self, values: np.ndarray) -> np.ndarray:
        """Return a function on M from its values on N, by the map U of the paper.

        Each vertex of M gets the value of the piecewise linear function at its projection onto N. Use
        it for weights, colours or eigenfunctions, which are cheap to compute on N.

        Parameters
        ----------
        values : (k,) or (k, d) array of numbers
            Values at N's vertices, in the proxy's numbering.

        Returns
        -------
        (n,) or (n, d) float64
            Values at M's vertices.

        Raises
        ------
        InputError
            If `values` has another shape.
        """
        values = np.asarray(values, dtype=np.float64)
        if values.ndim not in (1, 2) or len(values) != self.proxy.n:
            raise InputError(
                f"the proxy has {self.proxy.n} vertices, but the values have shape {values.shape}"
            )
        on = self.projection
        return np.einsum("nc,nc...->n...", on.barycentric, values[self.proxy.F[on.face]])


def bind_proxy(
    mesh: Mesh, sampling: Sampling, *, frames: FrameMaker, projection: Projector = project_to_fans
) -> Binding:
    """Project the vertices of M onto a proxy N and encode them in its frames.

    Parameters
    ----------
    mesh : Mesh
        M: manifold, oriented, one component.
    sampling : Sampling
        N, as a sampling of M.
    frames : callable
        Makes the frames of N; see :data:`sshade.proxy.frames.FrameMaker`.
    projection : callable
        P; by default onto the triangles around each vertex's sample. See
        :data:`sshade.proxy.projection.Projector`.

    Raises
    ------
    InputError
        As `frames`.
    """
    begin = perf_counter()
    proxy = proxy_mesh(mesh, sampling)
    # Far from the origin, rounding would choose among triangles at equal distance.
    V, near = mesh.V, proxy
    if mesh.origin.any():
        V, near = V - mesh.origin, Mesh(proxy.V - mesh.origin, proxy.F)
    on_proxy = projection(V, near, sampling)
    at_rest = frames(proxy, sampling.samples)
    local = at_rest.encode(mesh.V, on_proxy)
    return Binding(mesh, sampling, proxy, on_proxy, at_rest, local, {"bind": perf_counter() - begin})
