"""Open3D's ARAP, unchanged.

The energy is spokes ARAP with negative cotangents replaced by zero; "smoothed" adds Open3D's smoothness of
rotations. Open3D runs a fixed number of iterations from the rest shape, in double precision.

Q.-Y. Zhou, J. Park, V. Koltun, "Open3D: a modern library for 3D data processing", 2018.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from baselines.stopwatch import Stopwatch
from sshade.errors import InputError
from sshade.progress import Progress, silent
from sshade.task import DeformationResult, DeformationTask

Kind = Literal["spokes", "smoothed"]


def open3d_arap(
    task: DeformationTask,
    *,
    energy: Kind = "spokes",
    smoothed_alpha: float = 0.01,
    iterations: int = 50,
    seed: int = 0,
    progress: Progress = silent,
) -> DeformationResult:
    """Deform with Open3D's ``TriangleMesh.deform_as_rigid_as_possible``.

    Parameters
    ----------
    task : DeformationTask
        Open3D accepts any mesh and does not report poor results.
    energy : {"spokes", "smoothed"}
    smoothed_alpha : float
        Open3D's weight of the rotation smoothness. Only "smoothed" uses it.
    iterations : int
        Number of iterations, at least 1. Open3D's tutorial uses 50.
    seed : int
        Unused: the method is deterministic.
    progress : Progress
        Unused.

    Returns
    -------
    DeformationResult
        ``converged`` is None, because Open3D reports no residual.

    Raises
    ------
    ImportError
        If open3d is not installed.
    InputError
        If the energy is unknown, `iterations` is below 1, or a handle is soft.
    FloatingPointError
        If the result is not finite.
    """
    import open3d

    if energy not in get_args(Kind) or iterations < 1:
        raise InputError(
            f"energy={energy!r} and iterations={iterations!r}: the first must be 'spokes' or 'smoothed', the "
            "second 1 or more"
        )
    mesh, handles = task.mesh, task.handles
    handles.require_hard("Open3D's ARAP")
    kind = getattr(open3d.geometry.DeformAsRigidAsPossibleEnergy, energy.capitalize())
    shape = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(np.array(mesh.V)),
        open3d.utility.Vector3iVector(mesh.F.astype(np.int32)),
    )
    index = open3d.utility.IntVector(handles.index.astype(np.int32))
    target = open3d.utility.Vector3dVector(np.array(handles.target))

    watch = Stopwatch()
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        moved = shape.deform_as_rigid_as_possible(index, target, iterations, kind, smoothed_alpha)
    V = np.array(moved.vertices)
    watch.end("solve")
    return DeformationResult(V, iterations, converged=None, seconds=watch.seconds)
