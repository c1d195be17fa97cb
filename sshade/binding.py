"""A mesh tied to a proxy: what carries any deformation of the proxy back to the mesh."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from time import perf_counter
from typing import Literal
from zipfile import BadZipFile

import numpy as np

from sshade.errors import InputError
from sshade.frames import TriangleFrames
from sshade.graph import VertexGraph
from sshade.mesh import Mesh
from sshade.projection import Projection, project_to_fans, project_to_surface
from sshade.remesh import Remesh, proxy_mesh, remesh


@dataclass(frozen=True, eq=False)
class Binding:
    """A mesh M tied to a proxy N: what carries any deformation of N back to M.

    Parameters
    ----------
    remesh : Remesh
    proxy : Mesh
        N at rest.
    projection : Projection
        Where each vertex of M lies on N.
    frames : TriangleFrames
        L_t and b_t on N.
    local : (n, 3) float64
        Coordinates of M's vertices in the frames of their triangles.
    seconds : mapping
        Time of the stages ``remesh`` and ``bind``.
    """

    remesh: Remesh
    proxy: Mesh
    projection: Projection
    frames: TriangleFrames
    local: np.ndarray
    seconds: Mapping[str, float]

    def carry(self, NV: np.ndarray) -> tuple[np.ndarray, int]:
        """M' for the vertices of N', and the number of triangles without a frame of their own.

        Parameters
        ----------
        NV : (k, 3) float64
            Vertices of N', in the proxy's numbering.

        Returns
        -------
        V : (n, 3) float64
        degenerate : int

        Raises
        ------
        InputError
            When `NV` has another shape than the proxy's vertices.
        """
        NV = np.ascontiguousarray(NV, dtype=np.float64)
        if NV.shape != self.proxy.V.shape:
            raise InputError(f"the proxy has vertices of shape {self.proxy.V.shape}, not {NV.shape}")
        return self.frames.decode(self.local, self.projection.face, NV)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write what :meth:`load` needs besides the mesh, as an .npz."""
        with open(path, "wb") as file:
            np.savez(
                file,
                vertices=len(self.local),
                samples=self.remesh.samples,
                faces=self.remesh.faces,
                region=self.remesh.region,
                distance=self.remesh.distance,
                face=self.projection.face,
                barycentric=self.projection.barycentric,
                to_proxy=self.projection.distance,
                values=self.frames.values,
            )

    @classmethod
    def load(cls, path: str | os.PathLike[str], mesh: Mesh) -> Binding:
        """Read a binding written by :meth:`save`, for the mesh that it was made of.

        Raises
        ------
        InputError
            When the file is unreadable, incomplete, or of a mesh with other counts.
        """
        try:
            with np.load(path) as data:
                arrays = {name: data[name] for name in data.files}
            if arrays["vertices"] != mesh.n or arrays["samples"].max() >= mesh.n:
                raise InputError(
                    f"the map is of a mesh with {arrays['vertices']} vertices, this one has {mesh.n}"
                )
            remeshed = Remesh(*(arrays[name] for name in ("samples", "faces", "region", "distance")))
            on_proxy = Projection(*(arrays[name] for name in ("face", "barycentric", "to_proxy")))
            _require_fit(remeshed, on_proxy, arrays["values"], mesh.n)
            proxy = proxy_mesh(mesh, remeshed)
            frames = TriangleFrames.of_values(proxy, arrays["values"])
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        except (OSError, KeyError, IndexError, TypeError, ValueError, EOFError, BadZipFile) as error:
            raise InputError(f"{path}: not a map written by `sshade remesh` ({error})") from error
        return cls(remeshed, proxy, on_proxy, frames, frames.encode(mesh.V, on_proxy.face), {})


def _require_fit(remeshed: Remesh, on_proxy: Projection, values: np.ndarray, n: int) -> None:
    """Raise ValueError unless the arrays of a map fit together: kernels would read out of bounds."""
    k, faces = len(remeshed.samples), len(remeshed.faces)
    for ids, end in ((remeshed.region, k), (on_proxy.face, faces)):
        if ids.shape != (n,) or ids.min() < 0 or ids.max() >= end:
            raise ValueError("its arrays do not fit together")
    if values.shape != (faces, 3) or remeshed.samples.min() < 0:
        raise ValueError("its arrays do not fit together")


def bind(
    mesh: Mesh,
    vertices: int = 6000,
    *,
    first: np.ndarray | None = None,
    seed: int | tuple[int, ...] = 0,
    projection: Literal["fan", "surface"] = "fan",
    frame_function: str | np.ndarray = "extent",
    graph: VertexGraph | None = None,
) -> Binding:
    """Remesh M to a proxy N and encode M's vertices in N's frames.

    Parameters
    ----------
    mesh : Mesh
        M: manifold, oriented, one component.
    vertices : int
        Proxy vertices, before refinement adds the few that the topology needs.
    first : (h,) int, optional
        Vertices of M that become the first ones of N.
    seed : int or tuple of int
        Chooses the random vertex that follows them.
    projection : {"fan", "surface"}
        P, or ReMatching's U.
    frame_function : {"extent", "best", "x", "y", "z"} or (n,) float64
        f; an array gives its value at each vertex of M.
    graph : VertexGraph, optional
        The mesh's :func:`sshade.graph.vertex_graph`, where several bindings share it.

    Raises
    ------
    InputError
        See :func:`sshade.remesh.remesh` and :func:`sshade.frames.frame_values`.
    """
    if projection not in ("fan", "surface"):
        raise InputError(f"unknown projection {projection!r}; use 'fan' or 'surface'")
    begin = perf_counter()
    remeshed = remesh(mesh, vertices, first=first, seed=seed, graph=graph)
    proxy = proxy_mesh(mesh, remeshed)
    sampled = perf_counter()
    if projection == "fan":
        on_proxy = project_to_fans(mesh.V, proxy, remeshed.region)
    else:
        on_proxy = project_to_surface(mesh.V, proxy)
    if not isinstance(frame_function, str):
        frame_function = np.asarray(frame_function)
        if frame_function.shape != (mesh.n,):
            raise InputError(
                f"a frame function needs {mesh.n} values, one a vertex, not {frame_function.shape}"
            )
        frame_function = frame_function[remeshed.samples]
    frames = TriangleFrames.at_rest(proxy, frame_function)
    local = frames.encode(mesh.V, on_proxy.face)
    seconds = {"remesh": sampled - begin, "bind": perf_counter() - sampled}
    return Binding(remeshed, proxy, on_proxy, frames, local, seconds)
