"""Meshes of several components, or that are not manifold: deformed component by component.

The engine needs a connected, oriented manifold. Other meshes are cut into an oriented manifold
(:mod:`sshade.mesh.cutting`). Vertices of which cutting made copies are placed first, by one coarse solve of
all components that have such vertices (:mod:`sshade.method.junctions`). The components are then deformed
one after another, with their copies fixed there, so that they fit together again. A component without
handles that is joined to no other is unconstrained: a task refuses it, or lets it follow the nearest
component rigidly.

A one-sided surface becomes a surface of twice its area, its two sides, which are deformed together; each
vertex goes to the mean of its two copies. The mean is as smooth as the sides are, so nothing tears.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from sshade.core.progress import Progress
from sshade.mesh.cutting import cut_to_manifold
from sshade.mesh.surface import without_duplicates
from sshade.mesh.unconstrained import contacts, move_rigidly, without_handles
from sshade.method.component_set import ComponentSet, DeformComponent
from sshade.method.proxies import joined
from sshade.problem.options import Options
from sshade.problem.task import DeformationResult, DeformationTask

log = logging.getLogger(__name__)

#: How the facts of components are combined into a fact of the whole; other facts are dropped.
FACTS: dict[str, Callable[[Any], Any]] = {
    "samples": sum,
    "proxy_vertices": sum,
    "faces_without_area": sum,
    "residual": max,
    "volume_goal_error": max,
    "options": lambda values: values[0],
}
#: Facts of a result without a proxy.
NO_PROXY = {"samples": 0, "proxy_vertices": 0, "residual": 0.0, "faces_without_area": 0}


def by_components(
    task: DeformationTask,
    deform: DeformComponent,
    options: Options,
    *,
    progress: Progress,
) -> DeformationResult:
    """Extend a method for connected, oriented manifolds to all meshes.

    A connected, oriented manifold is passed to `deform`; other meshes are cut into such components. A
    component whose hard handles share one rigid motion moves with them, without a proxy, unless it is joined
    to another component. Unconstrained components follow the nearest component:
    see :func:`sshade.mesh.unconstrained.move_rigidly`.

    Parameters
    ----------
    task : DeformationTask
    deform : callable
    options : Options
        `vertices` and `polish_seconds` are totals, distributed over components by area. A component with n
        vertices has at most n / 4 proxy vertices, and at least its handles and a few more: see
        :func:`sshade.method.proxies.proxy_vertices`. The other components get the rest of its portion. Both
        sides of a one-sided surface count.
    progress : Progress

    Returns
    -------
    DeformationResult
        Of a mesh that was cut, `iterations` is the mean over components. ``extra`` has the sum of
        ``proxy_vertices``, the largest ``residual``, and the numbers of deformed ``components``, of ``rigid``
        components among them, of ``unconstrained`` components, of unconstrained components ``touching``
        others, of removed ``duplicates`` of faces, of vertices on bent ``one_sided`` surfaces, of further
        ``copies`` of vertices, and of faces ``turned`` to agree. Largest distances, as fractions of the
        diagonal: ``gap`` between a copy and the joined vertex, ``side_gap`` between a side of a one-sided
        surface and the mean of its sides, ``opening`` between vertices that touched at rest.

    Raises
    ------
    InputError
        As `deform`, with the name of the component, and if the proxy cannot hold the handles.
    """
    whole = task.mesh
    if whole.topology.components == 1 and whole.is_manifold and whole.is_oriented:
        result = deform(task, progress=progress)
        _warn_of_volume([result.extra])
        return result
    handles, mesh = task.handles, without_duplicates(whole)
    unconstrained = without_handles(mesh, handles.index)
    contact = contacts(mesh, unconstrained)
    contact.warn()
    cut = cut_to_manifold(mesh)
    facts: dict[str, Any] = {
        "components": 1,
        "unconstrained": len(unconstrained),
        "touching": contact.components,
        "duplicates": whole.m - mesh.m,
        "one_sided": 0,
        "copies": len(cut.origin) - mesh.n - len(np.unique(mesh.F[cut.one_sided])),
        "turned": cut.turned,
        "gap": 0.0,
    }
    if cut.mesh.topology.components == 1 and cut.mesh is mesh:
        result = deform(replace(task, mesh=mesh), progress=progress)
        _warn_of_volume([result.extra])
        return replace(result, extra={**result.extra, **facts})
    components = ComponentSet(mesh, cut, task, deform, options)
    all_components = components.order()
    order = [component for component in all_components if not components.move_with_handles(component)]
    components.place_junctions(order, progress)
    results = _deformed_in_turn(components, order, options, progress)
    V = components.positions
    move_rigidly(mesh, V, unconstrained)
    facts |= {"components": len(all_components), "rigid": len(all_components) - len(order)}
    facts["one_sided"] = int(components.one_sided.sum())
    gaps = {**components.gaps, "opening": contact.opening(V)}
    facts |= {name: gap / mesh.diagonal for name, gap in gaps.items()}
    _warn_of_volume([result.extra for result in results])
    joint = joined(V, results or [DeformationResult(V, 0, True, {}, NO_PROXY)], FACTS)
    seconds = {**components.seconds, **joint.seconds}
    return replace(joint, seconds=seconds, extra={**joint.extra, **facts})


def _deformed_in_turn(
    components: ComponentSet, order: list[int], options: Options, progress: Progress
) -> list[DeformationResult]:
    """Deform components in the given order, with their portions of proxy vertices and seconds."""
    vertices = components.proxy_vertices(order)
    area, seconds_left = components.area[order], options.polish_seconds
    results = []
    for number, component in enumerate(order):
        stage = f"component {number + 1}/{len(order)}"
        changes: dict[str, Any] = {"vertices": int(vertices[number])}
        if seconds_left is not None:
            changes["polish_seconds"] = area[number] / area[number:].sum() * seconds_left
        result = components.deform(component, stage, changes, progress)
        if seconds_left is not None:
            seconds_left = max(0.0, seconds_left - result.seconds.get("polish", 0.0))
        results.append(result)
    return results


def _warn_of_volume(facts: list[Mapping[str, Any]]) -> None:
    """Warn once of all components whose volume should be constrained, but is not."""
    states = [fact.get("volume_constraint", fact.get("proxy_volume_constraint", "")) for fact in facts]
    for state, count in Counter(state for state in states if state.startswith("off: ")).items():
        where = f" in {count} of {len(facts)} components" if len(facts) > 1 else ""
        log.warning("the volume constraint is off%s: %s", where, state.removeprefix("off: "))
