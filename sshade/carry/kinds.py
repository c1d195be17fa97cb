"""The kinds of frames by the names that users give them."""

from __future__ import annotations

from typing import Literal

import numpy as np

from sshade.carry.affine import AffineFrames
from sshade.carry.blended import BlendedFrames
from sshade.carry.frames import FrameMaker
from sshade.carry.triangle import triangle_frames
from sshade.errors import InputError
from sshade.mesh.mesh import Mesh

FrameKind = Literal["triangle", "affine", "blended", "blended_affine"]


def frame_maker(
    frames: FrameKind | FrameMaker, mesh: Mesh, *, frame_function: str | np.ndarray = "extent"
) -> FrameMaker:
    """What makes the frames of a name.

    Parameters
    ----------
    frames : {"triangle", "affine", "blended", "blended_affine"} or FrameMaker
        The paper's rigid frames of triangles (:mod:`sshade.carry.triangle`); their affine maps
        (:mod:`sshade.carry.affine`); or frames at the proxy's vertices, blended over each triangle,
        that turn, or turn and stretch (:mod:`sshade.carry.blended`). A maker is given back.
    mesh : Mesh
        M.
    frame_function : {"extent", "best", "x", "y", "z"} or (n,) float64
        f of ``triangle`` frames, by name or by its value at each vertex of M; see
        :func:`sshade.carry.triangle.frame_values`.

    Raises
    ------
    InputError
        On an unknown name, or another number of values.
    """
    if not isinstance(frame_function, str) and np.shape(frame_function) != (mesh.n,):
        raise InputError(
            f"a frame function needs {mesh.n} values, one a vertex, not {np.shape(frame_function)}"
        )
    if callable(frames):
        return frames
    makers: dict[str, FrameMaker] = {
        "triangle": triangle_frames(frame_function),
        "affine": lambda proxy, _: AffineFrames(proxy),
        "blended": lambda proxy, _: BlendedFrames(proxy),
        "blended_affine": lambda proxy, _: BlendedFrames(proxy, stretch=True),
    }
    if frames not in makers:
        raise InputError(f"unknown frames {frames!r}; use one of {', '.join(makers)}")
    return makers[frames]
