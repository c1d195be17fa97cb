"""A proxy that is solved again and again: for targets that follow each other, and for other handles."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.core.threads import in_threads
from sshade.mesh.ids import numbered
from sshade.mesh.mesh import Mesh
from sshade.method.engine import BoundProxy, Engine, solve_proxy, solver_threads
from sshade.problem.options import ENERGY, SOLVER, Options
from sshade.problem.snapping import snap_to_vertices
from sshade.problem.task import DeformationResult, DeformationTask, Handles
from sshade.proxy.neighbours import sums_by_index
from sshade.solver.attachment import Attachment
from sshade.solver.following import Following
from sshade.solver.local_global import LocalGlobal, local_global
from sshade.solver.start import initial_guess


class Drag:
    """Solve a proxy from where its last solve ended, with one factorisation for all targets.

    The first solve starts as the method does. After a change of the energy or of the handles, the next solve
    starts from the last shape.

    Parameters
    ----------
    proxy : Mesh
        N.
    handles : Handles
        On N, at rest.
    options : Options
    """

    def __init__(self, proxy: Mesh, handles: Handles, options: Options) -> None:
        self._proxy, self._options = proxy, options
        #: Handles whose rotations the attachment knows. A new one needs another attachment.
        self._rotated = handles.has_rotation
        self._attachment = Attachment(proxy, handles, options.attachment)
        attachment = self._attachment
        self._solver = LocalGlobal(
            proxy,
            attachment.vertex,
            stiffness=attachment.stiffness,
            bending=options.bending,
            thickness=options.thickness,
        )
        self._solver.factorise()
        self.reset()

    @property
    def at_start(self) -> bool:
        """Whether no solve has run yet with the present handles and energy."""
        return self._following is None

    def reset(self) -> None:
        """Forget the last solve, its shape and rotations."""
        self._following: Following | None = None
        self._last: tuple[np.ndarray, np.ndarray] | None = None

    def start_at(self, V: np.ndarray) -> None:
        """Start the next solve at positions V (k, 3) of the proxy's vertices."""
        self._following = None
        self._last = V, np.tile(np.eye(3), (len(V), 1, 1))

    def change(self, options: Options) -> None:
        """Solve with another energy from now on, from the present shape."""
        self._options, self._following = options, None

    def with_handles(self, handles: Handles) -> Drag:
        """Return a solver for other handles on N, which starts at the present shape."""
        other = copy(self)
        other._take(handles)
        return other

    def _take(self, handles: Handles) -> None:
        attachment = Attachment(self._proxy, handles, self._options.attachment)
        self._solver = self._solver.with_handles(attachment.vertex, stiffness=attachment.stiffness)
        self._attachment, self._rotated, self._following = attachment, handles.has_rotation, None

    def __call__(self, handles: Handles, *, volume_goal: float, **stop: Any) -> DeformationResult:
        if (handles.has_rotation & ~self._rotated).any():
            self._take(handles)
        targets, fraction = self._attachment.pulls(handles.target, handles.rotation)
        aim: dict[str, Any] = {"targets": targets, "fraction": fraction, "volume_goal": volume_goal}
        aim["prescribed"] = handles.prescribed_rotations
        energy: dict[str, Any] = self._options.subset(ENERGY)
        energy["workers"] = solver_threads(self._options)
        if self._following is None and self._last is not None:
            at = self._last[0][self._solver.index]
            self._following = Following(self._solver, *self._last, at, **energy)
        try:
            if self._following is None:
                result = self._first(handles, aim, replace(self._options, **stop))
                R = result.extra["rotations"]
                self._following = Following(self._solver, result.vertices, R, **aim, **energy)
            else:
                result = self._following.solve(**aim, **stop).result()
        except FloatingPointError:  # the positions are of no use to the next solve
            self.reset()
            raise
        self._last = result.vertices, result.extra["rotations"]
        return result

    def _first(self, handles: Handles, aim: Mapping[str, Any], options: Options) -> DeformationResult:
        def solve(task: DeformationTask, *, tolerance: float, **context: Any) -> DeformationResult:
            if task.mesh is not self._proxy:  # a coarser proxy
                return local_global(task, **{**options.subset(SOLVER), "tolerance": tolerance}, **context)
            del context["seed"]
            stop: dict[str, Any] = {"tolerance": tolerance, "max_iterations": options.max_iterations}
            guess = initial_guess(task, options.start)
            context |= {**aim, **stop, **options.subset(ENERGY)}
            return self._solver.solve(start=guess, **context).result()

        task = DeformationTask("drag", self._proxy, handles)
        return solve_proxy(task, options, solve=solve, volume_goal=aim["volume_goal"], seed=options.seed)


