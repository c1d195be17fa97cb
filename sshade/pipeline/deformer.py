"""Bind once, deform many times: new targets only re-solve the proxies and decode."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from time import perf_counter
from typing import Any, Literal, Unpack

import numpy as np

from sshade.carry.binding import Binding, bind_proxy
from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.pipeline.fast import Choices, FastOptions, choices
from sshade.pipeline.multilevel import multilevel
from sshade.pipeline.paper import VOLUME_ERROR, VOLUME_ROUNDS
from sshade.pipeline.proxies import Proxies
from sshade.pipeline.regions import HandleRegions, all_on_targets
from sshade.progress import Progress, silent
from sshade.solver.following import Following
from sshade.solver.local_global import LocalGlobal, local_global
from sshade.solver.options import SolverOptions, complete, energy_options
from sshade.solver.parts import Parts
from sshade.solver.solution import Solution
from sshade.solver.start import initial_guess
from sshade.task import DeformationResult, DeformationTask, Handles
from sshade.threads import ThreadTeam, available_cpus, in_threads

#: Vertices from which on threads share those that are carried along.
SHARED = 50_000


@dataclass
class _Proxy:
    """A proxy that M is bound to, its solver, and where that is."""

    binding: Binding
    #: Of the handles given, those that are vertices of the proxy, and these; None where they are snapped.
    own: np.ndarray | None
    on: np.ndarray
    parts: Parts
    solver: LocalGlobal
    turned: np.ndarray
    #: The volume that it is to hold, over its own at rest.
    volume_goal: float = 1.0
    following: Following | None = None
    #: Positions and rotations that the last call ended with.
    last: tuple[np.ndarray, np.ndarray] | None = None


class Deformer:
    """A mesh bound to its proxies, with everything that does not depend on the targets.

    Remeshes, projections, frames and factorisations are made once. The first call with given targets gives
    what the method of a task does. Each later one goes on from where the last one ended (see
    :mod:`sshade.solver.following`), so that small moves of the handles take a few iterations: a drag.
    Called again with the same targets and a smaller tolerance, it comes to the same minimum, unless the way
    there has led into another one.

    Parameters
    ----------
    mesh : Mesh
        M: manifold, oriented, one component.
    index : (h,) int
        Handle vertices, each once; their targets come with each call, in this order.
    group : (h,) int, optional
        Which landmark each belongs to, as of :class:`sshade.Handles`; by default all to one.
    weight : (h,) float64 or float
        Of soft handles, see :class:`sshade.Handles`; inf by default.
    method : {"fast", "paper"}
        :func:`sshade.sshade_fast`, or :func:`sshade.sshade` with one sampling.
    progress : Progress
    **options
        Those of the method: see :class:`sshade.pipeline.fast.FastOptions`; of "paper" all that are not of
        proxies are those of its solver, by default the published ones.

    Raises
    ------
    InputError
        On a mesh or options out of the above.

    Examples
    --------
    >>> import numpy as np
    >>> from sshade import Deformer, Mesh
    >>> V = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0.1], [0, 1, 0]], dtype=float)
    >>> mesh = Mesh(V, np.array([[0, 1, 2], [0, 2, 3]]))
    >>> drag = Deformer(mesh, [0, 2], vertices=4, area=0)
    >>> drag(V[[0, 2]] + [0, 0, 1]).vertices.shape
    (4, 3)
    """

    def __init__(
        self,
        mesh: Mesh,
        index: np.ndarray,
        *,
        group: np.ndarray | None = None,
        weight: np.ndarray | float = inf,
        method: Literal["fast", "paper"] = "fast",
        progress: Progress = silent,
        **options: Unpack[FastOptions],
    ) -> None:
        self.mesh = mesh
        self._take_handles(index, group, weight)
        task = DeformationTask("drag", mesh, self._rest)
        if method not in ("fast", "paper"):
            raise InputError(f"a mesh is bound by the method 'fast' or 'paper', not {method!r}")
        self._fast = method == "fast"
        self._choices = choices(task, options) if self._fast else _published(dict(options))
        self._proxies = proxies = Proxies(mesh, handles=len(self.index), **self._choices.proxies)
        self._regions = regions = HandleRegions(
            mesh, self._rest, vertices=proxies.vertices, graph=proxies.graph
        )

        def make(number: int) -> _Proxy:
            remeshed, handle = regions.sample((proxies.seed, number))
            binding = bind_proxy(mesh, remeshed, frames=proxies.frames)
            on = np.flatnonzero(handle >= 0)
            parts, solver = self._system(binding.proxy, self._sampled(self._rest, handle[on], on))
            progress("binding", number + 1, proxies.samplings)
            return _Proxy(binding, handle[on], on, parts, solver, np.zeros(len(on), dtype=bool))

        made = [] if regions.covered else in_threads(make, proxies.samplings, workers=proxies.workers)
        self._bound_proxies = made
        regions.prepare()

    @property
    def bindings(self) -> list[Binding]:
        """To each proxy."""
        return [proxy.binding for proxy in self._bound_proxies]

    def _system(self, proxy: Mesh, handles: Handles) -> tuple[Parts, LocalGlobal]:
        """What pulls a proxy, and its factorised system."""
        parts = Parts(proxy, handles, self._choices.solver["parts"])
        return parts, LocalGlobal(proxy, parts.vertex, stiffness=parts.stiffness)

    def _make_solver(self, proxy: _Proxy, handles: Handles) -> None:
        """Take other handles of a proxy, or others that have rotations, which makes parts of them."""
        proxy.parts, proxy.solver = self._system(proxy.binding.proxy, handles)
        proxy.turned, proxy.following = handles.turned, None

    def _take_handles(self, index: np.ndarray, group: np.ndarray | None, weight: np.ndarray | float) -> None:
        self.index = np.array(index, dtype=np.int64)
        self.mesh.require_handles(self.index)
        if len(np.unique(self.index)) < len(self.index):
            raise InputError("a handle vertex is given twice")
        group = np.zeros(len(self.index), dtype=np.int64) if group is None else group
        handles = Handles(self.index, self.mesh.V[self.index], group=group, weight=np.asarray(weight))
        self._rest = DeformationTask("drag", self.mesh, handles).handles

    def rebind_handles(
        self, index: np.ndarray, *, group: np.ndarray | None = None, weight: np.ndarray | float = inf
    ) -> None:
        """Take other handles, without sampling and projecting anew; the shape stays where it is.

        The vertices of the proxies that are nearest to them are held in their stead, at targets that are
        corrected for the offset, as of :meth:`sshade.Handles.from_positions`. So handles that were not bound
        from the beginning are met as nearly as the surface around them moves rigidly, not exactly, but for
        regions. Those close to each other become one. The time is that of a factorisation of the proxy.

        Parameters
        ----------
        index, group, weight
            As for the class.

        Raises
        ------
        InputError
            On a vertex as for the class, or, then or in a call, where handles are too far from the samples,
            or those of two groups are nearest to the same one and have different targets.
        """
        self._take_handles(index, group, weight)
        self._regions = HandleRegions(
            self.mesh, self._rest, vertices=self._proxies.vertices, graph=self._proxies.graph
        )
        for proxy in self._bound_proxies:
            proxy.own = None
            self._make_solver(proxy, self._on_proxy(proxy, self._rest))

    def _on_proxy(self, proxy: _Proxy, handles: Handles) -> Handles:
        """Handles of M as those of a proxy."""
        if proxy.own is not None:
            return self._sampled(handles, proxy.own, proxy.on)
        return Handles.from_positions(
            proxy.binding.proxy,
            self.mesh.V[handles.index],
            handles.target,
            group=handles.group,
            weight=handles.weight,
            rotation=handles.rotation,
        ).shared(proxy.binding.proxy)

    def _sampled(self, handles: Handles, own: np.ndarray, on: np.ndarray) -> Handles:
        return handles.sampled(own, on, self.mesh.V)

    def reset(self) -> None:
        """Forget the last shape: the next call begins as the method does."""
        for proxy in self._bound_proxies:
            proxy.following, proxy.last, proxy.volume_goal = None, None, 1.0

    def __call__(
        self,
        targets: np.ndarray,
        *,
        rotations: np.ndarray | None = None,
        tolerance: float | None = None,
        max_iterations: int | None = None,
        out: np.ndarray | None = None,
    ) -> DeformationResult:
        """Deform for new targets of the same handles, from where the last call ended.

        Parameters
        ----------
        targets : (h, 3) float64
            In the order of `index`.
        rotations : (h, 3, 3) float64, optional
            Of the handles, NaN where open; see :class:`sshade.Handles`. Other handles that have one make
            a new factorisation of the proxy.
        tolerance : float, optional
            Residual, relative to the proxy's diagonal, under which iteration stops; by default that of the
            options.
        max_iterations : int, optional
            Cutoff; a handful keeps a drag fluid, and the next call goes on. By default that of the options.
        out : (n, 3) float64, C-contiguous, optional
            Takes the vertices, which with one sampling and without regions saves a large array a
            call; the result's are these.

        Returns
        -------
        DeformationResult
            As of the method; ``seconds`` has the ``solve`` and the ``carry``, and ``extra`` the largest
            ``residual`` and the proxies' ``energy``.
        """
        begin = perf_counter()
        targets = np.asarray(targets, dtype=np.float64)
        if targets.shape != (len(self.index), 3):
            raise InputError(
                f"{len(self.index)} handles need targets of shape ({len(self.index)}, 3), not {targets.shape}"
            )
        if out is not None and not (
            out.shape == self.mesh.V.shape and out.dtype == np.float64 and out.flags.c_contiguous
        ):
            raise InputError(f"`out` must be a contiguous float64 array of shape {self.mesh.V.shape}")
        rest = self._rest
        handles = replace(rest, target=targets, rotation=rotations)
        if self._regions.covered:
            return all_on_targets(DeformationTask("drag", self.mesh, handles))
        stop = {
            "tolerance": self._choices.tolerance if tolerance is None else tolerance,
            "max_iterations": self._choices.solver["max_iterations"]
            if max_iterations is None
            else max_iterations,
        }
        into = out if self._proxies.samplings == 1 else None
        result = self._proxies.average(lambda number: self._one(number, handles, into, **stop))
        V = result.vertices
        if not self._keeps_volume:
            V = self._regions.on_targets(V, handles)
        elif self._regions.volume:
            V = self._regions.keep_volume(V)
        if out is not None and V is not out:
            out[:] = V
            V = out
        return replace(result, vertices=V, seconds={**result.seconds, "total": perf_counter() - begin})

    @property
    def _keeps_volume(self) -> bool:
        return self._fast and self._choices.keeps_volume

    def _one(self, number: int, handles: Handles, out: np.ndarray | None, **stop: Any) -> DeformationResult:
        """M' by one proxy."""
        proxy, regions = self._bound_proxies[number], self._regions
        seconds, iterations = {"solve": 0.0, "carry": 0.0}, 0.0
        # Proxies know little of the inside of regions. What they lack of the volume a first call makes up for
        # at once, and a drag with its next step.
        for _ in range(1 + VOLUME_ROUNDS if proxy.following is None else 1):
            begin = perf_counter()
            solved = self._solved(proxy, handles, **stop)
            proxy.last = solved.vertices, solved.extra["rotations"]
            end = perf_counter()
            V, degenerate = self._carried(proxy, solved, out)
            lacking = 0.0
            if self._keeps_volume:
                V = regions.on_targets(V, handles)
                lacking = regions.lacking_volume(V)
            seconds = {"solve": seconds["solve"] + end - begin, "carry": perf_counter() - end}
            iterations += solved.iterations
            goal = proxy.volume_goal + lacking / proxy.binding.proxy.volume if lacking else 1.0
            exact = solved.extra["volume_constraint"] == "exact"
            if abs(lacking) <= VOLUME_ERROR * abs(regions.volume) or goal <= 0 or not exact:
                break
            proxy.volume_goal = goal
        facts = {
            "residual": solved.extra["residual"],
            "energy": solved.extra["energy"],
            "degenerate_frames": degenerate,
            "proxy_vertices": proxy.binding.proxy.n,
        }
        return DeformationResult(V, iterations, solved.converged, seconds, facts)

    def _carried(
        self, proxy: _Proxy, solved: DeformationResult, out: np.ndarray | None
    ) -> tuple[np.ndarray, int]:
        rotations, shared = solved.extra["rotations"], self.mesh.n >= SHARED
        with ThreadTeam(available_cpus() if shared and self._proxies.samplings == 1 else 1) as team:
            return proxy.binding.carry(solved.vertices, rotations=rotations, team=team, out=out)

    def _solved(
        self, proxy: _Proxy, handles: Handles, *, tolerance: float, max_iterations: int
    ) -> DeformationResult:
        """N', from where the last call ended, or for the first one as the method does."""
        on_proxy = self._on_proxy(proxy, handles)
        if handles.known and not on_proxy.known:
            raise InputError("no handle with a rotation is a vertex of the proxy; ask for more vertices")
        if (on_proxy.turned & ~proxy.turned).any():
            self._make_solver(proxy, on_proxy)
        targets, share = proxy.parts.goals(on_proxy.target, on_proxy.rotation)
        energy = energy_options(self._choices.solver)
        pulls: dict[str, Any] = {"known": on_proxy.known, "share": share, "volume_goal": proxy.volume_goal}
        stop: dict[str, Any] = {"tolerance": tolerance, "max_iterations": max_iterations}
        if proxy.following is None and proxy.last is not None:
            at = proxy.last[0][proxy.solver.index]
            proxy.following = Following(proxy.solver, *proxy.last, at, **energy)
        if proxy.following is not None:
            return _result(proxy.following.solve(targets, **pulls, **stop))

        def solve(task: DeformationTask, **options: Any) -> DeformationResult:
            if task.mesh is not proxy.binding.proxy:
                given = {**self._choices.solver, "max_iterations": max_iterations, **options}
                return local_global(task, **given)
            guess = initial_guess(task, self._choices.solver["start"])
            pulls["volume_goal"] = options.get("volume_goal", 1.0)
            rough = {**stop, "tolerance": options["tolerance"]}
            return _result(proxy.solver.solve(targets, start=guess, **pulls, **rough, **energy))

        task = DeformationTask("drag", proxy.binding.proxy, on_proxy)
        if self._fast:
            lead = self._choices.lead
            result = multilevel(task, coarse=solve, lead=lead, tolerance=tolerance, seed=self._proxies.seed)
        else:
            result = solve(task, tolerance=tolerance)
        rotations = result.extra["rotations"]
        proxy.following = Following(
            proxy.solver, result.vertices, rotations, targets, **{**pulls, "volume_goal": 1.0}, **energy
        )
        return result


def _result(solution: Solution) -> DeformationResult:
    return DeformationResult(
        solution.positions, solution.iterations, solution.converged, extra=solution.facts()
    )


def _published(options: dict[str, Any]) -> Choices:
    """The choices of the paper, but for one sampling."""
    of_solver = {name: options.pop(name) for name in SolverOptions.__annotations__ if name in options}
    solver = complete(of_solver)
    return Choices({"samplings": 1, **options}, solver, solver.pop("tolerance"), lead=None)
