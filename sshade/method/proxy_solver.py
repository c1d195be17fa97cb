"""Solve a proxy: once from a coarser proxy and the better of two starts, or step by step in a drag.

Large motions need many local/global iterations but little detail. A proxy with a sixth of the vertices
finds them in a sixth of the time, at a tenth of the accuracy; the solve on the full proxy then starts near
its minimum.

The start also decides which minimum is found, because handles alone do not say to which side a knee bends.
On the coarsest proxy the solver therefore minimises a guide energy first, in which handles attach whole parts
of the body. It also starts once from the rest shape or the rigid motion of the handles. The second result is
used only where its energy is clearly lower. More starts do not pay: they end lower by more than a few per
cent only where a far twist collapses and intersects itself.
"""

from __future__ import annotations

import logging
from concurrent.futures import CancelledError
from contextlib import AbstractContextManager, nullcontext
from copy import copy
from dataclasses import replace
from functools import partial
from threading import Event

import numpy as np

from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.core.threads import SMALL, Later, Pending, available_cpus, beside
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.mesh import Mesh
from sshade.problem.options import Options, Stop
from sshade.problem.task import DeformationTask, Handles
from sshade.proxy.binding import bind_proxy, frame_maker
from sshade.proxy.sample import proxy_mesh, proxy_vertices
from sshade.regions.handle_regions import HandleRegions
from sshade.regions.placement import sample_with_handles
from sshade.solver.aim import Aim, initial_guess, largest_pressures
from sshade.solver.attachment import Attachment
from sshade.solver.drag import Drag
from sshade.solver.local_global import BoundSystem, bind_system, solve
from sshade.solver.solution import Solution
from sshade.solver.system import System

log = logging.getLogger(__name__)

#: Number of vertices below which a coarser proxy saves no time.
SMALLEST = 3000
#: Ratio of a proxy's vertices to its coarser proxy's, and smallest ratio of the coarser proxy's vertices to
#: handles. ROOM is also the smallest ratio of vertices where many handles enlarge the coarser proxy.
RATIO, ROOM = 6, 2
#: Tolerance on the coarser proxy, as a multiple of the tolerance asked for.
ROUGH = 10.0
#: Ratio of energies below which the result from the plain start replaces the result from the guide.
CLEARLY_LOWER = 0.9
#: Largest area weight of the guide energy.
GUIDE_AREA = 1.0


