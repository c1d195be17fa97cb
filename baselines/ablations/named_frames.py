"""Frames by name: those of `sshade`, affine ones, and triangle frames with other functions f."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from baselines.ablations.affine_frames import AffineFrames, StretchingFrames
from sshade.core.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.proxy.frames import FrameMaker
from sshade.proxy.triangle import TriangleFrames, frame_values

FrameName = Literal["triangle", "affine", "blended", "blended_affine"]
FunctionName = Literal["extent", "best", "x", "y", "z"]


def steepest_values(proxy: Mesh) -> np.ndarray:
    """Return f (l, 3) at the corners of triangles of N: the coordinate with the largest tangential gradient.

    Along axis c the gradient has length sqrt(1 - n_c^2), so the largest is at least sqrt(2/3).
    """
    steepest = np.argmin(np.abs(proxy.face_normals), axis=1)
    return np.take_along_axis(proxy.V[proxy.F], steepest[:, None, None], axis=2)[:, :, 0]


#: Values of the option `frames` of `sshade`, by the names of frames and function.
FRAMES: Mapping[tuple[str, str], str | FrameMaker] = {
    ("triangle", "extent"): "triangle",
    ("blended", "extent"): "blended",
    ("affine", "extent"): lambda proxy, _: AffineFrames(proxy),
    ("blended_affine", "extent"): lambda proxy, _: StretchingFrames(proxy),
    ("triangle", "best"): lambda proxy, _: TriangleFrames.of_values(proxy, steepest_values(proxy)),
    ("triangle", "x"): lambda proxy, _: TriangleFrames.of_values(proxy, frame_values(proxy, 0)),
    ("triangle", "y"): lambda proxy, _: TriangleFrames.of_values(proxy, frame_values(proxy, 1)),
    ("triangle", "z"): lambda proxy, _: TriangleFrames.of_values(proxy, frame_values(proxy, 2)),
}


def named_frames(frames: FrameName, function: FunctionName = "extent") -> str | FrameMaker:
    """Return the value of the option `frames` of `sshade` for named frames.

    Parameters
    ----------
    frames : {"triangle", "affine", "blended", "blended_affine"}
        Rigid frames of triangles as in the paper, affine maps of triangles, or frames at vertices that turn,
        or turn and stretch.
    function : {"extent", "best", "x", "y", "z"}
        f of triangle frames: the coordinate of largest extent, on each triangle the
        coordinate with the largest tangential gradient, or a coordinate. All other frames have none.

    Raises
    ------
    InputError
        On unknown names, or names that do not fit together.
    """
    found = FRAMES.get((frames, function))
    if found is None:
        known = ", ".join(map(" ".join, FRAMES))
        raise InputError(f"there are no frames {frames!r} with the function {function!r}; there are {known}")
    return found
