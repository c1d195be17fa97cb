"""A connected, oriented manifold M with its handles, and its proxies, whose results are averaged.

The steps of the paper for each proxy: sample N, bind M to it, solve N, and prolong its deformation to M. A
one-off deformation makes a proxy and frees it. A drag and a sequence keep the proxies: each deformation then
reuses the samples, the binding and the factorised solver.

F. Maggioli, D. Baieri, Z. Laehner, S. Melzi, "SShaDe: scalable shape
deformation via local representations", algorithm 1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from math import inf
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from sshade.core.errors import InputError
from sshade.core.progress import Progress, renamed, silent
from sshade.core.threads import ThreadTeam, available_cpus, beside, in_threads, number_of_workers
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.mesh import Mesh
from sshade.method.proxy_solver import ProxySolver, solver_threads
from sshade.problem.facts import Facts
from sshade.problem.options import Options, Stop
from sshade.problem.task import DeformationResult, DeformationTask, Handles, joined
from sshade.proxy.binding import Binding, bind_proxy, frame_maker
from sshade.proxy.projection import Projector, project_to_fans
from sshade.proxy.sample import proxy_mesh, proxy_vertices
from sshade.regions.handle_regions import HandleRegions, all_on_targets
from sshade.regions.placement import NearestPlacement, Sampler, sample_with_handles
from sshade.solver.joints import with_round_joints

#: Number of mesh vertices from which on several threads prolong N' to M'.
LARGE = 50_000


#: Relative volume deficit of M' above which the proxy is solved again, and largest number of further solves,
#: whether for the volume or for handles.
VOLUME_ERROR, VOLUME_ROUNDS = 1e-3, 3
#: Tolerance of a pose whose joints are made round afterwards, as a multiple of the method's.
POSE = 2.0
#: Largest distance of a hard handle from its target that needs no further solve, as a fraction of the
#: bounding-box diagonal.
MET = 1e-5


class Recipe(NamedTuple):
    """How a part is deformed. A baseline may replace each step.

    Attributes
    ----------
    sample : Sampler
        How M is sampled.
    projection : Projector
        The projection P onto a proxy.
    part : callable, optional
        Deforms a connected, oriented manifold in place of proxies: ``part(task, progress)``.
    """

    sample: Sampler = sample_with_handles
    projection: Projector = project_to_fans
    part: Callable[[DeformationTask, Progress], DeformationResult] | None = None


class Piece:
    """A connected, oriented manifold M, its handle vertices, and its proxies.

    Parameters
    ----------
    mesh : Mesh
        M: manifold, oriented, one component.
    handles : Handles
        Only their vertices, groups and weights matter, and which handles have a rotation.
    options : Options
        Of the proxies.
    recipe : Recipe
    keep : bool
        Bind M to its proxies now and keep them: each deformation then starts from the last one. Otherwise
        each deformation makes new proxies, and frees them.
    progress : Progress
        Of the bindings, if the proxies are kept.

    Attributes
    ----------
    mesh, handles, options, recipe
        The parameters.
    frames : FrameMaker
    regions : HandleRegions
        Of the present handles.
    vertices : int
        Number of samples.
    faces_without_area : int
    kept : list of Proxy
        Kept proxies; none if every vertex is a hard handle.

    Raises
    ------
    InputError
        On another mesh, or where it cannot be sampled.
    """

    def __init__(
        self,
        mesh: Mesh,
        handles: Handles,
        options: Options,
        *,
        recipe: Recipe | None = None,
        keep: bool = False,
        progress: Progress = silent,
    ) -> None:
        self.mesh = mesh
        self.options = options
        self.recipe = recipe or Recipe()
        self.faces_without_area = int(mesh.without_area.sum())
        self.frames = frame_maker(options.frames)
        begin = perf_counter()
        self._graph = vertex_graph(mesh)
        self._graph_seconds = perf_counter() - begin
        mesh.require_manifold()
        mesh.require_one_component()
        self.vertices = proxy_vertices(options.vertices, mesh.n, len(handles), coarser=options.coarser)
        self._take(handles)
        self.kept: list[Proxy] = []
        #: Threads of a drag stay, because to begin and end them takes some tenths of a millisecond.
        self._team = ThreadTeam(self._carriers if keep else 1)
        if keep and not self.regions.covered:
            bind = partial(self._bound, handles.at(mesh.V[handles.index], handles.rotation), progress)
            self.kept = in_threads(bind, options.samplings, workers=options.workers)

    def _take(self, handles: Handles) -> None:
        self.handles = handles
        self.regions = HandleRegions(
            self.mesh,
            handles,
            vertices=self.vertices,
            graph=self._graph,
            volume_goal=self.options.volume_goal,
        )

    def fits(self, handles: Handles, vertices: int | None) -> bool:
        """Whether the piece can go on with handles; also with a number of samples, if one is given.

        With a number of samples, handles with rotations must be the same, too.
        """
        own = self.handles
        same = np.array_equal(own.index, handles.index) and np.array_equal(own.group, handles.group)
        same = same and np.array_equal(own.weight, handles.weight)
        if vertices is None or not same:
            return same
        return vertices == self.options.vertices and np.array_equal(own.has_rotation, handles.has_rotation)

    def _bound(self, handles: Handles, progress: Progress, number: int) -> Proxy:
        proxy = Proxy(self, number, keep_for=handles)
        progress("binding", number + 1, self.options.samplings)
        return proxy

    @property
    def _carriers(self) -> int:
        """Number of threads that prolong each N' to M': one if samplings share the CPUs, or M is small."""
        return available_cpus() if self.options.samplings == 1 and self.mesh.n >= LARGE else 1

    def deform(
        self,
        task: DeformationTask,
        *,
        stop: Stop | None = None,
        at_once: bool = True,
        out: np.ndarray | None = None,
        proxies: list[tuple[np.ndarray, np.ndarray]] | None = None,
        progress: Progress = silent,
    ) -> DeformationResult:
        """Average M' over the samplings, and put it on its targets or correct its volume.

        Parameters
        ----------
        task : DeformationTask
            Of M. Kept proxies start at its guess, if it has one.
        stop : Stop, optional
            By default the options' own.
        at_once : bool
            Correct volume and targets by further solves at once. Without it, only a first deformation is.
        out : (n, 3) float64, C-contiguous, optional
            Takes the positions, if there is one proxy.
        proxies : list of ((k,) int64, (l, 3) int64), optional
            Takes the samples and the faces of the first proxy.
        progress : Progress
            Of proxies that are not kept.
        """
        if self.regions.covered:
            return all_on_targets(task)
        options, handles, guess = self.options, task.handles, task.guess
        stop, seen = stop or options.stop, [] if proxies is None else proxies
        if guess is not None:
            self.reset(guess)
        with ThreadTeam(1 if self.kept else self._carriers) as own_team:
            team = self._team if self.kept else own_team
            if options.samplings == 1:
                proxy = self.kept[0] if self.kept else Proxy(self, 0, guess=guess, progress=progress)
                seen.append((proxy.sampling.samples, proxy.mesh.F))
                results = [proxy.deform(handles, stop=stop, at_once=at_once, team=team, out=out)]
                V = results[0].vertices
            else:

                def run(number: int) -> DeformationResult:
                    kept = self.kept[number] if self.kept else None
                    proxy = kept or Proxy(self, number, guess=guess, progress=progress)
                    if number == 0:
                        seen.append((proxy.sampling.samples, proxy.mesh.F))
                    return proxy.deform(handles, stop=stop, at_once=at_once, team=team)

                with ThreadPoolExecutor(max_workers=threads_of(options)) as pool:
                    V, results = mean_of(pool.map(run, range(options.samplings)))
        # With a corrected volume, each M' is on its targets.
        yields = any("yielding" in (result.facts.volume_constraint or "") for result in results)
        if corrects_volume(options) and not yields:
            V = self.regions.correct_volume(V)
        else:
            V = self.regions.on_targets(V, handles)
        return of_samplings(V, results, graph_seconds=self._graph_seconds)

    def reset(self, guess: np.ndarray | None = None) -> None:
        """Let kept proxies start at a shape (n, 3) of M, or as the method does."""
        for proxy in self.kept:
            proxy.reset(guess)

    def rebound(self, handles: Handles) -> list[Any]:
        """Return what kept proxies need for other handles of M, at rest; the shape stays.

        Raises
        ------
        InputError
            Where handles are too far from the vertices of a proxy.
        """
        if not self.kept:
            raise InputError("all vertices were handles when the mesh was bound; make another Deformer")
        return [proxy.rebound(handles) for proxy in self.kept]

    def use(self, handles: Handles, found: list[Any]) -> None:
        """Go on with other handles and the result of :meth:`rebound`."""
        for proxy, (place, solver) in zip(self.kept, found, strict=True):
            proxy.use(place, solver)
        self._take(handles)


class Proxy:
    """A proxy N of a mesh M: its samples, the binding of M to it, and its solver.

    Parameters
    ----------
    piece : Piece
        M, and the data that its proxies share.
    number : int
        Number of the sampling; with the seed it chooses the samples.
    keep_for : Handles, optional
        Handles of M, at rest. The proxy is then kept for many deformations: M is bound to it and its solver
        is factorised now, and each deformation starts from the last one. By default it serves one
        deformation, beside whose solve M is bound.
    guess : (n, 3) float64, optional
        Shape of M in which the one deformation starts; a kept proxy gets it by :meth:`reset`.
    progress : Progress

    Attributes
    ----------
    mesh : Mesh
        N.
    sampling : Sampling
    """

    def __init__(
        self,
        piece: Piece,
        number: int,
        *,
        keep_for: Handles | None = None,
        guess: np.ndarray | None = None,
        progress: Progress = silent,
    ) -> None:
        self._piece = piece
        options = piece.options
        stage = "proxy" if options.samplings == 1 else f"proxy {number + 1}"
        progress(stage, 0, options.max_iterations)
        begin = perf_counter()
        self.sampling, self._place = piece.recipe.sample(piece.mesh, piece.regions, (options.seed, number))
        self._sampling_seconds = perf_counter() - begin
        self.mesh = proxy_mesh(piece.mesh, self.sampling)
        self._binding: Binding | None = None
        self._goal = options.volume_goal or 1.0
        self._is_kept = keep_for is not None
        if keep_for is None:
            self._solver = ProxySolver(
                self.mesh,
                options,
                guess=None if guess is None else guess[self.sampling.samples],
                progress=renamed(progress, stage),
                coarser_progress=renamed(progress, f"coarser {stage}"),
            )
        else:
            with beside(self._bind, size=piece.mesh.n) as binding:  # the solver is factorised beside it
                self._solver = ProxySolver(self.mesh, options, keep_for=self._place(keep_for))
                self._binding = binding.result()

    def _bind(self) -> Binding:
        """Find where the vertices of M lie on N, and prepare the :class:`HandleRegions` of M."""
        piece = self._piece
        projection = piece.recipe.projection
        binding = bind_proxy(piece.mesh, self.sampling, frames=piece.frames, projection=projection)
        piece.regions.prepare()
        return binding

    @property
    def binding(self) -> Binding:
        """The binding of M to N; the first deformation makes it beside the solve."""
        assert self._binding is not None
        return self._binding

    def reset(self, guess: np.ndarray | None = None) -> None:
        """Forget the last shape and all corrections; start at a shape (n, 3) of M, or as the method does."""
        self._solver.reset(None if guess is None else guess[self.sampling.samples])
        self._goal = self._piece.options.volume_goal or 1.0
        self._place.forget()

    def rebound(self, handles: Handles) -> tuple[NearestPlacement, ProxySolver]:
        """Return the placement and the solver of other handles of M, at rest; the shape stays."""
        place = NearestPlacement(self._piece.mesh, self.mesh, handles)
        return place, self._solver.with_handles(place.rest)

    def use(self, place: NearestPlacement, solver: ProxySolver) -> None:
        """Go on with a placement and a solver of :meth:`rebound`."""
        self._place = place
        self._solver = solver

    def deform(
        self,
        handles: Handles,
        *,
        stop: Stop,
        at_once: bool = True,
        team: ThreadTeam,
        out: np.ndarray | None = None,
    ) -> DeformationResult:
        """Deform M for handles at their targets.

        A proxy has few vertices inside of handle regions. M' may then lose volume, although N' keeps
        the volume of N. Another solve with a corrected volume goal removes the deficit, and also reaches the
        volume goal of the user. In the same way, further solves bring handles that are no vertices of N to
        their targets.

        Parameters
        ----------
        handles : Handles
            Of M.
        stop : Stop
            Its number of iterations is for all solves together.
        at_once : bool
            Solve again at once where M' needs a correction. A first deformation always does; a later one
            without `at_once` leaves the correction to the next call.
        team : ThreadTeam
            Threads that prolong N' to M'.
        out : (n, 3) float64, C-contiguous, optional
            Takes the prolonged positions.
        """
        piece, regions = self._piece, self._piece.regions
        corrects = corrects_volume(piece.options)
        scale = abs(regions.volume) or 1.0 if corrects else 1.0
        iterations, seconds = 0.0, {"solve": 0.0, "carry": 0.0}
        best, smallest, was_exact, coarser = None, inf, False, None
        round_joints = piece.options.joints > 0 and (at_once or self._solver.at_start)
        for _ in range(1 + VOLUME_ROUNDS if at_once or self._solver.at_start else 1):
            begin = perf_counter()
            left = replace(stop, max_iterations=int(stop.max_iterations - iterations))
            rough = replace(left, tolerance=POSE * left.tolerance) if round_joints else left
            on_proxy, goal = self._place(handles), self._goal
            solve = partial(self._solver.solve, on_proxy, volume_goal=goal, stop=rough)
            try:
                if self._binding is None:
                    with beside(self._bind, size=piece.mesh.n) as binding:
                        solved = solve()
                        self._binding = binding.result()
                else:
                    solved = solve()
                if round_joints and piece.options.proxy_method is None:
                    options, workers = piece.options, solver_threads(piece.options, self.mesh.n)
                    solved = with_round_joints(
                        self.mesh, on_proxy, solved, options, volume_goal=goal, stop=left, workers=workers
                    )
            except FloatingPointError:  # the positions are of no use to the next solve
                self._solver.reset()
                raise
            seconds["solve"] += perf_counter() - begin
            iterations += solved.iterations
            exact, R = solved.constraints.volume_constraint == "exact", solved.rotations
            begin = perf_counter()
            V, degenerate = self.binding.carry(solved.positions, rotations=R, team=team, out=out)
            V = regions.on_targets(V, handles) if corrects else V
            yields = solved.constraints.volume_constraint == "yielding"
            deficit = regions.volume_deficit(V) if corrects and not yields else 0.0
            missing = abs(deficit) / scale
            seconds["carry"] += perf_counter() - begin
            worse = missing > max(smallest, VOLUME_ERROR)
            if best is not None and (worse or (was_exact and not exact)):
                break  # the last shape was better
            found = solved if coarser is None else replace(solved, coarser_iterations=coarser)
            coarser = found.coarser_iterations
            best, smallest, was_exact = (V, solved.converged, degenerate), missing, exact
            # Only an exact constraint can be given another goal; N then has a volume.
            again = missing > VOLUME_ERROR and exact
            if again:
                goal = self._goal + deficit / self.mesh.volume
                again = goal > 0
                self._goal = goal if again else self._goal
            missed = self._place.learn(handles, V)  # also corrects where the next solve puts the targets
            again |= missed > MET * piece.mesh.diagonal
            if not again or iterations >= stop.max_iterations:
                break
            if V is out:  # the next solve takes this array again
                best = (V.copy(), *best[1:])
        assert best is not None
        V, converged, degenerate = best
        facts = Facts(
            samples=piece.vertices,
            samplings=1,
            proxy_vertices=self.mesh.n,
            added_samples=self.sampling.added,
            degenerate_frames=degenerate,
            faces_without_area=piece.faces_without_area,
            coarser_iterations=found.coarser_iterations,
            residual=found.residual,
            energy=found.energy,
            volume_error=found.constraints.volume_error,
            area_error=found.constraints.area_error,
            volume_pressure=found.constraints.volume_pressure,
            area_pressure=found.constraints.area_pressure,
            volume_constraint=found.constraints.volume_constraint,
            area_constraint=found.constraints.area_constraint,
        )
        if not self._is_kept:
            seconds = {"remesh": self._sampling_seconds, **self.binding.seconds, **seconds}
        return DeformationResult(V, iterations, converged, seconds, facts=facts)


def corrects_volume(options: Options) -> bool:
    """Whether the volume deficit of M' is corrected where handles are regions.

    A user's `proxy_method` takes no volume goal.
    """
    return options.volume == inf and options.proxy_method is None


def threads_of(options: Options) -> int:
    """Return the number of threads that work on samplings: by default two for each CPU."""
    return min(options.samplings, number_of_workers(options.workers, default=2 * available_cpus()))


def mean_of(results: Iterable[DeformationResult]) -> tuple[np.ndarray, list[DeformationResult]]:
    """Return the mean (n, 3) of the positions of results, and the results without their positions.

    Positions are summed in the order of the results, so that the mean does not depend on the number of
    threads. The memory of each result is freed once it is in the sum.
    """
    total: Any = 0.0
    kept = []
    for result in results:
        total = total + result.vertices
        kept.append(replace(result, vertices=np.empty((0, 3))))
    return total / len(kept), kept


def of_samplings(
    V: np.ndarray, results: list[DeformationResult], *, graph_seconds: float
) -> DeformationResult:
    """Join results of samplings with the mean positions V (n, 3), and add the time of their common graph."""
    result = joined(V, results, "samplings")
    if "remesh" not in result.seconds:
        return result
    remesh = result.seconds["remesh"] + graph_seconds
    return replace(result, seconds={**result.seconds, "remesh": remesh})
