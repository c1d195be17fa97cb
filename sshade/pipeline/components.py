"""Meshes of several components, or that are not manifold: deformed component by component.

The method itself needs an oriented manifold of one component. Here a mesh is cut into an
oriented manifold (:mod:`sshade.mesh.cutting`), whose components are deformed one after the
other, those with handles first, the larger first. Where cutting made copies of a vertex, the
components that come later hold theirs where the first one put it, so that all fit together
again. A component of the mesh without handles is unconstrained: tasks refuse it, or say that it
follows the nearest one rigidly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from typing import Any, TypeVar, cast

import numpy as np
from scipy.sparse import csr_array

from sshade.errors import InputError
from sshade.mesh.connectivity import members
from sshade.mesh.cutting import Cut, cut_to_manifold
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import rigid_motion
from sshade.mesh.surface import without_duplicates
from sshade.pipeline.proxies import COARSER, joined, least_vertices, proxy_vertices
from sshade.pipeline.regions import EDGE_SAMPLES
from sshade.progress import Progress, silent
from sshade.task import DeformationResult, DeformationTask, Handles

MethodT = TypeVar("MethodT", bound=Callable[..., DeformationResult])

#: Vertices near each one of an unconstrained component whose motion it follows.
NEAREST = 8
#: What one fact of the whole is, from those of the components.
FACTS: dict[str, Callable[[Any], Any]] = {
    "samples": sum,
    "proxy_vertices": sum,
    "faces_without_area": sum,
    "residual": max,
}


def each_component(*, vertices: int) -> Callable[[MethodT], MethodT]:
    """Make a method of oriented manifolds of one component one of all meshes.

    On such a mesh it is `method`, bit for bit. Any other is cut, and each component deformed with its
    own handles; those that are unconstrained move rigidly with the nearest one
    (:attr:`sshade.DeformationTask.carry_unconstrained`): by the motion of the :data:`NEAREST` vertices of
    it that are closest to each of theirs.

    Parameters
    ----------
    vertices : int
        The method's default.

    Returns
    -------
    callable
        The decorator of a method of a task, ``vertices``, ``coarser`` where it has that, and ``progress``
        among others. All components together have so many proxy vertices, a quarter of the mesh's at most,
        shared by area; each has a quarter of its own, and its handles and a few more at least: see
        :func:`sshade.pipeline.proxies.proxy_vertices`.
        Of a mesh that was taken apart, the result's `iterations` is the mean over components. ``extra`` has
        ``proxy_vertices`` in all, the largest ``residual``, and the numbers of
        ``components`` deformed (of the cut mesh), of ``unconstrained`` ones, of ``duplicates`` of
        faces that were left out, of ``copies`` of
        vertices that cutting made and of faces ``turned`` to agree; ``gap`` is how far copies
        came apart before they were joined, over the diagonal. It raises InputError as `method`
        does, then naming the component, and when the vertices asked for cannot hold the handles.
    """

    def decorated(method: MethodT) -> MethodT:
        @wraps(method)
        def whole(task: DeformationTask, *, progress: Progress = silent, **options: Any) -> DeformationResult:
            mesh = task.mesh
            if mesh.topology.components == 1 and mesh.is_manifold and mesh.is_oriented:
                return method(task, progress=progress, **options)
            return _by_components(task, method, progress=progress, **{"vertices": vertices, **options})

        return cast(MethodT, whole)

    return decorated


def _by_components(
    task: DeformationTask,
    method: Callable[..., DeformationResult],
    *,
    vertices: int,
    coarser: int = COARSER,
    progress: Progress,
    **options: Any,
) -> DeformationResult:
    given, handles = task.mesh, task.handles
    mesh = without_duplicates(given)
    unconstrained = np.setdiff1d(mesh.component, mesh.component[handles.index])
    cut = cut_to_manifold(mesh)
    facts: dict[str, Any] = {
        "components": 1,
        "unconstrained": len(unconstrained),
        "duplicates": given.m - mesh.m,
        "copies": len(cut.origin) - mesh.n,
        "turned": cut.turned,
        "gap": 0.0,
    }
    if coarser != COARSER:
        options["coarser"] = coarser
    if cut.mesh.topology.components == 1 and cut.mesh is mesh:
        sound = replace(task, mesh=mesh)
        result = method(sound, vertices=vertices, progress=progress, **options)
        return replace(result, extra={**result.extra, **facts})
    least = min(len(handles), EDGE_SAMPLES)
    if vertices < least:
        raise InputError(
            f"{vertices} proxy vertices were asked for: at least {least} are needed, to hold the "
            f"{len(handles)} handle vertices"
        )
    vertices = proxy_vertices(vertices, mesh.n, len(handles), coarser=coarser)
    components = _Components(mesh, cut, handles)
    order = components.order()
    density = vertices / sum(components.area[c] for c in order)
    results = []
    for number, component in enumerate(order, start=1):
        stage = f"component {number} of {len(order)}"
        results.append(
            components.deform(
                component,
                method,
                share=round(density * components.area[component]),
                coarser=coarser,
                name=f"{task.name} {stage}",
                progress=lambda _, done, total, note="", stage=stage: progress(stage, done, total, note),
                **options,
            )
        )
    V = components.positions
    _carry_rigidly(mesh, V, unconstrained)
    facts |= {"components": len(order), "gap": components.gap / mesh.diagonal}
    joint = joined(V, results, FACTS)
    return replace(joint, extra={**joint.extra, **facts})


class _Components:
    """The components of a cut mesh, and where vertices of the mesh have gone so far.

    Attributes
    ----------
    area : (c,) float64
        Of each component.
    positions : (n, 3) float64
        Deformed; those at rest where no component with the vertex is done.
    gap : float
        Largest distance of a copy to the position of its vertex.
    """

    def __init__(self, mesh: Mesh, cut: Cut, handles: Handles) -> None:
        self._cut, self._handles = cut, handles
        self._component, count = cut.mesh.component, cut.mesh.topology.components
        self._number = np.full(mesh.n, -1)
        self._number[handles.index] = np.arange(len(handles))
        self._members = members(self._component, count)
        self._faces = members(self._component[cut.mesh.F[:, 0]], count)
        self.area = np.bincount(self._component[cut.mesh.F[:, 0]], cut.mesh.face_areas)
        self.positions, self._done, self.gap = np.array(mesh.V), np.zeros(mesh.n, dtype=bool), 0.0

    def order(self) -> list[int]:
        """Components with handles, then those with copies of vertices of earlier ones; the larger first."""
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
        self,
        component: int,
        method: Callable[..., DeformationResult],
        *,
        share: int,
        coarser: int,
        name: str,
        **settings: Any,
    ) -> DeformationResult:
        """Deform a component and take over its positions."""
        own = self._members[component]
        origin = self._cut.origin[own]
        shape = Mesh(self._cut.mesh.V[own], np.searchsorted(own, self._cut.mesh.F[self._faces[component]]))
        handles = self._handles_of(origin)
        share = max(share, least_vertices(len(handles)))
        share = proxy_vertices(share, shape.n, len(handles), coarser=coarser)
        try:
            result = method(DeformationTask(name, shape, handles), vertices=share, **settings)
        except InputError as error:
            raise InputError(
                f"the component of {shape.n} vertices around vertex {origin[0]} cannot be deformed: {error}"
            ) from error
        self._take_over(origin, result.vertices)
        return result

    def _handles_of(self, origin: np.ndarray) -> Handles:
        """The handles of a component, then its copies of vertices that are done, held where these are."""
        given, number = self._handles, self._number[origin]
        with_handle = np.flatnonzero(number >= 0)
        with_handle = with_handle[np.argsort(number[with_handle], kind="stable")]
        seam = np.flatnonzero((number < 0) & self._done[origin])
        number = number[with_handle]
        return Handles(
            np.concatenate([with_handle, seam]),
            np.concatenate([given.target[number], self.positions[origin[seam]]]),
            dynamic=np.concatenate([given.dynamic[number], np.ones(len(seam), dtype=bool)]),
            group=np.concatenate([given.group[number], np.full(len(seam), given.group.max() + 1)]),
            weight=np.concatenate([given.weight[number], np.full(len(seam), np.inf)]),
            portion=_joined(given.portion, number, np.ones(len(seam))),
            rotation=_joined(given.rotation, number, np.full((len(seam), 3, 3), np.nan)),
        )

    def _take_over(self, origin: np.ndarray, V: np.ndarray) -> None:
        """The mean of the copies within a component; a vertex that is done stays."""
        new = ~self._done[origin]
        vertex, inverse, count = np.unique(origin[new], return_inverse=True, return_counts=True)
        mean = np.stack([np.bincount(inverse, x) for x in V[new].T], axis=1) / count[:, None]
        self.positions[vertex] = mean
        self._done[vertex] = True
        self.gap = max(self.gap, float(np.linalg.norm(V - self.positions[origin], axis=1).max()))


def _joined(values: np.ndarray | None, number: np.ndarray, further: np.ndarray) -> np.ndarray | None:
    """Rows `number` of optional values of handles, then further rows; None without values."""
    return None if values is None else np.concatenate([values[number], further])


def _carry_rigidly(mesh: Mesh, positions: np.ndarray, unconstrained: np.ndarray) -> None:
    """Move each unconstrained component as the vertices close to it of the nearest other one."""
    from scipy.spatial import cKDTree

    vertices = members(mesh.component, mesh.topology.components)
    others = np.flatnonzero(np.isin(mesh.component, unconstrained, invert=True))
    tree, trees = cKDTree(mesh.V[others]), {}
    for own in (vertices[component] for component in unconstrained):
        distance, nearest = tree.query(mesh.V[own])
        leader = mesh.component[others[nearest[np.argmin(distance)]]]
        if leader not in trees:
            trees[leader] = cKDTree(mesh.V[vertices[leader]])
        _, near = trees[leader].query(mesh.V[own], k=min(NEAREST, len(vertices[leader])))
        near = vertices[leader][np.unique(near)]
        R, t = rigid_motion(mesh.V[near], positions[near])
        positions[own] = mesh.V[own] @ R.T + t
