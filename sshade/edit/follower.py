"""Compute the shape for handles: a few iterations for each step of a drag, all iterations at rest."""

from __future__ import annotations

from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.mesh.mesh import Mesh
from sshade.method.call import deform
from sshade.method.deformer import Deformer
from sshade.problem.handles import Handles
from sshade.problem.options import REGIONS
from sshade.problem.task import DeformationResult, DeformationTask

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


def converged(task: DeformationTask, method: str, *, progress: Progress = silent) -> DeformationResult:
    """Return the converged shape, which equals the result of ``sshade deform``.

    Raises
    ------
    InputError
        When the method refuses the task.
    """
    return deform(task, method=method, progress=progress)


class _FollowedPart(NamedTuple):
    """A component of the mesh and its handles; the proxy takes at most :data:`REDUCED` of each group.

    Attributes
    ----------
    component : int
    vertices : (k,) int64
    mesh : Mesh or None
        None unless the component is an oriented manifold.
    group : array
        Array ``Handles.group`` of all handles.
    members, hard, reduced : (h,) int64
        Numbers of all handles on the component, of its hard handles, and of the handles that the proxy takes.
    binding : dict
        Vertices in the component, groups and weights of the reduced handles.
    """

    component: int
    vertices: np.ndarray
    mesh: Mesh | None
    group: np.ndarray
    members: np.ndarray
    hard: np.ndarray
    reduced: np.ndarray
    binding: dict[str, Any]


class _Bound(NamedTuple):
    """A Deformer, and the component, method and handles that it was bound for."""

    component: int
    method: str
    deformer: Deformer
    handles: tuple[Any, ...]
    #: Whether the handles were bound to the nearest samples, after binding with other handles.
    rebound: bool = False


class Follower:
    """Deform the mesh during a drag.

    Only the component of the dragged group is deformed, if it is an oriented manifold. Everything else is
    deformed when the mouse rests.

    Parameters
    ----------
    mesh : Mesh
    """

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._connected = mesh.topology.components == 1
        self._last: _FollowedPart | None = None
        self._bound: _Bound | None = None

    def prepare(self, handles: Handles, on: int, method: str) -> None:
        """Bind the component of the vertex `on` in advance.

        Raises
        ------
        InputError
            When the component cannot be bound with these handles.
        """
        part = self._part(handles, on)
        if part.mesh is not None:
            self._bind(part, part.mesh, method)

    def follow(self, handles: Handles, on: int, method: str, shape: np.ndarray) -> None:
        """Continue the deformation for new targets.

        Parameters
        ----------
        handles : Handles
            All handles of the mesh, at their new targets.
        on : int
            A vertex of the dragged group.
        method : {"fast", "fine", "paper"}
        shape : (n, 3) float64, C-contiguous
            Positions, of which the moved ones are overwritten.

        Raises
        ------
        InputError
            See :meth:`prepare`.
        """
        part = self._part(handles, on)
        if part.mesh is None:
            shape[handles.index[part.members]] = handles.target[part.members]
            return
        step: dict[str, Any] = {"tolerance": TOLERANCE, "max_iterations": ITERATIONS}
        step["rotations"] = None if handles.rotation is None else handles.rotation[part.reduced]
        step["out"] = shape if self._connected else None
        bound = self._bind(part, part.mesh, method)
        try:
            result = bound.deformer(handles.target[part.reduced], **step)
        except InputError:
            if not bound.rebound:
                raise
            # Two groups share their nearest sample. Bound anew, each group has samples of its own.
            self._bound = None
            bound = self._bind(part, part.mesh, method)
            result = bound.deformer(handles.target[part.reduced], **step)
        if not self._connected:
            shape[part.vertices] = result.vertices
        shape[handles.index[part.hard]] = handles.target[part.hard]

    def forget(self) -> None:
        """Start the next step anew, because the handles are not where the last step left them."""
        if self._bound is not None:
            self._bound.deformer.reset()

    def _part(self, handles: Handles, on: int) -> _FollowedPart:
        """Return the component of a vertex with its handles."""
        last, number = self._last, int(self._mesh.component[on])
        if last is not None and last.component == number:
            if last.group is handles.group:
                return last
            vertices, mesh = last.vertices, last.mesh
        else:
            vertices, mesh = np.flatnonzero(self._mesh.component == number), self._mesh
            if not self._connected:
                mesh = mesh.part(vertices, mesh.component[mesh.F[:, 0]] == number)
            mesh = mesh if mesh.is_manifold and mesh.is_oriented else None
        members = np.flatnonzero(self._mesh.component[handles.index] == number)
        rng, chosen = np.random.default_rng(0), []
        for group in np.unique(handles.group[members]):
            few = members[handles.group[members] == group]
            chosen.append(few if len(few) <= REDUCED else np.sort(rng.choice(few, REDUCED, replace=False)))
        reduced = np.concatenate(chosen)
        binding = {"index": np.searchsorted(vertices, handles.index[reduced])}
        binding |= {"group": handles.group[reduced], "weight": handles.weight[reduced]}
        hard = members[handles.hard[members]]
        self._last = _FollowedPart(number, vertices, mesh, handles.group, members, hard, reduced, binding)
        return self._last

    def _bind(self, part: _FollowedPart, mesh: Mesh, method: str) -> _Bound:
        """Return a Deformer that is bound with the reduced handles."""
        key = tuple(values.tobytes() for values in part.binding.values())
        bound, self._bound = self._bound, None
        if bound is not None and (bound.component, bound.method) == (part.component, method):
            if bound.handles != key and mesh.n >= REBOUND:
                # A handle may be too far from the samples, or two groups may share a sample.
                with suppress(InputError):
                    bound.deformer.rebind_handles(**part.binding)
                    bound = bound._replace(handles=key, rebound=True)
            if bound.handles == key:
                self._bound = bound
                return bound
        options: dict[str, Any] = {}
        if method != "paper":
            is_region = len(part.reduced) < len(part.members)
            regional = {name: REGIONS["fast"][name] for name in ("area", "bending") if is_region}
            options = {"volume": VOLUME, **regional}
        options["method"] = "paper" if method == "paper" else "fast"
        binding = dict(part.binding)
        deformer = Deformer(mesh, binding.pop("index"), vertices=VERTICES, **options, **binding)
        self._bound = _Bound(part.component, method, deformer, key)
        return self._bound
