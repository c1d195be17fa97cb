"""Choose handles near landmarks, and classify landmarks as static or dynamic."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from defaust.build.options import BuildOptions
from defaust.sources.source import SourcePose
from sshade import InputError, Mesh
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.rigid import rigidly_moved
from sshade.problem.snapping import vertices_in

STATIC, DYNAMIC, UNUSED = "static", "dynamic", "unused"


def nearest_vertices(mesh: Mesh, vertex: int, *, count: int) -> np.ndarray:
    """Find the vertices nearest to a vertex along the edges (Dijkstra, Euclidean lengths).

    Returns
    -------
    (count,) int64
        In order of distance, `vertex` first; equal distances by vertex id.

    Raises
    ------
    InputError
        When fewer vertices can be reached.
    """
    from scipy.sparse.csgraph import dijkstra

    distance = dijkstra(vertex_graph(mesh).matrix, indices=vertex)
    nearest = np.argsort(distance, kind="stable")[:count]
    if len(nearest) < count or not np.isfinite(distance[nearest[-1]]):
        raise InputError(
            f"only {int(np.isfinite(distance).sum())} vertices can be reached from vertex {vertex}, "
            f"and the neighbourhood of a landmark needs {count}; use a smaller neighbourhood"
        )
    return nearest


def choose_handles(
    mesh: Mesh, landmarks: Mapping[str, int], *, subject: int, options: BuildOptions
) -> dict[str, np.ndarray]:
    """Draw random vertices near each landmark (H_l of the paper). No two landmarks share a vertex.

    Every pose of a subject uses the same handles. They depend on the subject, the seed and the order of the
    landmarks.

    Parameters
    ----------
    mesh : Mesh
        Registered rest mesh.
    landmarks : mapping
        Vertex of each landmark.
    subject : int
    options : BuildOptions
        The seed, the number of handles, and the number of nearest vertices that they are drawn from.

    Returns
    -------
    dict of (handles_per_landmark,) int64, ascending

    Raises
    ------
    InputError
        When landmarks are too close to each other, so that too few vertices are left.
    """
    taken = np.zeros(mesh.n, dtype=bool)
    chosen, count = {}, options.handles_per_landmark
    for number, (name, vertex) in enumerate(landmarks.items()):
        near = nearest_vertices(mesh, vertex, count=options.neighbourhood)
        free = near[~taken[near]]
        if len(free) < count:
            raise InputError(
                f"landmark {name!r} has {len(free)} vertices left that no other landmark took, "
                f"and needs {count}; use fewer landmarks or a larger neighbourhood"
            )
        rng = np.random.default_rng([options.seed, subject, number])
        chosen[name] = np.sort(rng.choice(free, size=count, replace=False))
        taken[chosen[name]] = True
    return chosen


def displacement(
    source: np.ndarray, target: np.ndarray, *, diagonal: float, static_below: float
) -> dict[str, Any]:
    """Compute the kind of a landmark, Delta_l = sum over H_l of |v - pi(v)| (``delta``), and ``delta_mean``.

    Parameters
    ----------
    source, target : (k, 3) float64
        Rest and posed positions of a landmark's handles.
    diagonal : float
        Diagonal of the rest mesh's bounding box.
    static_below : float
        Threshold on the mean displacement, as a fraction of the diagonal. Unlike a threshold on the sum, it
        depends neither on the unit nor on the number of handles.
    """
    moved = np.linalg.norm(target - source, axis=1)
    mean = float(moved.mean())
    kind = STATIC if mean < static_below * diagonal else DYNAMIC
    return {"kind": kind, "delta": float(moved.sum()), "delta_mean": mean}


def handle_records(
    rest: Mesh,
    posed: Mesh | None,
    pose: SourcePose,
    *,
    regions: Sequence[str],
    chosen: Mapping[str, np.ndarray],
    options: BuildOptions,
) -> list[dict[str, Any]]:
    """Make the entries of a pose file: landmarks that are regions, then landmarks with handles.

    Parameters
    ----------
    rest : Mesh
        Registered rest mesh, on which displacements are measured.
    posed : Mesh, optional
        Registered target pose; None if only its regions are known.
    pose : SourcePose
        Its landmarks have handles; other landmarks are listed as unused.
    regions : sequence of str
        Landmarks that are regions, in the order of their ids.
    chosen : mapping
        Handles of the other landmarks; see :func:`choose_handles`.
    options : BuildOptions
        `static_below`: see :func:`displacement`.

    Raises
    ------
    InputError
        When a region has no vertex.
    """

    def facts(landmark: str, source: np.ndarray, target: np.ndarray) -> dict[str, Any]:
        size, threshold = rest.diagonal, options.static_below
        return {"landmark": landmark} | displacement(source, target, diagonal=size, static_below=threshold)

    still = {"boxes": [], "rotation": np.eye(3).tolist(), "translation": [0.0, 0.0, 0.0]}
    records = {name: _unused(name, still) for name in regions}
    for region in pose.regions:
        source = rest.V[vertices_in(rest.V, region.boxes)]
        target = rigidly_moved(source, region.rotation, region.translation)
        records[region.landmark] = facts(region.landmark, source, target) | {
            "boxes": region.boxes,
            "rotation": region.rotation.tolist(),
            "translation": region.translation.tolist(),
        }
    if posed is None:
        return list(records.values())
    for name, index in chosen.items():
        records[name] = _unused(name, {"source": [], "target": []})
        if name in pose.landmarks:
            source, target = rest.V[index], posed.V[index]
            positions = {"source": source.tolist(), "target": target.tolist()}
            records[name] = facts(name, source, target) | positions
    return list(records.values())


def _unused(landmark: str, place: dict[str, Any]) -> dict[str, Any]:
    """Return the entry of a landmark without handles, which has the keys of the others, as tables need."""
    return {"landmark": landmark, "kind": UNUSED, "delta": None, "delta_mean": None} | place
