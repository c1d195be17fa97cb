"""The kinds of frames, by the names that users choose them with."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from sshade.core.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.proxy.affine import AffineFrames
from sshade.proxy.blended import BlendedFrames
from sshade.proxy.frames import FrameMaker
from sshade.proxy.triangle import TriangleFrames

FrameKind = Literal["triangle", "affine", "blended", "blended_affine"]


def frame_maker(
    frames: FrameKind | FrameMaker, mesh: Mesh, *, frame_function: str | np.ndarray = "extent"
) -> FrameMaker:
    """Return a function that makes frames of a named kind.

    Parameters
    ----------
    frames : {"triangle", "affine", "blended", "blended_affine"} or FrameMaker
        ``triangle``: the paper's rigid frames (:mod:`sshade.proxy.triangle`). ``affine``: affine maps of
        triangles (:mod:`sshade.proxy.affine`). ``blended`` and ``blended_affine``: frames at the proxy's
        vertices, blended over each triangle, that turn, or turn and stretch (:mod:`sshade.proxy.blended`).
        A function is returned itself.
    mesh : Mesh
        M.
    frame_function : {"extent", "best", "x", "y", "z"} or (n,) float64
        f of ``triangle`` frames, by name or by the value at each vertex of M; see
        :func:`sshade.proxy.triangle.frame_values`.

    Raises
    ------
    InputError
        On an unknown name, or a wrong number of values.
    """
    if not isinstance(frame_function, str):
        frame_function = vertex_values(frame_function, mesh.n)
    if callable(frames):
        return frames

    def triangle(proxy: Mesh, samples: np.ndarray) -> TriangleFrames:
        f = frame_function if isinstance(frame_function, str) else frame_function[samples]
        return TriangleFrames.at_rest(proxy, f)

    makers: dict[str, FrameMaker] = {
        "triangle": triangle,
        "affine": lambda proxy, _: AffineFrames(proxy),
        "blended": lambda proxy, _: BlendedFrames(proxy),
        "blended_affine": lambda proxy, _: BlendedFrames(proxy, stretch=True),
    }
    if frames not in makers:
        raise InputError(f"unknown frames {frames!r}; use one of {', '.join(makers)}")
    return makers[frames]


def vertex_values(frame_function: ArrayLike, n: int) -> np.ndarray:
    """Return the values (n,) of a frame function at the vertices; raise InputError on another shape."""
    values = np.asarray(frame_function)
    if values.shape != (n,):
        raise InputError(f"a frame function needs {n} values, one a vertex, not {values.shape}")
    return values