class ProxySolver:
    """The solver of a proxy N: ours, or the user's method ``options.proxy_method``.

    Parameters
    ----------
    proxy : Mesh
        N.
    options : Options
    keep_for : Handles, optional
        Of N, at rest. The solver is then factorised now, and keeps the factors and the state of the last
        solve for a drag: each solve starts where the last one ended. By default it frees what it made.
    guess : (k, 3) float64, optional
        Shape in which the first solve starts; by default as the options say.
    coarser : bool
        Whether the first solve may start on a coarser proxy.
    progress, coarser_progress : Progress
    """

    def __init__(
        self,
        proxy: Mesh,
        options: Options,
        *,
        keep_for: Handles | None = None,
        guess: np.ndarray | None = None,
        coarser: bool = True,
        progress: Progress = silent,
        coarser_progress: Progress = silent,
    ) -> None:
        self._proxy = proxy
        self._options = options
        self._coarser = coarser
        self._progress = progress
        self._coarser_progress = coarser_progress
        self._workers = solver_threads(options, proxy.n)
        self._system: System | None = None
        if keep_for is not None:
            self._attach(keep_for)
            attachment = self._attachment
            self._system = System(proxy, attachment.vertex, options, stiffness=attachment.stiffness)
            self._system.factorise()
        self.reset(guess)

    @property
    def at_start(self) -> bool:
        """Whether the next solve begins a drag, or starts as the options say."""
        return self._drag is None

    def reset(self, guess: np.ndarray | None = None) -> None:
        """Forget the last solve; start at positions (k, 3) of the proxy's vertices, or as the options say."""
        self._drag: Drag | None = None
        self._last = guess
        self._last_rotations: np.ndarray | None = None

    def with_handles(self, handles: Handles) -> ProxySolver:
        """Return a kept solver for other handles of N, which starts at the present shape."""
        other = copy(self)
        other._take(handles)
        return other

    def _attach(self, handles: Handles) -> None:
        self._attachment = Attachment(self._proxy, handles, self._options.attachment)
        #: Handles whose rotations the attachment knows. A new one needs another attachment.
        self._rotated = handles.has_rotation

    def _take(self, handles: Handles) -> None:
        assert self._system is not None
        self._attach(handles)
        attachment = self._attachment
        self._system = self._system.with_handles(attachment.vertex, stiffness=attachment.stiffness)
        self._drag = None

    def solve(self, handles: Handles, *, volume_goal: float, stop: Stop) -> Solution:
        """Solve N for handles at their targets.

        Parameters
        ----------
        handles : Handles
            Of N.
        volume_goal : float
            Volume of N', as a multiple of the volume of N.
        stop : Stop

        Raises
        ------
        FloatingPointError
            When an iterate is not finite. A kept solver must then be :meth:`reset`.
        """
        options, n, progress = self._options, self._proxy.n, self._progress
        task = DeformationTask("proxy", self._proxy, handles, guess=self._last)
        if options.proxy_method is not None:
            return Solution.of_method(options.proxy_method(task, seed=options.seed, progress=progress))
        if self._system is not None and (handles.has_rotation & ~self._rotated).any():
            self._take(handles)
        with self._bound(task, handles, volume_goal) as bound:
            if self._system is not None and self._last is not None:
                return self._follow(bound.result().aim, stop)
            minimum = partial(self._minimum, task, bound, stop)
            if self._last is not None or not options.multilevel:
                found = minimum(self._last, progress)
            elif (rough := self._on_coarser(task, stop)) is not None:
                found = replace(
                    minimum(rough.positions, progress, softened=True), coarser_iterations=rough.iterations
                )
            elif not options.guide_attachment:
                found = replace(minimum(None, progress), coarser_iterations=0.0)
            else:
                guide = replace(
                    options,
                    attachment=options.guide_attachment,
                    stiffness=1.0,
                    area=min(options.area, GUIDE_AREA),
                )
                # An error of one solve, such as an interrupt, ends the other at its next report of progress.
                failed = Event()
                with beside(
                    partial(minimum, None, partial(_report_unless, failed, progress)), size=n
                ) as plain:
                    try:
                        to_guide = bind_system(task, guide, volume_goal=volume_goal)
                        at_guide = solve(
                            to_guide.system,
                            to_guide.aim,
                            guide,
                            start=initial_guess(task, options.start),
                            stop=stop,
                            workers=self._workers,
                            progress=progress,
                        )
                        guided = minimum(at_guide.positions, progress)
                        found = replace(_lower(plain.result(), guided), coarser_iterations=0.0)
                    except BaseException:
                        failed.set()
                        raise
        self._end_at(found, bound)
        return found

    def _bound(
        self, task: DeformationTask, handles: Handles, volume_goal: float
    ) -> AbstractContextManager[Pending[BoundSystem]]:
        """Bind the handles of a task, beside what follows, or take the kept system."""
        if self._system is None:
            set_up = partial(bind_system, task, self._options, volume_goal=volume_goal)
            return beside(set_up, size=self._proxy.n)
        targets, fraction = self._attachment.pulls(handles.target, handles.rotation)
        pressure = largest_pressures(self._proxy, handles, self._options)
        aim = Aim(targets, handles.prescribed_rotations, fraction, volume_goal, pressure)
        kept = BoundSystem(self._system, aim)
        return nullcontext(Later(lambda: kept))

    def _minimum(
        self,
        task: DeformationTask,
        bound: Pending[BoundSystem],
        stop: Stop,
        guess: np.ndarray | None,
        progress: Progress,
        *,
        softened: bool = False,
    ) -> Solution:
        """Solve a task from a guess, or from the start that the options name."""
        ready = bound.result()
        return solve(
            ready.system,
            ready.aim,
            self._options,
            start=initial_guess(replace(task, guess=guess), self._options.start),
            stop=stop,
            workers=self._workers,
            softened=softened,
            progress=progress,
        )

    def _on_coarser(self, task: DeformationTask, stop: Stop) -> Solution | None:
        """Deform N through a coarser proxy, at its own volume; return None where that does not help.

        Small proxies, below :data:`SMALLEST` vertices, proxies with many handles, and thin proxies whose
        topology a coarser proxy cannot keep have no coarser proxy.
        """
        mesh, handles, options = task.mesh, task.handles, self._options
        size = max(mesh.n // RATIO, ROOM * len(handles))
        if not self._coarser or mesh.n < SMALLEST or size > mesh.n // ROOM:
            return None
        try:
            mesh.require_one_component()
            vertices = proxy_vertices(size, mesh.n, len(handles), coarser=ROOM)
            regions = HandleRegions(mesh, handles, vertices=vertices, graph=vertex_graph(mesh))
            sampling, place = sample_with_handles(mesh, regions, (options.seed, 0))
            frames = frame_maker("blended")
            with beside(partial(bind_proxy, mesh, sampling, frames=frames), size=mesh.n) as binding:
                coarser = proxy_mesh(mesh, sampling)
                solver = ProxySolver(coarser, options, coarser=False, progress=self._coarser_progress)
                rough = replace(stop, tolerance=ROUGH * stop.tolerance)
                found = solver.solve(place(handles), volume_goal=1.0, stop=rough)
                V, _ = binding.result().carry(found.positions, rotations=found.rotations)
            V = regions.on_targets(V, handles)
        except InputError as error:
            log.info("solved without a coarser proxy of %d vertices: %s", size, error)
            return None
        return replace(found, positions=V)

    def _follow(self, aim: Aim, stop: Stop) -> Solution:
        """Solve from where the last solve ended."""
        assert self._system is not None and self._last is not None
        if self._drag is None:
            R = self._last_rotations
            R = np.tile(np.eye(3), (len(self._last), 1, 1)) if R is None else R
            at = Aim(self._last[self._system.handles.index])
            self._drag = Drag(self._system, self._last, R, at, self._options, workers=self._workers)
        found = self._drag.solve(aim, stop)
        self._last = found.positions
        self._last_rotations = found.rotations
        return found

    def _end_at(self, found: Solution, bound: Pending[BoundSystem]) -> None:
        """Let the next solve start at a solution."""
        self._last = found.positions
        self._last_rotations = found.rotations
        if self._system is not None:
            assert found.rotations is not None
            aim, options = bound.result().aim, self._options
            V, R = found.positions, found.rotations
            self._drag = Drag(self._system, V, R, aim, options, workers=self._workers)


def solver_threads(options: Options, n: int) -> int:
    """Return the number of threads that share an iteration on a proxy of n vertices.

    One thread iterates if samplings share the CPUs, or the proxy is small.
    """
    return (options.workers or available_cpus()) if options.samplings == 1 and n >= SMALL else 1


def _lower(plain: Solution, guided: Solution) -> Solution:
    """Return the solution from the guide, unless the plain one has a clearly lower energy."""
    assert plain.energy is not None and guided.energy is not None
    return plain if plain.energy < CLEARLY_LOWER * guided.energy else guided


def _report_unless(
    failed: Event, progress: Progress, stage: str, done: int, total: int, note: str = ""
) -> None:
    if failed.is_set():
        raise CancelledError
    progress(stage, done, total, note)
