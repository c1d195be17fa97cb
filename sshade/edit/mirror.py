"""Mirror images of groups."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sshade.edit.groups import LONGEST, Group
from sshade.errors import InputError
from sshade.io.entries import REST
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import rigid_motion
from sshade.slides import Slide

#: Greatest portion of a group whose mirror image may lie in the group itself.
OVERLAP = 0.25


def mirrored(mesh: Mesh, group: Group, axis: int, *, number: int) -> Group:
    """Mirror a group in the middle plane of the rest shape.

    Parameters
    ----------
    mesh : Mesh
    group : Group
    axis : int
        Coordinate whose sign changes: 0, 1 or 2.
    number : int
        Number of the new group.

    Returns
    -------
    Group
        The vertices nearest to the mirrored vertices, without those of `group`, moved by the mirrored motion.

    Raises
    ------
    InputError
        When the group lies on both sides, the other side has no vertices within the mean length of an edge,
        or the group slides on a surface from a file.
    """
    from scipy.spatial import cKDTree

    middle = 0.5 * (mesh.V.min(axis=0) + mesh.V.max(axis=0))
    S = np.diag(np.where(np.arange(3) == axis, -1.0, 1.0))
    rest, slide = mesh.V[group.vertices], group.slide
    distance, found = cKDTree(mesh.V, balanced_tree=False).query((rest - middle) @ S + middle)
    if np.isin(found, group.vertices).mean() > OVERLAP:
        raise InputError(f"{group.name} lies on both sides of the middle; mirror a group of one side")
    vertices = np.setdiff1d(found[distance <= mesh.mean_edge], group.vertices)
    if len(vertices) == 0:
        raise InputError(f"the mesh has no vertices on the other side of {group.name}")
    if slide is not None and "slide" in slide.record:
        ((kind, value),) = slide.record["slide"].items()
        if kind == "surface" and value != REST:
            raise InputError(f"{group.name} slides on a surface, which has no mirrored surface")
        if kind in ("plane", "line"):
            slide = (Slide.plane if kind == "plane" else Slide.line)(S @ value)
    R, t = rigid_motion(rest, group.target)
    R, t = S @ R @ S, S @ (R @ middle + t - middle) + middle - S @ R @ S @ middle
    still = np.array_equal(group.target, rest)
    return replace(
        group,
        number=number,
        name=f"{group.name[: LONGEST - 9]} mirrored",
        vertices=vertices,
        target=mesh.V[vertices] if still else mesh.V[vertices] @ R.T + t,
        turn=None if group.turn is None else S @ group.turn @ S,
        slide=slide,
    )
