"""Harmonic and biharmonic deformation fields: the linear reference methods, one linear solve each.

The displacement d of the surface has prescribed values at the handles. Elsewhere it minimises the Dirichlet
energy ``sum |grad d|^2`` (harmonic, L d = 0) or the Laplacian energy ``sum |Delta d|^2`` (biharmonic,
L M^-1 L d = 0 with natural boundary conditions). Both fields are linear in the targets. They do not rotate
details with the surface, and they shrink under large rotations. The harmonic field creases at its handles.

The displacement is relative to the start. The literature starts at the rest shape; a start at the best rigid
motion of the handles also reproduces rigid motions of the whole mesh.

Proof: libigl's own call, which solves the equation as a dense solution does
(tests/baselines/test_arap.py).

A. Jacobson, E. Tosun, O. Sorkine, D. Zorin, "Mixed finite elements for variational surface modeling",
2010 (the discretisation); M. Botsch, L. Kobbelt, "An intuitive framework for real-time freeform modeling",
2004 (the use). libigl's `harmonic` solves.
"""

from __future__ import annotations

import numpy as np

from baselines.arap import require_areas
from baselines.hard_handles import require_hard
from baselines.iteration import start_motion
from baselines.stopwatch import Stopwatch
from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.problem.options import Start
from sshade.problem.task import DeformationResult, DeformationTask


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
        The mesh may have a boundary and several components, each with a handle. No triangle may have zero
        area.
    order : int
        k: 1 for the harmonic, 2 for the biharmonic field.
    start : {"rest", "rigid"}
        Shape that the field displaces: the rest shape, or the best rigid motion of the handles.
    seed : int
        Unused: the method is deterministic.
    progress : Progress

    Returns
    -------
    DeformationResult
        ``iterations`` is 1.

    Raises
    ------
    InputError
        If `order` is neither 1 nor 2, the start is unknown, a handle is soft, a component has no
        handle, or a triangle has zero area.
    FloatingPointError
        If the result is not finite.
    """
    import igl

    if order not in (1, 2):
        raise InputError(f"order={order!r} is no field of this method; use 1, harmonic, or 2, biharmonic")
    mesh, handles = task.mesh, task.handles
    require_hard(handles, "a deformation field")
    mesh.require_handles(handles.index)
    require_areas(mesh)
    watch = Stopwatch()
    R, t = start_motion(task, start)
    base, index = mesh.V @ R.T + t, handles.index
    values = handles.target - base[index]
    field = igl.harmonic(np.array(mesh.V), np.array(mesh.F), np.array(index), values, order)
    vertices = base + field
    vertices[index] = handles.target
    watch.end("solve")
    return DeformationResult(vertices, iterations=1, converged=None, seconds=watch.seconds)