def bound_proxies(
    engine: Engine, rest: Handles, options: Options, *, progress: Progress = silent
) -> list[BoundProxy]:
    """Bind a mesh to the proxies of its engine, each solved by a :class:`Drag`.

    Parameters
    ----------
    engine : Engine
    rest : Handles
        On the mesh, at rest. There are no proxies if every vertex is a hard handle.
    options : Options
    progress : Progress
    """

    def bind(number: int) -> BoundProxy:
        with ThreadPoolExecutor(max_workers=1) as pool:
            bound = engine.bind(number, pool, lambda proxy, _, place: Drag(proxy, place(rest), options))
        bound.binding  # noqa: B018 - raises errors of the binding
        progress("binding", number + 1, engine.proxies.samplings)
        return bound

    samplings = 0 if engine.regions.covered else engine.proxies.samplings
    return in_threads(bind, samplings, workers=engine.proxies.workers)


class NearestPlacement:
    """Places handles of M on the nearest vertices of a proxy N that was sampled for other handles.

    Parameters
    ----------
    mesh, proxy : Mesh
        M and N.
    rest : Handles
        Of M, at rest.

    Attributes
    ----------
    rest : Handles
        Of N, at rest. One handle of N may stand for several handles of M.

    Raises
    ------
    InputError
        When handles are far from the vertices of N; and see :meth:`sshade.Handles.from_positions`.
    """

    def __init__(self, mesh: Mesh, proxy: Mesh, rest: Handles) -> None:
        self._mesh, self._proxy = mesh, proxy
        try:
            _, nearest = snap_to_vertices(proxy, mesh.V[rest.index], rest.group)
        except InputError as error:
            raise InputError(
                "the proxy has no vertices near some of these handles, as inside of handle regions; make "
                f"another Deformer for them ({error})"
            ) from error
        self.rest = self._snapped(rest)
        number = numbered(self.rest.index, proxy.n)
        #: The handle of N that stands for each handle of M, and corrections of the targets of N's handles.
        self._stands_for, self._farthest = number[nearest], 2 * self.rest.snap_distance
        self.forget()

    def forget(self) -> None:
        """Correct no target until the next :meth:`learn`."""
        self._shift = np.zeros((len(self.rest), 3))

    def __call__(self, handles: Handles) -> Handles:
        """Return handles of N at targets corrected for where the last call missed."""
        snapped = self._snapped(handles)
        return replace(snapped, target=snapped.target + self._shift)

    def learn(self, handles: Handles, V: np.ndarray) -> float:
        """Correct the targets on N for the distance of M' (n, 3) from the hard handles' targets.

        The correction is limited to the largest displacement that a rotation of the group can cause.

        Returns
        -------
        float
            The largest distance, in the unit of length.
        """
        missed, number = handles.target - V[handles.index], self._stands_for
        missed[~handles.hard] = 0.0
        count = np.bincount(number)
        self._shift += sums_by_index(number, missed, len(count)) / count[:, None]
        length = np.linalg.norm(self._shift, axis=1)
        self._shift *= (np.minimum(length, self._farthest) / np.where(length > 0, length, 1.0))[:, None]
        return float(np.linalg.norm(missed, axis=1).max())

    def _snapped(self, handles: Handles) -> Handles:
        return Handles.from_positions(
            self._proxy,
            self._mesh.V[handles.index],
            handles.target,
            group=handles.group,
            weight=handles.weight,
            rotation=handles.rotation,
            strict=False,  # a sample of the proxy stands for many vertices
        ).with_portions(self._proxy)
