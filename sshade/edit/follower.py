"""Compute the shape for handles: a few iterations for each step of a drag, all iterations at rest."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from sshade.edit.state import Settings
from sshade.errors import InputError
from sshade.handles import Handles
from sshade.mesh.mesh import Mesh
from sshade.options import REGIONS
from sshade.pipeline.deform import deform
from sshade.pipeline.deformer import Deformer
from sshade.progress import Progress, silent
from sshade.task import DeformationResult, DeformationTask

#: Proxy vertices during a drag, a third of the usual number. With 6000 the shape is a seventh nearer to the
#: converged shape, but a step takes 1.5 times as long.
VERTICES = 4000
#: Tolerance and iterations of a step of a drag; the next step continues. More iterations come nearer to the
#: converged shape with each picture, but show fewer pictures.
TOLERANCE, ITERATIONS = 1e-5, 3
#: Greatest number of vertices of each group that the proxy takes as handles during a drag. The group's other
#: vertices move directly to their targets.
REDUCED = 200
#: Weight of the volume constraint during a drag, which keeps the volume to about a thousandth.
VOLUME = 1e3
#: Smallest number of mesh vertices for which other handles are bound to the nearest samples. Binding such a
#: mesh anew takes too long; smaller meshes are bound anew, which makes their steps faster.
REBOUND = 500_000


def converged(task: DeformationTask, settings: Settings, *, progress: Progress = silent) -> DeformationResult:
    """Return the converged shape, which equals the result of ``sshade deform``.

    Raises
    ------
    InputError
        When the method refuses the task.
    """
    return deform(task, method=settings.method, progress=progress, **_options(settings))


def _options(settings: Settings) -> dict[str, Any]:
    return {"start": "rigid"} if settings.method == "paper" else dict(settings.constraints)


class _Component(NamedTuple):
    """A component of the mesh; `mesh` is None unless it is an oriented manifold."""

    number: int
    vertices: np.ndarray
    mesh: Mesh | None


class _Reduced(NamedTuple):
    """Handles of a component, of which the proxy takes at most :data:`REDUCED` in each group.

    Attributes
    ----------
    component : int
    group : array
        Array ``Handles.group`` that these handles were chosen from.
    members, hard, reduced : (k,) int64
        Numbers of all handles on the component, of its hard handles, and of the handles that the proxy takes.
    binding : dict
        Vertices in the component, groups and weights of the reduced handles.
    """

    component: int
    group: np.ndarray
    members: np.ndarray
    hard: np.ndarray
    reduced: np.ndarray
    binding: dict[str, Any]


class _Bound(NamedTuple):
    """A Deformer, and the component, settings and handles that it was bound for."""

    component: int
    settings: Settings
    deformer: Deformer
    handles: tuple[bytes, ...]
    #: Whether the handles were bound to the nearest samples, after binding with other handles.
    rebound: bool = False


class Follower:
    """Deform the mesh during a drag.

    Only the component of the dragged group follows, if it is an oriented manifold. Everything else follows
    when the mouse rests.

    Parameters
    ----------
    mesh : Mesh
    """

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._connected = mesh.topology.components == 1
        self._last_component: _Component | None = None
        self._last_reduced: _Reduced | None = None
        self._bound: _Bound | None = None

    def prepare(self, handles: Handles, on: int, settings: Settings) -> None:
        """Bind the component of the vertex `on` in advance.

        Raises
        ------
        InputError
            When the component cannot be bound with these handles.
        """
        component = self._component(on)
        if component.mesh is not None:
            self._bind(component.mesh, self._reduced(handles, component), settings)

    def follow(self, handles: Handles, on: int, settings: Settings, shape: np.ndarray) -> None:
        """Continue the deformation for new targets.

        Parameters
        ----------
        handles : Handles
            All handles of the mesh, at their new targets.
        on : int
            A vertex of the dragged group.
        settings : Settings
        shape : (n, 3) float64, C-contiguous
            Positions, of which the moved ones are overwritten.

        Raises
        ------
        InputError
            See :meth:`prepare`.
        """
        component = self._component(on)
        subset = self._reduced(handles, component)
        if component.mesh is None:
            shape[handles.index[subset.members]] = handles.target[subset.members]
            return
        step: dict[str, Any] = {
            "rotations": None if handles.rotation is None else handles.rotation[subset.reduced],
            "tolerance": TOLERANCE,
            "max_iterations": ITERATIONS,
            "out": shape if self._connected else None,
        }
        bound = self._bind(component.mesh, subset, settings)
        try:
            result = bound.deformer(handles.target[subset.reduced], **step)
        except InputError:
            if not bound.rebound:
                raise
            # Two groups share their nearest sample. Bound anew, each group has samples of its own.
            self._bound = None
            bound = self._bind(component.mesh, subset, settings)
            result = bound.deformer(handles.target[subset.reduced], **step)
        if not self._connected:
            shape[component.vertices] = result.vertices
        shape[handles.index[subset.hard]] = handles.target[subset.hard]

    def forget(self) -> None:
        """Start the next step anew, because the handles are not where the last step left them."""
        if self._bound is not None:
            self._bound.deformer.reset()

    def _component(self, on: int) -> _Component:
        """Return the component of a vertex."""
        number = int(self._mesh.component[on])
        if self._last_component is None or self._last_component.number != number:
            mesh = self._mesh
            vertices = np.flatnonzero(mesh.component == number)
            if not self._connected:
                F = mesh.F[mesh.component[mesh.F[:, 0]] == number]
                mesh = Mesh(mesh.V[vertices], np.searchsorted(vertices, F))
            sound = mesh.is_manifold and mesh.is_oriented
            self._last_component = _Component(number, vertices, mesh if sound else None)
        return self._last_component

    def _reduced(self, handles: Handles, component: _Component) -> _Reduced:
        """Return the handles on a component, and at most :data:`REDUCED` of each group."""
        last = self._last_reduced
        if last is None or last.component != component.number or last.group is not handles.group:
            members = np.flatnonzero(self._mesh.component[handles.index] == component.number)
            rng, chosen = np.random.default_rng(0), []
            for group in np.unique(handles.group[members]):
                few = members[handles.group[members] == group]
                chosen.append(
                    few if len(few) <= REDUCED else np.sort(rng.choice(few, REDUCED, replace=False))
                )
            reduced = np.concatenate(chosen)
            binding = {
                "index": np.searchsorted(component.vertices, handles.index[reduced]),
                "group": handles.group[reduced],
                "weight": handles.weight[reduced],
            }
            hard = members[handles.hard[members]]
            last = _Reduced(component.number, handles.group, members, hard, reduced, binding)
            self._last_reduced = last
        return last

    def _bind(self, mesh: Mesh, subset: _Reduced, settings: Settings) -> _Bound:
        """Return a Deformer that is bound with the reduced handles."""
        key = tuple(values.tobytes() for values in subset.binding.values())
        bound, self._bound = self._bound, None
        if bound is not None and (bound.component, bound.settings) == (subset.component, settings):
            if bound.handles != key and mesh.n >= REBOUND:
                try:
                    bound.deformer.rebind_handles(**subset.binding)
                    bound = bound._replace(handles=key, rebound=True)
                except InputError:  # a handle is too far from the samples, or two groups share a sample
                    bound = None
            if bound is not None and bound.handles == key:
                self._bound = bound
                return bound
        options = _options(settings)
        if settings.method != "paper":
            is_region = len(subset.reduced) < len(subset.members)
            regional = {name: REGIONS["fast"][name] for name in ("area", "bending") if is_region}
            options = {"volume": VOLUME, **regional, **options}
        options["method"] = "paper" if settings.method == "paper" else "fast"
        deformer = Deformer(mesh, vertices=VERTICES, **options, **subset.binding)
        self._bound = _Bound(subset.component, settings, deformer, key)
        return self._bound
