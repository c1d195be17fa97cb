"""One proxy of a mesh: sample and bind, solve, carry, correct.

:func:`sshade.deform` makes a proxy for one deformation. A :class:`sshade.Deformer` keeps its proxies: each
call of it, a step of a drag, calls :meth:`Proxy.deform` again, which reuses the samples, the binding and the
factorised solver, and starts from the last shape. A drag does not polish.

F. Maggioli, D. Baieri, Z. Laehner, S. Melzi, "SShaDe: scalable shape
deformation via local representations", algorithm 1.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf
from time import perf_counter

import numpy as np

from sshade.core.progress import Progress, renamed, silent
from sshade.core.threads import ThreadTeam, beside
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.mesh import Mesh
from sshade.method.following_solver import FollowingSolver
from sshade.method.nearest_placement import NearestPlacement
from sshade.method.regions import HandleRegions, Sampler, sample_with_handles
from sshade.method.start import OnceSolver, ProxySolver
from sshade.problem.facts import Facts
from sshade.problem.options import Options
from sshade.problem.stop import Stop
from sshade.problem.task import DeformationResult, Handles
from sshade.proxy.binding import Binding, bind_proxy, frame_maker
from sshade.proxy.projection import Projector, project_to_fans
from sshade.proxy.sample import proxy_mesh, proxy_vertices
from sshade.solver.solution import Solution

#: Relative volume deficit of M' above which the proxy is solved again, and largest number of further solves,
#: whether for the volume or for handles.
VOLUME_ERROR, VOLUME_ROUNDS = 1e-3, 3
#: Largest distance of a hard handle from its target that needs no further solve, as a fraction of the
#: bounding-box diagonal.
MET = 1e-5


class Shared:
    """The data that all proxies of a connected, oriented manifold M share.

    Parameters
    ----------
    mesh : Mesh
        M: manifold, oriented, one component.
    handles : Handles
        Only their vertices, groups and weights matter, and which handles have a rotation.
    options : Options
    sample, projection : callable
        How M is sampled, and the projection P onto a proxy.

    Attributes
    ----------
    mesh, sample, projection
        The parameters.
    frames : FrameMaker
    regions : HandleRegions
        Of the present handles.
    vertices : int
        Number of samples.
    graph_seconds : float
    faces_without_area : int

    Raises
    ------
    InputError
        On another mesh.
    """

    def __init__(
        self,
        mesh: Mesh,
        handles: Handles,
        options: Options,
        *,
        sample: Sampler = sample_with_handles,
        projection: Projector = project_to_fans,
    ) -> None:
        self.mesh, self.sample, self.projection = mesh, sample, projection
        self.faces_without_area = int(mesh.without_area.sum())
        self.frames = frame_maker(options.frames)
        begin = perf_counter()
        self._graph = vertex_graph(mesh)
        self.graph_seconds = perf_counter() - begin
        mesh.require_manifold()
        mesh.require_one_component()
        self.vertices = proxy_vertices(options.vertices, mesh.n, len(handles), coarser=options.coarser)
        self.set_handles(handles, options)

    def set_handles(self, handles: Handles, options: Options) -> None:
        """Take other handles."""
        self.regions = HandleRegions(
            self.mesh,
            handles,
            vertices=self.vertices,
            graph=self._graph,
            volume_goal=options.volume_goal,
        )


class Proxy:
    """A proxy N of a mesh M: its samples, the binding of M to it, and its solver.

    Parameters
    ----------
    shared : Shared
        M, and the data that its proxies share.
    options : Options
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
    sampling_seconds : float
    """

    def __init__(
        self,
        shared: Shared,
        options: Options,
        number: int,
        *,
        keep_for: Handles | None = None,
        guess: np.ndarray | None = None,
        progress: Progress = silent,
    ) -> None:
        self._shared, self._options = shared, options
        stage = "proxy" if options.samplings == 1 else f"proxy {number + 1}"
        progress(stage, 0, options.max_iterations)
        begin = perf_counter()
        self.sampling, self._place = shared.sample(shared.mesh, shared.regions, (options.seed, number))
        self.sampling_seconds = perf_counter() - begin
        self.mesh = proxy_mesh(shared.mesh, self.sampling)
        self._binding: Binding | None = None
        self._goal = options.volume_goal or 1.0
        self._solver: ProxySolver
        self._following: FollowingSolver | None = None  # of a proxy that is kept
        # To try another solver of N, give it as the option `coarse`, which OnceSolver calls. To replace ours,
        # replace OnceSolver (one deformation) and FollowingSolver (a drag).
        if keep_for is None:
            self._solver = OnceSolver(
                self.mesh,
                options,
                guess=None if guess is None else guess[self.sampling.samples],
                progress=renamed(progress, stage),
                coarser_progress=renamed(progress, f"coarser {stage}"),
            )
        else:
            with beside(self._bind, size=shared.mesh.n) as binding:  # the solver is factorised beside it
                self._solver = self._following = FollowingSolver(self.mesh, self._place(keep_for), options)
                self._binding = binding.result()

    def _bind(self) -> Binding:
        """Find where the vertices of M lie on N, and prepare the :class:`HandleRegions` of M."""
        shared = self._shared
        binding = bind_proxy(shared.mesh, self.sampling, frames=shared.frames, projection=shared.projection)
        shared.regions.prepare()
        return binding

    @property
    def binding(self) -> Binding:
        """The binding of M to N; the first deformation makes it beside the solve."""
        assert self._binding is not None
        return self._binding

    @property
    def at_start(self) -> bool:
        """Whether the next deformation starts as the method does, and not from the last shape."""
        return self._following is None or self._following.at_start

    def reset(self, guess: np.ndarray | None = None) -> None:
        """Forget the last shape and all corrections; start at a shape (n, 3) of M, or as the method does."""
        assert self._following is not None
        self._following.reset()
        self._goal = self._options.volume_goal or 1.0
        self._place.forget()
        if guess is not None:
            self._following.start_at(guess[self.sampling.samples])

    def rebound(self, handles: Handles) -> tuple[NearestPlacement, FollowingSolver]:
        """Return the placement and the solver of other handles of M, at rest; the shape stays."""
        place = NearestPlacement(self._shared.mesh, self.mesh, handles)
        assert self._following is not None
        return place, self._following.with_handles(place.rest)

    def use(self, place: NearestPlacement, solver: FollowingSolver) -> None:
        """Go on with a placement and a solver of :meth:`rebound`."""
        self._place, self._solver, self._following = place, solver, solver

    def solve(self, handles: Handles, stop: Stop) -> Solution:
        """Solve N for handles of M at their targets.

        Raises
        ------
        InputError
            Where the handles cannot be placed on N.
        """
        on_proxy = self._place(handles)
        if self._binding is not None:
            return self._solver(on_proxy, volume_goal=self._goal, stop=stop)
        with beside(self._bind, size=self._shared.mesh.n) as binding:
            solved = self._solver(on_proxy, volume_goal=self._goal, stop=stop)
            self._binding = binding.result()
        return solved

    def deform(
        self,
        handles: Handles,
        *,
        stop: Stop,
        settle: bool = True,
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
        settle : bool
            Solve again at once where M' needs a correction. A first deformation always does; a later one
            without `settle` leaves the correction to the next call.
        team : ThreadTeam
            Threads that prolong N' to M'.
        out : (n, 3) float64, C-contiguous, optional
            Takes the prolonged positions.
        """
        regions, corrects = self._shared.regions, corrects_volume(self._options)
        scale = abs(regions.volume) or 1.0 if corrects else 1.0
        iterations, seconds = 0.0, {"solve": 0.0, "carry": 0.0}
        best, smallest, was_exact, coarser = None, inf, False, None
        for _ in range(1 + VOLUME_ROUNDS if settle or self.at_start else 1):
            begin = perf_counter()
            left = replace(stop, max_iterations=int(stop.max_iterations - iterations))
            solved = self.solve(handles, left)
            seconds["solve"] += perf_counter() - begin
            iterations += solved.iterations
            exact, R = solved.constraints.volume_constraint == "exact", solved.rotations
            begin = perf_counter()
            V, degenerate = self.binding.carry(solved.positions, rotations=R, team=team, out=out)
            V = regions.on_targets(V, handles) if corrects else V
            deficit = regions.volume_deficit(V) if corrects else 0.0
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
            again |= missed > MET * self._shared.mesh.diagonal
            if not again or iterations >= stop.max_iterations:
                break
            if V is out:  # the next solve takes this array again
                best = (V.copy(), *best[1:])
        assert best is not None
        V, converged, degenerate = best
        facts = Facts(
            samples=self._shared.vertices,
            samplings=1,
            proxy_vertices=self.mesh.n,
            added_samples=self.sampling.added,
            degenerate_frames=degenerate,
            faces_without_area=self._shared.faces_without_area,
            coarser_iterations=found.coarser_iterations,
            residual=found.residual,
            energy=found.energy,
            volume_error=found.constraints.volume_error,
            area_error=found.constraints.area_error,
            volume_constraint=found.constraints.volume_constraint,
            area_constraint=found.constraints.area_constraint,
        )
        if self._following is None:
            seconds = {"remesh": self.sampling_seconds, **self.binding.seconds, **seconds}
        return DeformationResult(V, iterations, converged, seconds, facts=facts)


def corrects_volume(options: Options) -> bool:
    """Whether the volume deficit of M' is corrected where handles are regions.

    A method of the user, which takes the place of our solver as the option `coarse`, takes no volume goal.
    """
    return options.volume == inf and options.coarse is None
