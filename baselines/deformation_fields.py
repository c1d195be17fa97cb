"""Harmonic and biharmonic deformation fields: the linear anchors, one solve each.

The displacement d of the surface takes its prescribed values at the handles and minimises the Dirichlet
energy ``sum |grad d|^2`` (harmonic, L d = 0) or the Laplacian energy ``sum |Delta d|^2`` (biharmonic,
L M^-1 L d = 0, with natural boundary conditions) elsewhere. Being linear, neither turns details with
the surface, and large rotations shrink; the harmonic field has a crease at its handles.

The displacement counts from the start: the rest shape, as in the literature, or the best rigid motion of the
handles, by which a rigid motion of everything is reproduced, too.

A. Jacobson, E. Tosun, O. Sorkine, D. Zorin, "Mixed finite elements for variational surface modeling",
2010 (the discretisation); M. Botsch, L. Kobbelt, "An intuitive framework for real-time freeform modeling",
2004 (the use). libigl's `harmonic` solves.
"""

from __future__ import annotations

from time import perf_counter

import numpy as np

from baselines.start_motion import start_motion
from sshade.errors import InputError
from sshade.progress import Progress, silent
from sshade.solver.options import Start
from sshade.task import DeformationResult, DeformationTask


def deformation_field(
    task: DeformationTask,
    *,
    order: int = 1,
    start: Start = "rest",
    seed: int = 0,
    progress: Progress = silent,
) -> DeformationResult:
    """Move the mesh by a k-harmonic displacement field.

    Parameters
    ----------
    task : DeformationTask
        Its mesh may have a boundary and several components, but no triangle without area.
    order : int
        k: 1 harmonic, 2 biharmonic.
    start : {"rest", "rigid"}
        What is displaced.
    seed : int
        Unused: the method is deterministic.
    progress : Progress

    Returns
    -------
    DeformationResult
        Of one iteration.

    Raises
    ------
    InputError
        On another order than 1 or 2, an unknown start, soft handles, or triangles without area.
    FloatingPointError
        When the result is not finite.
    """
    import igl

    if order not in (1, 2):
        raise InputError(f"order={order!r} is no field of this method; use 1, harmonic, or 2, biharmonic")
    mesh, handles = task.mesh, task.handles
    handles.require_hard("a deformation field")
    flat = int(mesh.without_area.sum())
    if flat:
        raise InputError(f"{flat} triangles of the rest mesh have no area, of which libigl makes NaN")
    begin = perf_counter()
    R, t = start_motion(task, start)
    base, index = mesh.V @ R.T + t, handles.index
    values = handles.target - base[index]
    field = igl.harmonic(np.array(mesh.V), np.array(mesh.F), np.array(index), values, order)
    vertices = base + field
    vertices[index] = handles.target
    return DeformationResult(
        vertices=vertices, iterations=1, converged=None, seconds={"solve": perf_counter() - begin}
    )
