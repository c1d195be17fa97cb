"""Replace the handles of a task by single points, landmarks or whole regions."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, get_args

import numpy as np

from sshade import Handles, InputError, Mesh
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.rigid import rigid_motion, rigidly_moved
from sshade.proxy.fronts import Fronts, thinned

HandleKind = Literal["stored", "points", "landmarks", "regions"]

#: Radius of a region along the edges, as a fraction of the diagonal: about a fist or a face. On bodies of
#: 25,000 vertices the true pose of such a region is rigid up to 1.7 % of the diagonal.
REACH = 0.05
#: Number of handles that replace a region where landmarks are requested. They still determine a rotation.
FEW = 6


def of_kind(mesh: Mesh, handles: Handles, kind: HandleKind, *, are_regions: bool = False) -> Handles:
    """Replace handles by another kind of handles for the same pose.

    Dynamic handles follow the best rigid motion of their group; static handles stay.

    Parameters
    ----------
    mesh : Mesh
        Rest mesh.
    handles : Handles
        Hard handles; each group is a landmark.
    kind : str
        ``stored``: keep the handles. ``points``: the centre of each group, which is the vertex nearest to
        the group's mean; for a region its tip, which is the vertex farthest from the mean of the mesh.
        ``landmarks``: :data:`FEW` vertices of each region, its tip and vertices farthest from each other;
        other handles are kept. ``regions``: all vertices within :data:`REACH` of a centre along the edges,
        assigned to the nearest group.
    are_regions : bool
        The groups are whole regions.

    Raises
    ------
    InputError
        On an unknown kind.
    """
    if kind not in get_args(HandleKind):
        raise InputError(f"handles={kind} is unknown; use one of {', '.join(get_args(HandleKind))}")
    if kind in ("stored", "regions" if are_regions else "landmarks"):
        return handles
    groups = [np.flatnonzero(handles.group == group) for group in np.unique(handles.group)]
    centre = mesh.V.mean(axis=0) if are_regions else None
    leading = np.array([_leading(mesh.V[handles.index[members]], members, centre) for members in groups])
    if kind == "points":
        return _selected(handles, leading)
    if kind == "regions":
        return _regions(mesh, handles, groups, leading)
    graph = vertex_graph(mesh)
    few = [
        thinned(graph, handles.index[np.concatenate([[first], members[members != first]])], FEW)
        for first, members in zip(leading, groups, strict=True)
    ]
    return _selected(handles, np.flatnonzero(np.isin(handles.index, np.concatenate(few))))


def _leading(points: np.ndarray, members: np.ndarray, centre: np.ndarray | None) -> int:
    """Member of a group nearest to the mean of its points (k, 3), or farthest from a centre (3,)."""
    if centre is None:
        return int(members[np.linalg.norm(points - points.mean(axis=0), axis=1).argmin()])
    return int(members[np.linalg.norm(points - centre, axis=1).argmax()])


def _selected(handles: Handles, chosen: np.ndarray) -> Handles:
    return replace(
        handles,
        index=handles.index[chosen],
        target=handles.target[chosen],
        dynamic=handles.dynamic[chosen],
        group=handles.group[chosen],
        weight=handles.weight[chosen],
        snap=handles.snapping._replace(distance=handles.snapping.distance[chosen]),
    )


def _regions(mesh: Mesh, handles: Handles, groups: list[np.ndarray], first: np.ndarray) -> Handles:
    fronts = Fronts(vertex_graph(mesh), handles.index[first])
    index = np.flatnonzero(fronts.distance <= REACH * mesh.diagonal)
    of = fronts.cell[index]
    target = mesh.V[index]
    for number, members in enumerate(groups):
        if handles.dynamic[first[number]]:
            motion = rigid_motion(mesh.V[handles.index[members]], handles.target[members])
            target[of == number] = rigidly_moved(target[of == number], *motion)
    dynamic, group = (values[first][of] for values in (handles.dynamic, handles.group))
    return Handles(index, target, dynamic=dynamic, group=group)
