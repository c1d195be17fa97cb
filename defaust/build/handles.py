"""Choose handles near landmarks, and classify landmarks as static or dynamic."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from defaust.sources.source import Region
from sshade import InputError, Mesh
from sshade.io.regions import rigidly_moved, vertices_in
from sshade.mesh.adjacency import edge_graph

#: Number of handles of a landmark, and number of graph-nearest vertices that they are drawn from.
PER_LANDMARK = 30
NEIGHBOURHOOD = 60
#: Maximum mean displacement of a static landmark, as a fraction of the rest mesh's bounding-box diagonal.
#: On a body this is about 0.1 m. The paper sums over 30 handles instead, which gives 3 m.
STATIC_BELOW = 0.05

STATIC, DYNAMIC, UNUSED = "static", "dynamic", "unused"


class Displacement(NamedTuple):
    """Sum over the handles (the paper's Delta), mean, and the resulting kind of the landmark."""

    delta: float
    delta_mean: float
    kind: str


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

    distance = dijkstra(edge_graph(mesh).matrix, indices=vertex)
    nearest = np.argsort(distance, kind="stable")[:count]
    if len(nearest) < count or not np.isfinite(distance[nearest[-1]]):
        raise InputError(
            f"only {int(np.isfinite(distance).sum())} vertices can be reached from vertex {vertex}, "
            f"and the neighbourhood of a landmark needs {count}; use a smaller neighbourhood"
        )
    return nearest


def choose_handles(
    mesh: Mesh,
    landmarks: Mapping[str, int],
    *,
    subject: int,
    seed: int,
    per_landmark: int = PER_LANDMARK,
    neighbourhood: int = NEIGHBOURHOOD,
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
    subject, seed : int
    per_landmark, neighbourhood : int
        Number of handles, and number of nearest vertices that they are drawn from.

    Returns
    -------
    dict of (per_landmark,) int64, ascending

    Raises
    ------
    InputError
        When landmarks are too close to each other, so that too few vertices are left.
    """
    taken = np.zeros(mesh.n, dtype=bool)
    chosen = {}
    for number, (name, vertex) in enumerate(landmarks.items()):
        near = nearest_vertices(mesh, vertex, count=neighbourhood)
        free = near[~taken[near]]
        if len(free) < per_landmark:
            raise InputError(
                f"landmark {name!r} has {len(free)} vertices left that no other landmark took, "
                f"and needs {per_landmark}; use fewer landmarks or a larger neighbourhood"
            )
        rng = np.random.default_rng([seed, subject, number])
        chosen[name] = np.sort(rng.choice(free, size=per_landmark, replace=False))
        taken[chosen[name]] = True
    return chosen


def displacement(
    source: np.ndarray, target: np.ndarray, *, diagonal: float, static_below: float = STATIC_BELOW
) -> Displacement:
    """Compute Delta_l, the sum over H_l of |v - pi(v)|, its mean, and the kind of the landmark.

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
    return Displacement(float(moved.sum()), mean, STATIC if mean < static_below * diagonal else DYNAMIC)


def handle_records(
    rest: Mesh,
    posed: np.ndarray,
    *,
    chosen: Mapping[str, np.ndarray],
    used: Sequence[str],
    static_below: float = STATIC_BELOW,
) -> list[dict[str, Any]]:
    """Make the entries of a pose file, one for each landmark, in the order of `chosen`.

    Parameters
    ----------
    rest : Mesh
    posed : (n, 3) float64
        Vertices of the registered target pose.
    chosen : mapping
        See :func:`choose_handles`.
    used : sequence of str
        Landmarks with handles in this pose; other landmarks are listed as unused.
    static_below : float
        See :func:`displacement`.
    """
    records: list[dict[str, Any]] = []
    for name, index in chosen.items():
        if name not in used:
            records.append(_unused(name))
            continue
        source, target = rest.V[index], posed[index]
        d = displacement(source, target, diagonal=rest.diagonal, static_below=static_below)
        records.append(_facts(name, d) | {"source": source.tolist(), "target": target.tolist()})
    return records


def region_records(
    rest: Mesh,
    regions: Sequence[Region],
    *,
    landmarks: Sequence[str] = (),
    static_below: float = STATIC_BELOW,
) -> list[dict[str, Any]]:
    """Make the entries of a pose file for landmarks that are regions.

    Parameters
    ----------
    rest : Mesh
        Registered rest mesh, on which displacements are measured.
    regions : sequence of Region
    landmarks : sequence of str
        All landmarks in the order of their ids; landmarks without a region are listed as unused. By default
        only the landmarks of the regions.
    static_below : float
        See :func:`displacement`.

    Raises
    ------
    InputError
        When a region has no vertex.
    """
    records = {name: _unused(name) for name in landmarks}
    for region in regions:
        source = rest.V[vertices_in(rest.V, region.boxes)]
        target = rigidly_moved(source, region.rotation, region.translation)
        d = displacement(source, target, diagonal=rest.diagonal, static_below=static_below)
        records[region.landmark] = _facts(region.landmark, d) | {
            "boxes": region.boxes,
            "rotation": region.rotation.tolist(),
            "translation": region.translation.tolist(),
        }
    return list(records.values())


def _facts(landmark: str, d: Displacement) -> dict[str, Any]:
    return {"landmark": landmark, "kind": d.kind, "delta": d.delta, "delta_mean": d.delta_mean}


def _unused(landmark: str) -> dict[str, Any]:
    return {
        "landmark": landmark,
        "kind": UNUSED,
        "delta": None,
        "delta_mean": None,
        "source": [],
        "target": [],
    }
