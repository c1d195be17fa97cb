"""Meshes of several components, or that are not manifold: deformed component by component.

The engine needs a connected, oriented manifold. Other meshes are cut into an oriented manifold
(:mod:`sshade.mesh.cutting`). The components are deformed in turn: components with handles first, larger
components first. Where cutting made copies of a vertex, a later component fixes its copy at the position in
the earlier component, so that the components fit together again. A component without handles is
unconstrained: a task refuses it, or lets it follow the nearest component rigidly.

A one-sided surface becomes a surface of twice its area, its two sides, which are deformed together; each
vertex goes to the mean of its two copies. The mean is as smooth as the sides are, so nothing tears.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from sshade.errors import InputError
from sshade.mesh.connectivity import members
from sshade.mesh.cutting import Cut, cut_to_manifold
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import common_motion
from sshade.mesh.surface import without_duplicates
from sshade.mesh.unconstrained import contacts, move_rigidly, without_handles
from sshade.options import Options
from sshade.pipeline.proxies import joined, least_vertices, proxy_vertices, shared_vertices
from sshade.pipeline.regions import EDGE_SAMPLES
from sshade.progress import Progress, renamed
from sshade.task import DeformationResult, DeformationTask, Handles

log = logging.getLogger(__name__)

#: Largest distance of copies within a component from their mean, as a fraction of the length of the edges
#: around them. Where a copy is farther away, the component is deformed again with its copies fixed.
LOOSE = 0.1
#: Largest distance of the sides of a one-sided surface from their mean, as a fraction of the diagonal. Sides
#: farther apart are in two local minima; the surface is deformed again, both sides from their mean.
APART = 0.01
#: Deforms a connected, oriented manifold: ``deform(task, progress=, **changes)``, with some options changed.
DeformComponent = Callable[..., DeformationResult]
#: How the facts of components are combined into a fact of the whole; other facts are dropped.
FACTS: dict[str, Callable[[Any], Any]] = {
    "samples": sum,
    "proxy_vertices": sum,
    "faces_without_area": sum,
    "residual": max,
    "options": lambda values: values[0],
}
#: Facts of a result without a proxy.
NO_PROXY = {"samples": 0, "proxy_vertices": 0, "residual": 0.0, "faces_without_area": 0}


def by_components(
    task: DeformationTask, deform: DeformComponent, options: Options, *, progress: Progress
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
        :func:`sshade.pipeline.proxies.proxy_vertices`. The other components get the rest of its portion. Both
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
    components = _Components(mesh, cut, task, deform, options)
    all_components = components.order()
    order = [component for component in all_components if not components.move_with_handles(component)]
    results = _deformed_in_turn(components, order, options, progress)
    V = components.positions
    move_rigidly(mesh, V, unconstrained)
    facts |= {"components": len(all_components), "rigid": len(all_components) - len(order)}
    facts["one_sided"] = int(components.one_sided.sum())
    gaps = {**components.gaps, "opening": contact.opening(V)}
    facts |= {name: gap / mesh.diagonal for name, gap in gaps.items()}
    _warn_of_volume([result.extra for result in results])
    joint = joined(V, results or [DeformationResult(V, 0, True, {}, NO_PROXY)], FACTS)
    return replace(joint, extra={**joint.extra, **facts})


def _deformed_in_turn(
    components: _Components, order: list[int], options: Options, progress: Progress
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


class _Components:
    """The components of a cut mesh, and the positions found so far.

    Attributes
    ----------
    area : (c,) float64
        Of each component.
    positions : (n, 3) float64
        Deformed positions; rest positions where no component with the vertex is done.
    one_sided : (n,) bool
        Vertices of one-sided surfaces that were deformed.
    gaps : dict of float
        "gap": largest distance of a copy from the position of its vertex. "side_gap": the same where the
        copies are the sides of a one-sided surface.
    """

    def __init__(
        self, mesh: Mesh, cut: Cut, task: DeformationTask, deform: DeformComponent, options: Options
    ) -> None:
        handles = task.handles
        self._cut, self._handles, self._task = cut, handles, task
        self._deform, self._options = deform, options
        self._component, count = cut.mesh.component, cut.mesh.topology.components
        self._number = np.full(mesh.n, -1)
        self._number[handles.index] = np.arange(len(handles))
        self._members = members(self._component, count)
        of_face = self._component[cut.mesh.F[:, 0]]
        self._faces = members(of_face, count)
        self.area = np.bincount(of_face, cut.mesh.face_areas)
        # Number of sides of the surface in each component: 2 where it covers a one-sided surface.
        self._sides = np.where(np.isin(np.arange(count), of_face[mesh.m :]), 2, 1)
        self._hard = handles.hard & ~handles.has_rotation
        self.positions, self._done = np.array(mesh.V), np.zeros(mesh.n, dtype=bool)
        self.gaps, self.one_sided = {"gap": 0.0, "side_gap": 0.0}, np.zeros(mesh.n, dtype=bool)
        # Number of copies of each vertex in each component.
        entries = np.ones(len(cut.origin)), (cut.origin, self._component)
        self._copies = csr_array(entries, shape=(mesh.n, count))

    def order(self) -> list[int]:
        """Return components with handles, then components joined to earlier components; larger first."""
        copies = self._copies
        beside, waiting = copies.T @ copies, copies.T @ (self._number >= 0) > 0
        found: list[int] = []
        seen = waiting
        while waiting.any():
            ids = np.flatnonzero(waiting)
            found += ids[np.argsort(-self.area[ids], kind="stable")].tolist()
            waiting = (beside @ waiting > 0) & ~seen
            seen = seen | waiting
        return found

    def proxy_vertices(self, order: list[int]) -> np.ndarray:
        """Return (c,) int64: the numbers of proxy vertices of components that are deformed in this order.

        Raise InputError if the handles of the components find no room on the proxy.
        """
        asked, handles = self._options.vertices, int((~self._done[self._handles.index]).sum())
        if asked < (needed := min(handles, EDGE_SAMPLES)):
            raise InputError(
                f"{asked} proxy vertices were asked for: at least {needed} are needed, to hold the {handles} "
                "handle vertices"
            )
        fixed = self._done | (self._number >= 0)
        least, most = np.zeros((2, len(order)), dtype=np.int64)
        for number, component in enumerate(order):
            origin = self._cut.origin[self._members[component]]
            n, handles = len(origin), int(fixed[origin].sum())
            least[number] = min(n, least_vertices(handles))
            most[number] = proxy_vertices(n, n, handles, coarser=self._options.coarser)
            fixed[origin] = True
        return shared_vertices(asked, self.area[order], least, most)

    def move_with_handles(self, component: int) -> bool:
        """Move a component by the rigid motion that its hard handles share; return whether there is one.

        Components that are joined to others stay, because a joint may belong to a shape that bends.
        """
        origin, handles = self._cut.origin[self._members[component]], self._handles
        number = np.unique(self._number[origin])
        number = number[number >= 0]
        if len(number) == 0 or not self._hard[number].all():
            return False
        if (np.diff(self._copies.indptr)[origin] > 1).any():
            return False
        motion = common_motion(self._task.mesh.V[handles.index[number]], handles.target[number])
        if motion is None:
            return False
        R, t = motion
        self.positions[origin] = self._task.mesh.V[origin] @ R.T + t
        self.positions[handles.index[number]] = handles.target[number]
        self._done[origin] = True
        return True

    def deform(
        self, component: int, stage: str, changes: dict[str, Any], progress: Progress
    ) -> DeformationResult:
        """Deform a component, with some options changed, and store the positions of its vertices."""
        vertex, sides = self._members[component], self._sides[component]
        origin, guess = self._cut.origin[vertex], self._task.guess
        F = np.searchsorted(vertex, self._cut.mesh.F[self._faces[component]])
        shape = Mesh(self._cut.mesh.V[vertex], F)
        if sides == 2:  # the sides enclose nothing
            changes = {**changes, "volume": 0.0}
        if not isinstance(self._options.frame_function, str):
            changes = {**changes, "frame_function": self._values_of(self._options.frame_function)[origin]}
        solve = partial(self._solve, shape, origin, stage, progress=progress)
        result = solve(changes, None if guess is None else guess[origin])
        means = _at_means(origin, result.vertices)
        distance = np.linalg.norm(result.vertices - means, axis=1)
        apart = sides == 2 and distance.max() > APART * shape.diagonal
        if self._fix_loose_copies(shape, origin, means, distance, sides) or apart:
            if changes.get("polish_seconds") is not None:
                left = changes["polish_seconds"] - result.seconds.get("polish", 0.0)
                changes = {**changes, "polish_seconds": max(0.0, left)}
            again = solve(changes, means)
            both = joined(again.vertices, [result, again], {})
            result = replace(again, iterations=2 * both.iterations, seconds=both.seconds)
        self._take_over(origin, result.vertices, "gap" if sides == 1 else "side_gap")
        self.one_sided[origin] |= sides == 2
        if sides == 2 and self._options.volume > 0:
            result = replace(result, extra={**result.extra, "volume_constraint": "off: one-sided"})
        return result

    def _solve(
        self,
        shape: Mesh,
        origin: np.ndarray,
        stage: str,
        changes: dict[str, Any],
        guess: np.ndarray | None,
        *,
        progress: Progress,
    ) -> DeformationResult:
        """Deform a component, whose vertices are copies of `origin` (k,), from a guess (k, 3)."""
        handles = self._handles_of(origin)
        vertices = max(changes["vertices"], least_vertices(len(handles)))
        vertices = proxy_vertices(vertices, shape.n, len(handles), coarser=self._options.coarser)
        part = DeformationTask(f"{self._task.name} {stage}", shape, handles, guess=guess)
        try:
            progress = renamed(progress, stage, within=True)
            return self._deform(part, progress=progress, **{**changes, "vertices": vertices})
        except InputError as error:
            raise InputError(
                f"the component of {shape.n} vertices around vertex {origin[0]} cannot be deformed: {error}"
            ) from error

    def _values_of(self, frame_function: np.ndarray) -> np.ndarray:
        n, values = len(self._number), np.asarray(frame_function)
        if values.shape != (n,):
            raise InputError(f"a frame function needs {n} values, one a vertex, not {values.shape}")
        return values

    def _handles_of(self, origin: np.ndarray) -> Handles:
        """Handles of a component, then copies of finished vertices, fixed at their positions."""
        handles, number = self._handles, self._number[origin]
        fixed = self._done[origin] & ~((number >= 0) & handles.hard[number])  # also where a handle is soft
        with_handle, seam = np.flatnonzero((number >= 0) & ~fixed), np.flatnonzero(fixed)
        with_handle = with_handle[np.argsort(number[with_handle], kind="stable")]
        number = number[with_handle]
        of_seam = {"dynamic": True, "group": handles.group.max() + 1, "weight": np.inf}
        fields: dict[str, Any] = {"index": np.concatenate([with_handle, seam])}
        fields["target"] = np.concatenate([handles.target[number], self.positions[origin[seam]]])
        for name, value in {**of_seam, "portion": 1.0, "rotation": np.nan}.items():
            if (values := getattr(handles, name)) is not None:
                further = np.full((len(seam), *values.shape[1:]), value)
                fields[name] = np.concatenate([values[number], further])
        return Handles(**fields)

    def _fix_loose_copies(
        self, shape: Mesh, origin: np.ndarray, means: np.ndarray, distance: np.ndarray, sides: int
    ) -> bool:
        """Fix copies within a component at their means (k, 3) if one is far from it; return whether one is.

        Each of the `sides` of a surface has a copy of every vertex; more copies come from cutting. A single
        vertex that is moved to the mean of distant copies would stretch the faces around it.
        """
        copies = np.bincount(origin, minlength=len(self._number))[origin]
        cut = np.flatnonzero((copies > sides) & ~self._done[origin])
        if len(cut) == 0:
            return False
        ends = shape.edges
        length = np.linalg.norm(shape.V[ends[:, 0]] - shape.V[ends[:, 1]], axis=1).repeat(2)
        length = np.bincount(ends.ravel(), length) / np.bincount(ends.ravel())
        if (distance[cut] <= LOOSE * length[cut]).all():
            return False
        self.positions[origin[cut]], self._done[origin[cut]] = means[cut], True
        return True

    def _take_over(self, origin: np.ndarray, V: np.ndarray, name: str) -> None:
        """Store the mean of the copies within a component; finished vertices stay."""
        new = ~self._done[origin]
        self.positions[origin[new]] = _at_means(origin[new], V[new])
        self._done[origin] = True
        gap = np.linalg.norm(V - self.positions[origin], axis=1).max()
        self.gaps[name] = max(self.gaps[name], float(gap))


def _at_means(vertex: np.ndarray, V: np.ndarray) -> np.ndarray:
    """Replace each of the positions V (k, 3) by the mean of all positions of its vertex (k,)."""
    _, inverse, count = np.unique(vertex, return_inverse=True, return_counts=True)
    return np.stack([(np.bincount(inverse, x) / count)[inverse] for x in V.T], axis=1)
