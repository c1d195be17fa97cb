"""The handles of a task as another kind of handles: single points, landmarks, or whole regions."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, get_args

import numpy as np

from sshade import Handles, InputError, Mesh
from sshade.io.regions import rigidly_moved
from sshade.mesh.adjacency import edge_graph
from sshade.mesh.rigid import rigid_motion
from sshade.sampling.fronts import Fronts, thinned

Kind = Literal["stored", "points", "landmarks", "regions"]

#: A region reaches so far from the first of its landmark, along the edges, x diagonal: a fist or a face. On
#: bodies the true pose of such a patch is a rigid motion but for 0.3 % of the diagonal.
REACH = 0.05
#: Handles that are left of a region where landmarks are asked for: they still tell how it turns.
FEW = 6


def of_kind(mesh: Mesh, handles: Handles, kind: Kind, *, are_regions: bool = False) -> Handles:
    """Other handles that ask for the same pose.

    What moves goes with the best rigid motion of its group, as a hand would pull it; what is
    static stays.

    Parameters
    ----------
    mesh : Mesh
        Rest mesh; every component may have handles or not.
    handles : Handles
        Hard, each group of them one landmark.
    kind : str
        ``stored``: these. ``points``: of each group the vertex nearest to its mean, with its own target; of a
        whole region its tip, the vertex farthest from the mean of the mesh.
        ``landmarks``: these, but of a whole region :data:`FEW`, that vertex and each the farthest along the
        edges from those before it.
        ``regions``: all vertices within :data:`REACH` of that vertex along the edges, each of the
        group that is nearest.
    are_regions : bool
        The groups are whole regions already.

    Raises
    ------
    InputError
        On another kind.
    """
    if kind not in get_args(Kind):
        raise InputError(f"handles={kind} is unknown; use one of {', '.join(get_args(Kind))}")
    if kind in ("stored", "regions" if are_regions else "landmarks"):
        return handles
    groups = [np.flatnonzero(handles.group == group) for group in np.unique(handles.group)]
    centre = mesh.V.mean(axis=0) if are_regions else None
    leading = np.array([_first(mesh.V[handles.index[own]], own, centre) for own in groups])
    if kind == "points":
        return _some(handles, leading)
    if kind == "regions":
        return _regions(mesh, handles, groups, leading)
    graph = edge_graph(mesh)
    few = [
        thinned(graph, handles.index[np.concatenate([[first], own[own != first]])], FEW)
        for first, own in zip(leading, groups, strict=True)
    ]
    return _some(handles, np.flatnonzero(np.isin(handles.index, np.concatenate(few))))


def _first(points: np.ndarray, own: np.ndarray, centre: np.ndarray | None) -> int:
    """The one of a group whose point is nearest to their mean, or farthest from a centre (3,)."""
    if centre is None:
        return int(own[np.linalg.norm(points - points.mean(axis=0), axis=1).argmin()])
    return int(own[np.linalg.norm(points - centre, axis=1).argmax()])


def _some(handles: Handles, chosen: np.ndarray) -> Handles:
    fields = ("index", "target", "dynamic", "group", "snap_distance", "weight")
    return replace(handles, **{name: getattr(handles, name)[chosen] for name in fields})


def _regions(mesh: Mesh, handles: Handles, groups: list[np.ndarray], first: np.ndarray) -> Handles:
    fronts = Fronts(edge_graph(mesh), handles.index[first])
    index = np.flatnonzero(fronts.distance <= REACH * mesh.diagonal)
    of = fronts.cell[index]
    target = mesh.V[index]
    for number, own in enumerate(groups):
        if handles.dynamic[first[number]]:
            motion = rigid_motion(mesh.V[handles.index[own]], handles.target[own])
            target[of == number] = rigidly_moved(target[of == number], *motion)
    dynamic, group = (values[first][of] for values in (handles.dynamic, handles.group))
    return Handles(index, target, dynamic=dynamic, group=group)
