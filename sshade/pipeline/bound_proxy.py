"""A proxy that a mesh is bound to, and its factorised system: solved for targets that follow each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from time import perf_counter
from typing import Any, Literal

import numpy as np

from sshade.carry.binding import Binding
from sshade.errors import InputError
from sshade.options import ENERGY
from sshade.pipeline.fast import Choices
from sshade.pipeline.multilevel import multilevel
from sshade.pipeline.paper import VOLUME_ERROR, VOLUME_ROUNDS
from sshade.pipeline.regions import HandleRegions
from sshade.snapping import snap_to_vertices
from sshade.solver.attachment import Attachment
from sshade.solver.following import Following
from sshade.solver.local_global import LocalGlobal, local_global
from sshade.solver.solution import Solution
from sshade.solver.start import initial_guess
from sshade.task import DeformationResult, DeformationTask, Handles
from sshade.threads import ThreadTeam

#: How far handles that are no vertices of a proxy may be from their targets, over the diagonal, where they
#: are made up for.
MET = 1e-5


class BoundProxy:
    """A binding of M, the handles of M as those of the proxy N, and what is solved for them.

    Parameters
    ----------
    binding : Binding
    own : (k,) int64
        Of the handles of M those that are vertices of N.
    on : (k,) int64
        These vertices.
    rest : Handles
        Those of M, at rest.
    choices : Choices
    first : {"multilevel", "plain"}
        How a first solve goes about it.
    seed : int
        Of the coarser level's sampling.
    team : ThreadTeam
        Threads that carry M.
    """

    def __init__(
        self,
        binding: Binding,
        *,
        own: np.ndarray,
        on: np.ndarray,
        rest: Handles,
        choices: Choices,
        first: Literal["multilevel", "plain"],
        seed: int,
        team: ThreadTeam,
    ) -> None:
        self._team = team
        self.binding, self._choices, self._first, self._seed = binding, choices, first, seed
        self._own: np.ndarray | None = own
        self._on, self._mesh, self._proxy = on, binding.mesh, binding.proxy
        handles = self._handles(rest)
        self._attachment = Attachment(self._proxy, handles, choices.solver["attachment"])
        self._solver = LocalGlobal(
            self._proxy,
            self._attachment.vertex,
            stiffness=self._attachment.stiffness,
            bending=choices.solver["bending"],
        )
        self._turned = np.zeros(len(handles), dtype=bool)
        self.reset()

    def reset(self) -> None:
        """Forget the last solve: the next one begins as the method does."""
        self._following: Following | None = None
        self._last: tuple[np.ndarray, np.ndarray] | None = None
        self._volume_goal = 1.0  # what N is to hold, over its own at rest

    def take(self, rest: Handles) -> None:
        """Take other handles of M, given at rest, by the vertices of N that are nearest; the shape stays."""
        snapped = self._snapped(rest)
        _, nearest = snap_to_vertices(self._proxy, self._mesh.V[rest.index], rest.group)
        number = np.full(self._proxy.n, -1)
        number[snapped.index] = np.arange(len(snapped))
        self._own, self._stands_for, self._shift = None, number[nearest], np.zeros((len(snapped), 3))
        self._farthest = 2 * snapped.snap_distance
        self._take(snapped)

    def _learn(self, handles: Handles, V: np.ndarray) -> float:
        """Have vertices that stand for hard handles make up for how far M' (n, 3) is off their targets.

        At most as far as a turn can be the reason.

        Returns
        -------
        float
            The largest distance from a target, 0 where handles are vertices of N, in the unit of length.
        """
        if self._own is not None:
            return 0.0
        missed, number = handles.target - V[handles.index], self._stands_for
        missed[~handles.hard] = 0.0
        count = np.bincount(number)
        for c in range(3):
            self._shift[:, c] += np.bincount(number, missed[:, c]) / count
        length = np.linalg.norm(self._shift, axis=1)
        self._shift *= (np.minimum(length, self._farthest) / np.where(length > 0, length, 1.0))[:, None]
        return float(np.linalg.norm(missed, axis=1).max())

    def change(self, choices: Choices) -> None:
        """Take another energy; the shape stays."""
        self._choices, self._following, self._volume_goal = choices, None, 1.0

    def _take(self, handles: Handles) -> None:
        """Take handles of N, or others of them that have rotations, which makes parts of them."""
        self._attachment = Attachment(self._proxy, handles, self._choices.solver["attachment"])
        self._solver = self._solver.with_handles(
            self._attachment.vertex, stiffness=self._attachment.stiffness
        )
        self._turned, self._following = handles.has_rotation, None

    def _handles(self, handles: Handles) -> Handles:
        """Handles of M as those of N."""
        if self._own is not None:
            return handles.sampled(self._own, self._on, self._mesh.V)
        snapped = self._snapped(handles)
        return replace(snapped, target=snapped.target + self._shift)

    def _snapped(self, handles: Handles) -> Handles:
        return Handles.from_positions(
            self._proxy,
            self._mesh.V[handles.index],
            handles.target,
            group=handles.group,
            weight=handles.weight,
            rotation=handles.rotation,
        ).with_portions(self._proxy)

    def deform(
        self,
        handles: Handles,
        regions: HandleRegions,
        *,
        keep_volume: bool,
        settle: bool,
        out: np.ndarray | None,
        **stop: Any,
    ) -> DeformationResult:
        """M' for handles at their targets.

        Proxies know little of the inside of regions, and of handles that are not among their vertices. What
        they lack there a first call makes up for at once, and one that settles, a drag with its next step.

        Parameters
        ----------
        handles : Handles
            Of M.
        regions : HandleRegions
        keep_volume : bool
            Whether M' is on its targets and has its volume before samplings are averaged.
        settle : bool
        out : (n, 3) float64, C-contiguous, optional
            Takes what is carried.
        **stop
            As of :meth:`solve`.
        """
        binding, seconds, iterations = self.binding, {"solve": 0.0, "carry": 0.0}, 0.0
        for _ in range(1 + VOLUME_ROUNDS if settle or self._following is None else 1):
            begin = perf_counter()
            solved = self.solve(handles, **stop)
            end = perf_counter()
            rotations = solved.extra["rotations"]
            V, degenerate = binding.carry(solved.vertices, rotations=rotations, team=self._team, out=out)
            seconds["carry"] += perf_counter() - end
            seconds["solve"] += end - begin
            iterations += solved.iterations
            lacking = 0.0
            if keep_volume:
                V = regions.on_targets(V, handles)
                lacking = regions.lacking_volume(V)
            goal = self._volume_goal + lacking / binding.proxy.volume if lacking else 1.0
            exact = solved.extra["volume_constraint"] == "exact"
            held = abs(lacking) <= VOLUME_ERROR * abs(regions.volume) or goal <= 0 or not exact
            if not held:
                self._volume_goal = goal
            if self._learn(handles, V) <= MET * self._mesh.diagonal and held:
                break
        facts = {
            "residual": solved.extra["residual"],
            "energy": solved.extra["energy"],
            "degenerate_frames": degenerate,
            "proxy_vertices": binding.proxy.n,
        }
        return DeformationResult(V, iterations, solved.converged, seconds, facts)

    def solve(self, handles: Handles, *, tolerance: float, max_iterations: int) -> DeformationResult:
        """N' for handles of M at their targets, from where the last solve ended, or else as the method does.

        Raises
        ------
        InputError
            Where handles cannot be those of N: see :meth:`sshade.Handles.from_positions`.
        """
        solved = self._solved(handles, {"tolerance": tolerance, "max_iterations": max_iterations})
        self._last = solved.vertices, solved.extra["rotations"]
        return solved

    def _solved(self, handles: Handles, stop: Mapping[str, Any]) -> DeformationResult:
        on_proxy = self._handles(handles)
        if handles.prescribed_rotations and not on_proxy.prescribed_rotations:
            raise InputError("no handle with a rotation is a vertex of the proxy; ask for more vertices")
        if (on_proxy.has_rotation & ~self._turned).any():
            self._take(on_proxy)
        targets, fraction = self._attachment.pulls(on_proxy.target, on_proxy.rotation)
        energy = {name: self._choices.solver[name] for name in ENERGY}
        pulls: dict[str, Any] = {
            "prescribed": on_proxy.prescribed_rotations,
            "fraction": fraction,
            "volume_goal": self._volume_goal,
        }
        if self._following is None and self._last is not None:
            at = self._last[0][self._solver.index]
            self._following = Following(self._solver, *self._last, at, **energy)
        if self._following is not None:
            return _result(self._following.solve(targets, **pulls, **stop))

        def solve(task: DeformationTask, **options: Any) -> DeformationResult:
            if task.mesh is not self._proxy:
                given = {**self._choices.solver, "max_iterations": stop["max_iterations"], **options}
                return local_global(task, **given)
            guess = initial_guess(task, self._choices.solver["start"])
            pulls["volume_goal"] = options.get("volume_goal", 1.0)
            rough = {**stop, "tolerance": options["tolerance"]}
            return _result(self._solver.solve(targets, start=guess, **pulls, **rough, **energy))

        task, tolerance = DeformationTask("drag", self._proxy, on_proxy), stop["tolerance"]
        if self._first == "multilevel":
            lead = self._choices.lead
            result = multilevel(task, coarse=solve, lead=lead, tolerance=tolerance, seed=self._seed)
        else:
            result = solve(task, tolerance=tolerance)
        rotations = result.extra["rotations"]
        there: dict[str, Any] = {**pulls, "volume_goal": 1.0}
        self._following = Following(self._solver, result.vertices, rotations, targets, **there, **energy)
        return result


def _result(solution: Solution) -> DeformationResult:
    return DeformationResult(
        solution.positions, solution.iterations, solution.converged, extra=solution.facts()
    )
