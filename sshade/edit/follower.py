"""The shape for handles: at once while they are dragged, and as the methods have it when they rest."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from sshade.edit.state import Settings
from sshade.errors import InputError
from sshade.handles import Handles
from sshade.mesh.mesh import Mesh
from sshade.options import OLD_METHODS, REGIONS
from sshade.pipeline.deform import deform
from sshade.pipeline.deformer import Deformer
from sshade.progress import Progress, silent
from sshade.task import DeformationResult, DeformationTask

#: Proxy vertices while the mouse moves: a third of those at rest. Half come a seventh nearer, for half as
#: much time again.
VERTICES = 4000
#: Residual and iterations of a step of a drag; the next one goes on. More would come nearer to the solution
#: with each picture, and show fewer.
TOLERANCE, ITERATIONS = 1e-5, 3
#: Vertices of a group that lead the proxy in a drag; the others of a larger one go straight to their targets.
#: At rest its edge is met without a crease, which here would take longer than all the rest.
LEADING = 200
#: The weight of the volume during a drag, which holds it to a thousandth or so.
VOLUME = 1e3
#: Vertices from which on other handles of a bound mesh take the nearest samples, instead of binding it anew,
#: which takes that long there, while the steps of smaller meshes become faster by it.
REBOUND = 500_000


def settled(task: DeformationTask, settings: Settings, *, progress: Progress = silent) -> DeformationResult:
    """The shape at rest, as ``sshade deform`` makes it.

    Raises
    ------
    InputError
        Where the method refuses the task.
    """
    method, options = _options(settings)
    return deform(task, method=method, progress=progress, **options)


def _options(settings: Settings) -> tuple[str, dict[str, Any]]:
    """The method's name and its options."""
    method = OLD_METHODS.get(settings.method, settings.method)
    return method, {"start": "rigid"} if method == "paper" else dict(settings.constraints)


class _Bound(NamedTuple):
    """A component, its Deformer, and what that was made for."""

    component: int
    settings: Settings
    deformer: Deformer
    handles: tuple[bytes, ...]
    #: Whether it was bound with other handles, so that these are not on samples of their own.
    rebound: bool = False


class _Led(NamedTuple):
    """Which handles of a component lead it."""

    #: The array of their groups, which handles elsewhere share.
    of: np.ndarray
    component: int
    #: Numbers of all handles there, of the hard ones, and of those that lead.
    there: np.ndarray
    hard: np.ndarray
    lead: np.ndarray
    #: Vertices of those in the component, their groups and weights.
    vertices: np.ndarray
    given: dict[str, Any]


class Follower:
    """The mesh while a group is dragged.

    Of a mesh with several components the one follows that the group lies on. It must be an oriented manifold;
    others, and other components, show what is new when the mouse rests.

    Parameters
    ----------
    mesh : Mesh
    """

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._bound: _Bound | None = None
        self._whole = mesh.topology.components == 1
        self._part: tuple[int, np.ndarray, Mesh | None] | None = None
        self._led: _Led | None = None

    def prepare(self, handles: Handles, on: int, settings: Settings) -> None:
        """Bind the component of vertex `on` with its handles, so that the first step need not.

        Raises
        ------
        InputError
            When the component cannot be bound with these handles.
        """
        _, _, part = self._component(on)
        if part is not None:
            self._bind(on, handles, settings)

    def follow(self, handles: Handles, on: int, settings: Settings, shape: np.ndarray) -> None:
        """Move what follows the handles in `shape`, from where the last call left it.

        Parameters
        ----------
        handles : Handles
            All of the mesh, at their new targets.
        on : int
            A vertex of the group that is dragged.
        settings : Settings
        shape : (n, 3) float64, C-contiguous
            Takes the positions.

        Raises
        ------
        InputError
            As for :meth:`prepare`.
        """
        _, own, part = self._component(on)
        led = self._leading(handles, on)
        lead, hard = led.lead, led.hard
        if part is None:
            shape[handles.index[led.there]] = handles.target[led.there]
            return
        rotations = None if handles.rotation is None else handles.rotation[lead]
        out = shape if self._whole else None
        while True:
            bound = self._bind(on, handles, settings)
            try:
                result = bound.deformer(
                    handles.target[lead],
                    rotations=rotations,
                    tolerance=TOLERANCE,
                    max_iterations=ITERATIONS,
                    out=out,
                )
                break
            except InputError:
                if not bound.rebound:
                    raise
                self._bound = None  # one sample was the nearest of two groups: bound anew, each has its own
        if not self._whole:
            shape[own] = result.vertices
        shape[handles.index[hard]] = handles.target[hard]

    def forget(self) -> None:
        """Let the next step begin as the method does: handles are to be elsewhere than they were."""
        if self._bound is not None:
            self._bound.deformer.reset()

    def _component(self, on: int) -> tuple[int, np.ndarray, Mesh | None]:
        """The component of a vertex, its vertices, and a mesh of it unless that cannot be bound."""
        component = int(self._mesh.component[on])
        if self._part is None or self._part[0] != component:
            if self._whole:
                own, part = np.arange(self._mesh.n), self._mesh
            else:
                own = np.flatnonzero(self._mesh.component == component)
                F = self._mesh.F[self._mesh.component[self._mesh.F[:, 0]] == component]
                part = Mesh(self._mesh.V[own], np.searchsorted(own, F))
            sound = part.is_manifold and part.is_oriented
            self._part = component, own, part if sound else None
        return self._part

    def _leading(self, handles: Handles, on: int) -> _Led:
        """Of the handles on the component of a vertex those that lead the proxy, a few of each group."""
        component, own, _ = self._component(on)
        if self._led is None or self._led.component != component or self._led.of is not handles.group:
            there = np.flatnonzero(self._mesh.component[handles.index] == component)
            rng, groups = np.random.default_rng(0), handles.group[there]
            chosen = []
            for group in np.unique(groups):
                some = there[groups == group]
                few = some if len(some) <= LEADING else np.sort(rng.choice(some, LEADING, replace=False))
                chosen.append(few)
            lead = np.concatenate(chosen)
            index = np.searchsorted(own, handles.index[lead])
            given = {"group": handles.group[lead], "weight": handles.weight[lead]}
            hard = there[handles.hard[there]]
            self._led = _Led(handles.group, component, there, hard, lead, index, given)
        return self._led

    def _bind(self, on: int, handles: Handles, settings: Settings) -> _Bound:
        """What is bound with these handles."""
        component, _, part = self._component(on)
        assert part is not None
        led = self._leading(handles, on)
        index, given = led.vertices, led.given
        key = index.tobytes(), given["group"].tobytes(), given["weight"].tobytes()
        bound, self._bound = self._bound, None
        if bound is not None and (bound.component, bound.settings) == (component, settings):
            if bound.handles != key and part.n >= REBOUND:
                try:
                    bound.deformer.rebind_handles(index, **given)
                    bound = bound._replace(handles=key, rebound=True)
                except InputError:  # too far from the samples, or two groups on one
                    bound = None
            if bound is not None and bound.handles == key:
                self._bound = bound
                return bound
        method, options = _options(settings)
        if method != "paper":
            method, regional = "fast", len(led.lead) < len(led.there)
            edges = {name: REGIONS[method][name] for name in ("area", "bending") if regional}
            options = {"volume": VOLUME, **edges, **options}
        binding: Any = {"method": method, "vertices": VERTICES, **options, **given}
        deformer = Deformer(part, index, **binding)
        self._bound = _Bound(component, settings, deformer, key)
        return self._bound
