"""Open3D's ARAP as it is shipped: what many users call first.

Spokes with cotangents raised to zero or, as "smoothed", with its smoothness of rotations; a fixed number of
iterations from the rest shape, which no residual ends. Nothing is changed; positions are double there, too.

Q.-Y. Zhou, J. Park, V. Koltun, "Open3D: a modern library for 3D data processing", 2018.
"""

from __future__ import annotations

from time import perf_counter
from typing import Literal, get_args

import numpy as np

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
        Open3D asks nothing of its mesh, and says nothing where the result is poor.
    energy : {"spokes", "smoothed"}
    smoothed_alpha : float
        Open3D's weight of "smoothed".
    iterations : int
        Above 0. 50 is what Open3D's tutorial takes.
    seed : int
        Unused: the method is deterministic.
    progress : Progress
        Unused.

    Returns
    -------
    DeformationResult
        ``converged`` is None: it tells no residual.

    Raises
    ------
    ImportError
        When open3d is not installed.
    InputError
        On an unknown energy, no iterations, or soft handles.
    FloatingPointError
        When the result is not finite.
    """
    try:
        import open3d
    except ImportError as error:
        raise ImportError("open3d_arap needs Open3D; pip install 'sshade[open3d]'") from error
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

    def deformed(count: int) -> np.ndarray:
        with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
            result = shape.deform_as_rigid_as_possible(index, target, count, kind, smoothed_alpha)
        return np.array(result.vertices)

    begin = perf_counter()
    V = deformed(iterations)
    return DeformationResult(
        vertices=V, iterations=iterations, converged=None, seconds={"solve": perf_counter() - begin}
    )
