"""Meshes of several components, or that are not manifold: deformed component by component.

The engine needs a connected, oriented manifold. Other meshes are cut into an oriented manifold
(:mod:`sshade.mesh.cutting`). The components are deformed in turn: components with handles first, larger
components first. Where cutting made copies of a vertex, a later component fixes its copy at the position in
the earlier component, so that the components fit together again. A component without handles is
unconstrained: a task refuses it, or lets it follow the nearest component rigidly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from sshade.errors import InputError
from sshade.mesh.connectivity import members
from sshade.mesh.cutting import Cut, cut_to_manifold
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import rigid_motion
from sshade.mesh.surface import without_duplicates
from sshade.options import Options
from sshade.pipeline.proxies import joined, least_vertices, proxy_vertices
from sshade.pipeline.regions import EDGE_SAMPLES
from sshade.progress import Progress, renamed
from sshade.task import DeformationResult, DeformationTask, Handles

#: Number of vertices of the nearest component whose motion a vertex of an unconstrained component follows.
NEAREST = 8
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


def by_components(
    task: DeformationTask, deform: DeformComponent, options: Options, *, progress: Progress
) -> DeformationResult:
    """Extend a method for connected, oriented manifolds to all meshes.

    A connected, oriented manifold is passed to `deform`. Other meshes are cut, and each component is deformed
    with its handles. Unconstrained components move rigidly with the :data:`NEAREST` vertices of the nearest
    component.

    Parameters
    ----------
    task : DeformationTask
    deform : callable
    options : Options
        `vertices` and `polish_seconds` are totals, distributed over components by area. A component with n
        vertices has at most n / 4 proxy vertices, and at least its handles and a few more: see
        :func:`sshade.pipeline.proxies.proxy_vertices`.
    progress : Progress

    Returns
    -------
    DeformationResult
        Of a mesh that was cut, `iterations` is the mean over components. ``extra`` has the sum of
        ``proxy_vertices``, the largest ``residual``, and the numbers of deformed ``components``, of
        ``unconstrained`` components, of removed ``duplicates`` of faces, of ``copies`` of vertices, and of
        faces ``turned`` to agree. ``gap`` is the largest distance between copies before joining, as a
        fraction of the diagonal.

    Raises
    ------
    InputError
        As `deform`, with the name of the component, and if the proxy cannot hold the handles.
    """
    whole = task.mesh
    if whole.topology.components == 1 and whole.is_manifold and whole.is_oriented:
        return deform(task, progress=progress)
    handles, mesh = task.handles, without_duplicates(whole)
    unconstrained = np.setdiff1d(mesh.component, mesh.component[handles.index])
    cut = cut_to_manifold(mesh)
    facts: dict[str, Any] = {
        "components": 1,
        "unconstrained": len(unconstrained),
        "duplicates": whole.m - mesh.m,
        "copies": len(cut.origin) - mesh.n,
        "turned": cut.turned,
        "gap": 0.0,
    }
    if cut.mesh.topology.components == 1 and cut.mesh is mesh:
        result = deform(replace(task, mesh=mesh), progress=progress)
        return replace(result, extra={**result.extra, **facts})
    least = min(len(handles), EDGE_SAMPLES)
    if options.vertices < least:
        raise InputError(
            f"{options.vertices} proxy vertices were asked for: at least {least} are needed, to hold the "
            f"{len(handles)} handle vertices"
        )
    vertices = proxy_vertices(options.vertices, mesh.n, len(handles), coarser=options.coarser)
    components = _Components(mesh, cut, task, deform, options)
    order = components.order()
    density = vertices / components.area[order].sum()
    seconds_left = options.polish_seconds
    results = []
    for number, component in enumerate(order, start=1):
        stage = f"component {number}/{len(order)}"
        changes: dict[str, Any] = {"vertices": round(density * components.area[component])}
        if seconds_left is not None:
            portion = components.area[component] / components.area[order[number - 1 :]].sum()
            changes["polish_seconds"] = portion * seconds_left
        result = components.deform(component, stage, changes, progress)
        if seconds_left is not None:
            seconds_left = max(0.0, seconds_left - result.seconds.get("polish", 0.0))
        results.append(result)
    V = components.positions
    _move_rigidly(mesh, V, unconstrained)
    facts |= {"components": len(order), "gap": components.gap / mesh.diagonal}
    joint = joined(V, results, FACTS)
    return replace(joint, extra={**joint.extra, **facts})


class _Components:
    """The components of a cut mesh, and the positions found so far.

    Attributes
    ----------
    area : (c,) float64
        Of each component.
    positions : (n, 3) float64
        Deformed positions; rest positions where no component with the vertex is done.
    gap : float
        Largest distance of a copy from the position of its vertex.
    """

    def __init__(
        self, mesh: Mesh, cut: Cut, task: DeformationTask, deform: DeformComponent, options: Options
    ) -> None:
        handles = task.handles
        self._cut, self._handles, self._task, self._deform, self._options = (
            cut,
            handles,
            task,
            deform,
            options,
        )
        self._component, count = cut.mesh.component, cut.mesh.topology.components
        self._number = np.full(mesh.n, -1)
        self._number[handles.index] = np.arange(len(handles))
        self._members = members(self._component, count)
        self._faces = members(self._component[cut.mesh.F[:, 0]], count)
        self.area = np.bincount(self._component[cut.mesh.F[:, 0]], cut.mesh.face_areas)
        self.positions, self._done, self.gap = np.array(mesh.V), np.zeros(mesh.n, dtype=bool), 0.0

    def order(self) -> list[int]:
        """Return components with handles, then components joined to earlier components; larger first."""
        origin, shape = self._cut.origin, (len(self._number), len(self.area))
        copies = csr_array((np.ones(len(origin)), (origin, self._component)), shape=shape)
        beside, waiting = copies.T @ copies, copies.T @ (self._number >= 0) > 0
        found: list[int] = []
        seen = waiting
        while waiting.any():
            ids = np.flatnonzero(waiting)
            found += ids[np.argsort(-self.area[ids], kind="stable")].tolist()
            waiting = (beside @ waiting > 0) & ~seen
            seen = seen | waiting
        return found

    def deform(
        self, component: int, stage: str, changes: dict[str, Any], progress: Progress
    ) -> DeformationResult:
        """Deform a component and take over its positions."""
        options, guess = self._options, self._task.guess
        vertex = self._members[component]
        origin = self._cut.origin[vertex]
        F = np.searchsorted(vertex, self._cut.mesh.F[self._faces[component]])
        shape, handles = Mesh(self._cut.mesh.V[vertex], F), self._handles_of(origin)
        vertices = max(changes["vertices"], least_vertices(len(handles)))
        vertices = proxy_vertices(vertices, shape.n, len(handles), coarser=options.coarser)
        changes = {**changes, "vertices": vertices}
        if not isinstance(options.frame_function, str):
            changes["frame_function"] = self._values_of(options.frame_function)[origin]
        guess = None if guess is None else guess[origin]
        part = DeformationTask(f"{self._task.name} {stage}", shape, handles, guess=guess)
        try:
            result = self._deform(part, progress=renamed(progress, stage, within=True), **changes)
        except InputError as error:
            raise InputError(
                f"the component of {shape.n} vertices around vertex {origin[0]} cannot be deformed: {error}"
            ) from error
        self._take_over(origin, result.vertices)
        return result

    def _values_of(self, frame_function: np.ndarray) -> np.ndarray:
        n, values = len(self._number), np.asarray(frame_function)
        if values.shape != (n,):
            raise InputError(f"a frame function needs {n} values, one a vertex, not {values.shape}")
        return values

    def _handles_of(self, origin: np.ndarray) -> Handles:
        """Handles of a component, then copies of finished vertices, fixed at their positions."""
        handles, number = self._handles, self._number[origin]
        with_handle = np.flatnonzero(number >= 0)
        with_handle = with_handle[np.argsort(number[with_handle], kind="stable")]
        seam = np.flatnonzero((number < 0) & self._done[origin])
        number = number[with_handle]
        of_seam = {"dynamic": True, "group": handles.group.max() + 1, "weight": np.inf}
        fields: dict[str, Any] = {"index": np.concatenate([with_handle, seam])}
        fields["target"] = np.concatenate([handles.target[number], self.positions[origin[seam]]])
        for name, value in {**of_seam, "portion": 1.0, "rotation": np.nan}.items():
            if (values := getattr(handles, name)) is not None:
                further = np.full((len(seam), *values.shape[1:]), value)
                fields[name] = np.concatenate([values[number], further])
        return Handles(**fields)

    def _take_over(self, origin: np.ndarray, V: np.ndarray) -> None:
        """Store the mean of the copies within a component; finished vertices stay."""
        new = ~self._done[origin]
        vertex, inverse, count = np.unique(origin[new], return_inverse=True, return_counts=True)
        mean = np.stack([np.bincount(inverse, x) for x in V[new].T], axis=1) / count[:, None]
        self.positions[vertex] = mean
        self._done[vertex] = True
        self.gap = max(self.gap, float(np.linalg.norm(V - self.positions[origin], axis=1).max()))


def _move_rigidly(mesh: Mesh, positions: np.ndarray, unconstrained: np.ndarray) -> None:
    """Move each unconstrained component rigidly with the closest vertices of its nearest component."""
    from scipy.spatial import cKDTree

    vertices = members(mesh.component, mesh.topology.components)
    others = np.flatnonzero(np.isin(mesh.component, unconstrained, invert=True))
    tree, trees = cKDTree(mesh.V[others]), {}
    for moved in (vertices[component] for component in unconstrained):
        distance, nearest = tree.query(mesh.V[moved])
        leader = mesh.component[others[nearest[np.argmin(distance)]]]
        if leader not in trees:
            trees[leader] = cKDTree(mesh.V[vertices[leader]])
        _, near = trees[leader].query(mesh.V[moved], k=min(NEAREST, len(vertices[leader])))
        near = vertices[leader][np.unique(near)]
        R, t = rigid_motion(mesh.V[near], positions[near])
        positions[moved] = mesh.V[moved] @ R.T + t
