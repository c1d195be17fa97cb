"""Drags of the editor and of Blender: a Deformer with a small proxy, which takes few iterations a step."""

from __future__ import annotations

import numpy as np

from sshade.core.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.method.bound import Deformer
from sshade.problem.handles import Handles
from sshade.solver.aim import LOCAL, share_at_rest

#: Proxy vertices during a drag, a third of the usual number. With 6000 the shape is a seventh nearer to the
#: converged shape, but a step takes 1.5 times as long.
VERTICES = 4000
#: Tolerance and iterations of a step of a drag; the next step continues. More iterations come nearer to the
#: converged shape with each picture, but show fewer pictures.
TOLERANCE, ITERATIONS = 1e-5, 3
#: Weight of the volume constraint during a drag, which keeps the volume to about a thousandth. In a local
#: edit, where fixed handles have a share `FIXED` of the area more than others, it is free, as when settled.
VOLUME, FIXED = 1e3, sum(LOCAL) / 2
#: Smallest number of mesh vertices for which other handles are bound to the nearest samples. Binding such a
#: mesh anew takes too long; smaller meshes are bound anew, which makes their steps faster.
REBOUND = 500_000


def bound_for_drag(mesh: Mesh, handles: Handles, method: str) -> Deformer:
    """Bind a mesh to handles for a drag that shows a method.

    Raises
    ------
    InputError
        When a component cannot be bound with these handles.
    """
    is_paper = method == "paper"
    local = share_at_rest(mesh, handles.index, ~handles.dynamic) > FIXED
    return Deformer(
        mesh,
        handles.index,
        group=handles.group,
        weight=handles.weight,
        method="paper" if is_paper else "fast",
        samplings=1,
        vertices=VERTICES,
        volume=None if is_paper else 0.0 if local else VOLUME,
    )


def bound_again(deformer: Deformer, handles: Handles, method: str) -> Deformer:
    """Return a Deformer for other handles: a large mesh keeps its proxies, if the handles fit them."""
    if deformer.mesh.n >= REBOUND:
        try:
            deformer.rebind(handles.index, group=handles.group, weight=handles.weight)
            return deformer
        except InputError:  # a handle is too far from the samples, or two groups would share a sample
            pass
    return bound_for_drag(deformer.mesh, handles, method)


def step(deformer: Deformer, handles: Handles) -> np.ndarray:
    """Return positions (n, 3) after a step of a drag to handles at their targets."""
    result = deformer.step(
        handles.target, rotations=handles.rotation, tolerance=TOLERANCE, max_iterations=ITERATIONS
    )
    V, hard = result.vertices, handles.hard
    V[handles.index[hard]] = handles.target[hard]  # handles that were bound later lag slightly
    return V
