"""A mesh tied to a proxy: what carries any deformation of the proxy back to the mesh."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any, Literal, cast, get_args

import numpy as np

from sshade.carry.affine import AffineFrames
from sshade.carry.blended import BlendedFrames
from sshade.carry.frames import FrameKind, Frames, TriangleFrames, frame_values
from sshade.carry.projection import Projection, project_to_fans, project_to_surface
from sshade.errors import InputError
from sshade.io.files import reason
from sshade.mesh.adjacency import VertexGraph
from sshade.mesh.mesh import Mesh
from sshade.sampling.remesh import Remesh, proxy_mesh, remesh


@dataclass(frozen=True, eq=False)
class Binding:
    """A mesh M tied to a proxy N: what carries any deformation of N back to M.

    Parameters
    ----------
    mesh : Mesh
        M.
    remesh : Remesh
    proxy : Mesh
        N at rest.
    projection : Projection
        Where each vertex of M lies on N.
    values : (l, 3) float64
        f at the corners of N's triangles, which directs ``triangle`` frames.
    kind : {"triangle", "affine", "blended", "blended_affine"}
        Of the frames.
    frames : Frames
        Made of N at rest.
    local : (n, 3) float64
        Coordinates of M's vertices in the frames.
    seconds : mapping
        Time of the stages ``remesh`` and ``bind``.
    """

    mesh: Mesh
    remesh: Remesh
    proxy: Mesh
    projection: Projection
    values: np.ndarray
    kind: FrameKind
    frames: Frames
    local: np.ndarray
    seconds: Mapping[str, float]

    def carry(self, NV: np.ndarray, *, rotations: np.ndarray | None = None) -> tuple[np.ndarray, int]:
        """M' for the vertices of N', and the number of frames that N and N' leave open.

        Parameters
        ----------
        NV : (k, 3) float64
            Vertices of N', in the proxy's numbering.
        rotations : (k, 3, 3) float64, optional
            How each of them is turned, for ``blended`` frames; fitted to the
            edges around it where not given.

        Returns
        -------
        V : (n, 3) float64
        degenerate : int

        Raises
        ------
        InputError
            When `NV` or `rotations` do not fit the proxy's vertices, a position is not
            finite, or a rotation is none.
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
        return self.frames.decode(self.local, NV, on=self.projection, rotations=rotations)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write what :meth:`load` needs besides the mesh, as an .npz."""
        with open(path, "wb") as file:
            np.savez(
                file,
                vertices=len(self.local),
                mesh=_digest(self.mesh.F),
                samples=self.remesh.samples,
                faces=self.remesh.faces,
                region=self.remesh.region,
                distance=self.remesh.distance,
                face=self.projection.face,
                barycentric=self.projection.barycentric,
                to_proxy=self.projection.distance,
                values=self.values,
                frames=self.kind,
            )

    @classmethod
    def load(cls, path: str | os.PathLike[str], mesh: Mesh, *, frames: FrameKind | None = None) -> Binding:
        """Read a binding written by :meth:`save`, for the mesh that it was made of.

        Parameters
        ----------
        path : path
        mesh : Mesh
        frames : {"triangle", "affine", "blended", "blended_affine"}, optional
            Instead of the kind that the binding was saved with.

        Raises
        ------
        InputError
            When the file is unreadable, incomplete, or of a mesh with other counts.
        """
        arrays = _arrays_of_a_map(path)
        try:
            if arrays["vertices"] != mesh.n or arrays["samples"].max() >= mesh.n:
                raise InputError(
                    f"the map is of a mesh with {arrays['vertices']} vertices, this one has {mesh.n}"
                )
            if str(arrays["mesh"]) != _digest(mesh.F):
                raise InputError("the map is of a mesh with other faces; remesh this one")
            remeshed = Remesh(*(arrays[name] for name in ("samples", "faces", "region", "distance")))
            on_proxy = Projection(*(arrays[name] for name in ("face", "barycentric", "to_proxy")))
            values, saved = arrays["values"], str(arrays["frames"])
            _require_fit(remeshed, on_proxy, values, saved, mesh.n)
            proxy = proxy_mesh(mesh, remeshed)
            kind = frames or cast(FrameKind, saved)  # one of them, as was checked
            made = make_frames(kind, proxy, values=values)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise _no_map(path, error) from error
        local = made.encode(mesh.V, on_proxy)
        return cls(mesh, remeshed, proxy, on_proxy, values, kind, made, local, {})


def make_frames(kind: FrameKind, proxy: Mesh, *, values: np.ndarray) -> Frames:
    """Frames of a proxy at rest, as of :func:`bind`; `values` from :func:`frame_values`."""
    if kind == "triangle":
        return TriangleFrames.of_values(proxy, values)
    if kind == "affine":
        return AffineFrames(proxy)
    return BlendedFrames.at_rest(proxy, stretch=kind == "blended_affine")


def _arrays_of_a_map(path: str | os.PathLike[str]) -> dict[str, Any]:
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as data:
            return {name: data[name] for name in data.files}
    except Exception as error:  # zipfile and numpy fail in many ways, all of them the file's fault
        raise _no_map(path, error) from error


def _no_map(path: str | os.PathLike[str], error: Exception) -> InputError:
    why = " ".join(str(reason(error) if isinstance(error, OSError) else error).split())
    return InputError(f"{path}: not a map written by `sshade remesh` ({why})")


def _digest(F: np.ndarray) -> str:
    return hashlib.sha256(F.tobytes()).hexdigest()


def _require_fit(remeshed: Remesh, on_proxy: Projection, values: np.ndarray, kind: str, n: int) -> None:
    """Raise ValueError unless the arrays of a map fit together: kernels would read out of bounds."""
    k, faces = len(remeshed.samples), len(remeshed.faces)
    ids: list[tuple[np.ndarray, tuple[int, ...], int]] = [
        (remeshed.samples, (k,), n),
        (remeshed.faces, (faces, 3), k),
    ]
    ids += [(remeshed.region, (n,), k), (on_proxy.face, (n,), faces)]
    reals: list[tuple[np.ndarray, tuple[int, ...]]] = [(remeshed.distance, (n,)), (on_proxy.distance, (n,))]
    reals += [(on_proxy.barycentric, (n, 3)), (values, (faces, 3))]
    for array, shape, end in ids:
        if array.shape != shape or array.dtype.kind != "i" or array.min() < 0 or array.max() >= end:
            raise ValueError("its arrays do not fit together")
    for array, shape in reals:
        if array.shape != shape or array.dtype != np.float64 or not np.isfinite(array).all():
            raise ValueError("its arrays do not fit together")
    if kind not in get_args(FrameKind):
        raise ValueError(f"unknown frames {kind!r}")


def bind(
    mesh: Mesh,
    vertices: int = 6000,
    *,
    first: np.ndarray | None = None,
    seed: int | tuple[int, ...] = 0,
    projection: Literal["fan", "surface"] = "fan",
    frames: FrameKind = "triangle",
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
    frames : {"triangle", "affine", "blended", "blended_affine"}
        How M's vertices follow N: with the rigid frames of its triangles, as in
        the paper (:mod:`sshade.carry.frames`); with the triangles' affine maps
        (:mod:`sshade.carry.affine`); or with frames at the vertices of N, blended
        over each triangle, which turn, or turn and stretch (:mod:`sshade.carry.blended`).
    frame_function : {"extent", "best", "x", "y", "z"} or (n,) float64
        f, which directs ``triangle`` frames; an array gives its value at each vertex of M.
    graph : VertexGraph, optional
        The mesh's :func:`sshade.mesh.adjacency.vertex_graph`, where several bindings share it.

    Raises
    ------
    InputError
        See :func:`sshade.sampling.remesh.remesh` and :func:`sshade.carry.frames.frame_values`.
    """
    require_binding(mesh, projection=projection, frames=frames, frame_function=frame_function)
    begin = perf_counter()
    remeshed = remesh(mesh, vertices, first=first, seed=seed, graph=graph)
    seconds = perf_counter() - begin
    binding = bind_proxy(mesh, remeshed, projection=projection, frames=frames, frame_function=frame_function)
    return replace(binding, seconds={"remesh": seconds, **binding.seconds})


