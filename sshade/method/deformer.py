"""Bind once, deform many times: new targets need only proxy solves and the prolongation to the mesh."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import Any, Literal

import numpy as np

from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.core.threads import ThreadTeam
from sshade.files.door import OpenShape, open_arguments
from sshade.mesh.mesh import Mesh, require_mesh
from sshade.method.deform import with_goal
from sshade.method.proxies import Proxies
from sshade.method.regions import all_on_targets, has_regions
from sshade.problem.handle_checks import checked_index, checked_target, ids_of
from sshade.problem.majority import HandleGroups, MajorityMotion
from sshade.problem.options import accepted, checked, require_method, resolve
from sshade.problem.stop import Stop
from sshade.problem.task import DeformationResult, DeformationTask, Handles
from sshade.proxy.frames import checked_out

#: Tolerance of :meth:`Deformer.settle`, as a multiple of the method's.
SETTLED = 0.01


class Deformer:
    """A mesh bound to its proxies, with all data that do not depend on the targets.

    Sampling, projection, frames and factorisation are made once. The first call deforms as
    :func:`sshade.deform` does. Each later call starts where the last one ended, so that small moves of the
    handles take a few iterations. :meth:`settle` then converges to the minimum. After a drag, the local
    minimum may differ from the minimum of a first call; :meth:`reset` forgets the last shape.

    Parameters
    ----------
    V, F : (n, 3) float64 and (m, 3) int, or mesh
        M: manifold, oriented, one component. Arrays, and a mesh of trimesh or pyvista, are opened as
        :func:`sshade.deform` opens them: copies of a vertex along seams move as one. A :class:`sshade.Mesh`
        is taken as it is.
    index : (h,) int or (n,) bool
        Handle vertices: ids, each once, or a mask of all vertices. Their targets come with each call, in this
        order.
    group : (h,) int, optional
        Landmark of each handle, see :class:`sshade.Handles`; by default all handles have the same.
    weight : (h,) float64 or float
        Weight of soft handles, see :class:`sshade.Handles`; by default inf, which is a hard handle.
    method : {"fast", "paper"}
        "paper" has one sampling by default.
    progress : Progress
    **options
        See :class:`sshade.problem.options.Options`.

    Raises
    ------
    InputError
        On another mesh, method or option.

    Examples
    --------
    >>> import numpy as np
    >>> from sshade import Deformer, Mesh
    >>> V = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0.1], [0, 1, 0]], dtype=float)
    >>> mesh = Mesh(V, np.array([[0, 1, 2], [0, 2, 3]]))
    >>> drag = Deformer(mesh, [0, 2], vertices=4, area=0)
    >>> for height in (0.5, 1.0):
    ...     shape = drag(V[[0, 2]] + [0, 0, height], tolerance=1e-4).vertices
    >>> shape.shape
    (4, 3)
    >>> drag.rebind_handles([0, 1, 2])
    >>> raised = drag(V[:3] + [0, 0, 1])
    >>> bool(abs(drag.settle().vertices - V - [0, 0, 1]).max() < 1e-6)
    True
    """

    def __init__(
        self,
        shape: Any,
        /,
        *arrays: Any,
        group: np.ndarray | None = None,
        weight: np.ndarray | float = inf,
        method: Literal["fast", "paper"] = "fast",
        progress: Progress = silent,
        **options: Any,
    ) -> None:
        require_method(method, ("fast", "paper"))
        names = [name for name in accepted(method) if name not in ("coarse", "accelerate")]
        values = {"samplings": 1, **checked(options, names, subject="Deformer")}
        self._shape: OpenShape | None = None
        if isinstance(shape, Mesh) and len(arrays) == 1:
            mesh, index = shape, arrays[0]
        else:
            self._shape, (index,) = open_arguments(shape, arrays, ("handles b",))
            mesh = self._shape.mesh
        self.mesh = mesh
        self._last_handles: Handles | None
        #: The majority motion of the last call, and its targets.
        self._last_majority: tuple[MajorityMotion, np.ndarray] | None
        self._inertia = bool(values.get("inertia"))
        self._take(*self._at_rest(index, group=group, weight=weight))
        # Handles that are bound later leave the options as they are.
        plain = resolve(method, values)
        resolved = resolve(method, values, regions=has_regions(mesh, self.index, plain))
        self._options = with_goal(mesh, resolved, area="area" in values)
        self._task = DeformationTask("drag", mesh, self._rest)
        self._proxies = Proxies(mesh, self._rest, self._options, keep=True, progress=progress)
        # Its threads stay: to begin and end them takes some tenths of a millisecond.
        self._team = ThreadTeam(self._proxies.carriers)

    @property
    def index(self) -> np.ndarray:
        """(k,) int64: the handle vertices of `mesh`."""
        return self._rest.index

    def rebind_handles(
        self,
        index: np.ndarray,
        *,
        group: np.ndarray | None = None,
        weight: np.ndarray | float = inf,
    ) -> None:
        """Take other handles without sampling and projecting again; the shape stays.

        The nearest vertices of the proxies stand for the handles, at targets corrected for the offset as by
        :meth:`sshade.Handles.from_positions`. A handle that was not bound from the beginning lags slightly
        during a drag; :meth:`settle` brings it to its target. Handles so near to each other that one proxy
        vertex stands for them reach their targets in the mean. Binding takes the time of a factorisation.

        Parameters
        ----------
        index, group, weight
            See :class:`Deformer`.

        Raises
        ------
        InputError
            Where handles are too far from the proxy's vertices, or one proxy vertex would stand for handles
            of two groups with different targets. The Deformer keeps its handles then. A later call may raise
            the same.
        """
        given, rest = self._at_rest(index, group=group, weight=weight)
        self._proxies.rebind(rest)
        self._take(given, rest)

    def reset(self) -> None:
        """Forget the last shape: the next call starts as the method does."""
        self._proxies.reset()
        self._last_majority = None

    def __call__(
        self,
        targets: np.ndarray,
        *,
        rotations: np.ndarray | None = None,
        tolerance: float | None = None,
        max_iterations: int | None = None,
        out: np.ndarray | None = None,
    ) -> DeformationResult:
        """Deform for new targets of the handles, from where the last call ended.

        Parameters
        ----------
        targets : (h, 3) float64
            In the order of `index`.
        rotations : (h, 3, 3) float64, optional
            Rotations of the handles, NaN where open; see :class:`sshade.Handles`. The first rotation of
            a handle makes a new factorisation of the proxy.
        tolerance, max_iterations : optional
            By default as in the options. A few iterations keep a drag fluid; the next call continues.
        out : (n, 3) float64, C-contiguous, optional
            Takes the vertices, and saves a large array a call. The result then has this array.

        Returns
        -------
        DeformationResult
            ``seconds`` has ``solve`` and ``carry``. ``facts`` has the largest ``residual`` and the mean
            ``energy`` of the proxies.
        """
        handles = self._at(targets, rotations)
        self._require_out(out)
        own = self._options.stop
        stop = Stop(
            own.tolerance if tolerance is None else tolerance,
            own.max_iterations if max_iterations is None else max_iterations,
        )
        self._last_handles = handles
        return self._deformed(handles, stop, out)

    def settle(self, *, out: np.ndarray | None = None) -> DeformationResult:
        """Converge to the minimum for the last call's targets, at the end of a drag.

        A drag lags a few hundred steps behind, and the residual is the length of one step. At the method's
        tolerance the shape is up to some thousandths of the diagonal from the minimum, at :data:`SETTLED`
        times the tolerance less than a thousandth.

        Parameters
        ----------
        out : (n, 3) float64, C-contiguous, optional

        Raises
        ------
        InputError
            Where the handles had no targets yet.
        """
        if self._last_handles is None:
            raise InputError(
                "there is nothing to settle: no targets were given since these handles were taken"
            )
        handles = self._last_handles
        if self._groups is not None:  # the motion of a drag may lag as well
            motion = self._groups.motion(handles.target)
            self._last_majority, handles = (motion, handles.target), handles.following(motion)
        self._require_out(out)
        stop = replace(self._options.stop, tolerance=SETTLED * self._options.tolerance)
        return self._deformed(handles, stop, out, settle=True)

    def _require_out(self, out: np.ndarray | None) -> None:
        if out is not None:
            checked_out(out, self.mesh.V.shape if self._shape is None else self._shape.V.shape)

    def _deformed(
        self, handles: Handles, stop: Stop, out: np.ndarray | None, *, settle: bool = False
    ) -> DeformationResult:
        task, shape = self._task.at(handles), self._shape
        whole = shape is None or len(shape.V) == self.mesh.n
        if self._proxies.covered:
            result = all_on_targets(task)
        else:
            own = out if whole else None
            result = self._proxies.deform(handles, stop=stop, settle=settle, team=self._team, out=own)
        if (majority := handles.majority) is not None:
            result = replace(result, facts=replace(result.facts, inertia=majority.state))
        if shape is not None and not whole:
            result = replace(result, vertices=shape.placed(result.vertices))
        if out is not None and result.vertices is not out:
            out[:] = result.vertices
            result = replace(result, vertices=out)
        return result.of(task) if whole else result

    def _at_rest(self, index: np.ndarray, **binding: Any) -> tuple[np.ndarray, Handles]:
        """Return the vertices of `mesh` for the given ids (h,), and the handles there, at rest.

        Copies of a vertex along a seam are one handle.
        """
        if self._shape is None:
            require_mesh(self.mesh, "Deformer")
            given = checked_index(ids_of(index, self.mesh.n), once=True)
        else:
            ids = checked_index(ids_of(index, len(self._shape.V)), once=True)
            given = self._shape.surface.places(ids)
        self.mesh.require_handles(given)
        handles = Handles(given, self.mesh.V[given], **binding)
        return given, DeformationTask("drag", self.mesh, handles).handles

    def _take(self, given: np.ndarray, rest: Handles) -> None:
        """Take handles, and their groups if inertia needs a majority motion."""
        self._given, self._rest = given, rest
        #: The first of the given handles at each handle vertex.
        self._first = np.sort(np.unique(given, return_index=True)[1])
        self._groups = HandleGroups(self.mesh, rest.index, rest.group) if self._inertia else None
        self._last_handles = None
        self._last_majority = None

    def _at(self, targets: np.ndarray, rotations: np.ndarray | None) -> Handles:
        """Return the handles at targets (h, 3), in the order in which their vertices were given."""
        if len(self._given) > len(self._rest):
            targets = checked_target(targets, self._given)[self._first]
            rotations = None if rotations is None else np.asarray(rotations)[self._first]
        handles = self._rest.at(targets, rotations)
        if self._groups is None:
            return handles
        motion = self._groups.following(self._last_majority, handles.target)
        self._last_majority = motion, handles.target
        return handles.following(motion)
