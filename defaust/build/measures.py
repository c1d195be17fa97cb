"""Measure a case of the benchmark: what its handles ask for, beside the true pose.

A benchmark is sound only if its handles agree with the pose that they were taken from. Three measures show
where they disagree. The first is the distance by which the true pose moves static handles. The second is the
angle between the rotation of a landmark's handles and the rotation of the surface around the landmark. The
third is the list of static landmarks that contradict a dynamic landmark nearby.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from defaust.build.handles import DYNAMIC, STATIC
from sshade import Mesh
from sshade.mesh.adjacency import VertexGraph, vertex_graph
from sshade.mesh.rigid import rigid_motion, rigidly_moved
from sshade.problem.snapping import vertices_in
from sshade.proxy.fronts import Fronts

#: Radius of the surroundings of a landmark along the edges, as a fraction of the square root of the area:
#: about 0.3 m on a body.
SURROUNDINGS = 0.22
#: Largest distance along the edges between a static and a dynamic landmark that are compared, as a fraction
#: of the diagonal: about 0.3 m on a body.
NEARBY = 0.15
#: Smallest contradiction that is reported, as a fraction of the diagonal: about 4 cm on a body.
CONTRADICTION = 0.02
#: Decimals of stored fractions and of stored angles in degrees. Last bits of fitted rotations depend on the
#: processor, and dataset.json does not.
FRACTION, ANGLE = 6, 4


@dataclass(frozen=True, eq=False)
class _Group:
    """Handles of a landmark.

    Attributes
    ----------
    landmark, kind : str
    index : (k,) int64
        Vertices of the registered rest mesh.
    source, target : (k, 3) float64
        Positions at rest and in the pose.
    motion : (3, 3) and (3,) float64
        Rotation and translation that fit best.
    distance : (n,) float64
        Distance of each vertex of the mesh from the handles, along the edges.
    """

    landmark: str
    kind: str
    index: np.ndarray
    source: np.ndarray
    target: np.ndarray
    motion: tuple[np.ndarray, np.ndarray]
    distance: np.ndarray


def case_facts(rest: Mesh, posed: Mesh | None, handles: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Measure the handles of a case.

    Parameters
    ----------
    rest : Mesh
        Registered rest mesh.
    posed : Mesh, optional
        Registered target pose; None if it is known in its regions only.
    handles : sequence of mapping
        Entries of a pose file, see :func:`defaust.build.handles.handle_records`.

    Returns
    -------
    dict
        ``moving``: number of handles of dynamic landmarks. ``static_moved``: largest displacement of a static
        handle in the true pose, as a fraction of the diagonal; None without such a handle or without a true
        pose. ``groups``: for each landmark with handles ``landmark``; ``residual``, the root mean square
        distance of the true positions from their best rigid motion, over the root mean square distance
        from their mean; and ``turned``, the angle in degrees between the rotation of that motion and the
        rotation of the surroundings, or None without a true pose. ``contradictions``: see
        :func:`_contradictions`.
    """
    graph = vertex_graph(rest)
    groups = [_group(rest, posed, graph, entry) for entry in handles if entry["kind"] in (STATIC, DYNAMIC)]
    moved = [
        np.linalg.norm(group.target - group.source, axis=1).max() for group in groups if group.kind == STATIC
    ]
    return {
        "moving": sum(len(group.source) for group in groups if group.kind == DYNAMIC),
        "static_moved": _fraction(max(moved), rest) if moved and posed is not None else None,
        "groups": [
            {
                "landmark": group.landmark,
                "residual": _residual(group),
                "turned": None if posed is None else _turned(rest, posed, group),
            }
            for group in groups
        ],
        "contradictions": _contradictions(groups, rest),
    }


def _contradictions(groups: Sequence[_Group], rest: Mesh) -> list[dict[str, Any]]:
    """List static landmarks that contradict a dynamic landmark nearby.

    The rigid motion of the dynamic landmark's handles says where the surface around it goes. If it takes a
    static landmark within :data:`NEARBY` farther than :data:`CONTRADICTION`, the surface between the two
    landmarks must stretch or bend. The task asks for the wrong bend if the static handles truly move.

    Returns
    -------
    list of dict
        ``static`` and ``dynamic`` landmark; ``apart``, their distance along the edges at rest, and
        ``distance``, the mean displacement of the static handles by the motion of the dynamic handles. Both
        distances are fractions of the diagonal.
    """
    found = []
    fixed = [group for group in groups if group.kind == STATIC]
    for moving in (group for group in groups if group.kind == DYNAMIC):
        R, t = moving.motion
        for group in fixed:
            apart = _fraction(moving.distance[group.index].min(), rest)
            taken = group.source @ R.T + t
            distance = _fraction(np.linalg.norm(taken - group.source, axis=1).mean(), rest)
            if apart <= NEARBY and distance > CONTRADICTION:
                pair = {"static": group.landmark, "dynamic": moving.landmark}
                found.append(pair | {"apart": apart, "distance": distance})
    return found


def _fraction(length: float, rest: Mesh) -> float:
    """Return a length as a fraction of the diagonal."""
    return round(float(length) / rest.diagonal, FRACTION)


def _group(rest: Mesh, posed: Mesh | None, graph: VertexGraph, entry: Mapping[str, Any]) -> _Group:
    """Return the handles of an entry; the targets of a region are true positions where they are known."""
    from scipy.spatial import cKDTree

    if "boxes" in entry:
        index = vertices_in(rest.V, entry["boxes"])
        source = rest.V[index]
        moved = rigidly_moved(source, entry["rotation"], entry["translation"])
        target = moved if posed is None else posed.V[index]
    else:
        source, target = np.array(entry["source"]), np.array(entry["target"])
        index = cKDTree(rest.V).query(source)[1]
    motion, distance = rigid_motion(source, target), Fronts(graph, index).distance
    return _Group(entry["landmark"], entry["kind"], index, source, target, motion, distance)


def _residual(group: _Group) -> float:
    """Return the residual of a group's rigid motion over the extent of the group."""
    R, t = group.motion
    extent = np.sqrt(((group.source - group.source.mean(axis=0)) ** 2).sum(axis=1).mean())
    missed = np.sqrt(((group.source @ R.T + t - group.target) ** 2).sum(axis=1).mean())
    return round(float(missed / extent), FRACTION) if extent > 0 else 0.0


def _turned(rest: Mesh, posed: Mesh, group: _Group) -> float:
    """Return the angle in degrees between the rotations of a group and of its surroundings."""
    from scipy.spatial.transform import Rotation

    near = group.distance <= SURROUNDINGS * np.sqrt(rest.area)
    R, _ = rigid_motion(rest.V[near], posed.V[near], weights=rest.vertex_areas[near])
    return round(float(np.degrees(Rotation.from_matrix(group.motion[0] @ R.T).magnitude())), ANGLE)