def bind_proxy(
    mesh: Mesh,
    remeshed: Remesh,
    *,
    projection: Literal["fan", "surface"] = "fan",
    frames: FrameKind = "triangle",
    frame_function: str | np.ndarray = "extent",
) -> Binding:
    """Encode M's vertices in the frames of a proxy N: what :func:`bind` does with a remesh.

    Parameters and errors as there.
    """
    require_binding(mesh, projection=projection, frames=frames, frame_function=frame_function)
    begin = perf_counter()
    proxy = proxy_mesh(mesh, remeshed)
    # Far from the origin, rounding would decide between triangles that are equally near.
    V, near = mesh.V, proxy
    if mesh.origin.any():
        V, near = V - mesh.origin, Mesh(proxy.V - mesh.origin, proxy.F)
    on_proxy = (
        project_to_fans(V, near, remeshed.region) if projection == "fan" else project_to_surface(V, near)
    )
    if not isinstance(frame_function, str):
        frame_function = np.asarray(frame_function)[remeshed.samples]
    values = frame_values(proxy, frame_function)
    made = make_frames(frames, proxy, values=values)
    local = made.encode(mesh.V, on_proxy)
    seconds = {"bind": perf_counter() - begin}
    return Binding(mesh, remeshed, proxy, on_proxy, values, frames, made, local, seconds)


def require_binding(mesh: Mesh, *, projection: str, frames: str, frame_function: str | np.ndarray) -> None:
    """Raise InputError on parameters of :func:`bind` that no proxy makes right."""
    if projection not in ("fan", "surface"):
        raise InputError(f"unknown projection {projection!r}; use 'fan' or 'surface'")
    if frames not in get_args(FrameKind):
        raise InputError(f"unknown frames {frames!r}; use one of {', '.join(get_args(FrameKind))}")
    if not isinstance(frame_function, str) and np.shape(frame_function) != (mesh.n,):
        raise InputError(
            f"a frame function needs {mesh.n} values, one a vertex, not {np.shape(frame_function)}"
        )
