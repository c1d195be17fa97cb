"""A mesh bound to its handles: the method from end to end, for one deformation, a drag or a sequence.

A one-off call makes the object and calls it once: ``sshade.deform`` is ``Bound(...).solve(targets)``. A
sequence solves pose after pose from the pose before. The editor and Blender take steps of a drag.

A deformation goes part by part. A part is a connected, oriented manifold: the mesh, or a component of it
where it is cut (:mod:`sshade.method.assembly`). The steps of the paper are, for each part: sample a proxy and
bind the part to it, solve the proxy, prolong its deformation to the part, and average over samplings
(:mod:`sshade.method.piece`). The method `fine` then polishes the part: from the prolonged shape, some
iterations minimise the energy at full resolution (:mod:`sshade.method.polish`). Handles are single vertices,
landmarks (a few vertices that move together) or regions (areas). A part takes the defaults for regions
(:data:`sshade.problem.options.REGIONS`) if most of its handle vertices are inside of regions.

F. Maggioli, D. Baieri, Z. Laehner, S. Melzi, "SShaDe: scalable shape
deformation via local representations", algorithm 1.
"""

from __future__ import annotations

import logging
from collections import Counter
from dataclasses import replace
from functools import partial
from math import inf
from time import perf_counter
from typing import Any, Self, Unpack

import numpy as np

from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.core.threads import beside
from sshade.files.open_shape import OpenShape, open_arguments
from sshade.interpolation.dense_handles import interpolate_handles
from sshade.mesh.mesh import Mesh, require_mesh
from sshade.mesh.places import opening_within
from sshade.mesh.quality import Quality, quality
from sshade.mesh.rigid import common_motion
from sshade.method.assembly import Assembly, Components, Part, SinglePart
from sshade.method.piece import Piece, Recipe
from sshade.method.polish import polished, set_up
from sshade.problem.facts import Facts
from sshade.problem.handle_checks import checked_index, checked_target, ids_of
from sshade.problem.options import Options, OptionValues, Stop, as_row, resolve
from sshade.problem.task import DeformationResult, DeformationTask, Handles
from sshade.proxy.frames import checked_out
from sshade.regions.handle_regions import has_regions
from sshade.solver.constraints import enclosed_volume

log = logging.getLogger(__name__)

#: Tolerance of :meth:`Bound.settle`, as a multiple of the method's.
SETTLED = 0.01
#: Largest default weight of the area with a volume goal. A body that grows needs more area.
GOAL_AREA = 0.1
#: Least volume of a part with a goal, as a multiple of area^1.5. The ratio of two volumes near zero
#: means nothing.
FLAT = 1e-5
#: Relative error of a goal from which on a warning is logged.
MISSED = 0.01
#: Why a volume cannot be kept, by the reasons of :mod:`sshade.solver.constraints`.
NO_VOLUME = {
    "boundary": "the surface has a boundary",
    "orientation": "the surface has no inside",
    "flat": "the surface is flat",
    "one-sided": "the surface has one side",
}


class Bound:
    """A mesh bound to its handle vertices, with all data that do not depend on the targets.

    Sampling, projection, frames and factorisation are made once. :meth:`solve` deforms as
    :func:`sshade.deform` does. :meth:`step` starts where the last call ended, so that small moves of the
    handles take a few iterations; the first step deforms as :func:`sshade.deform` does. :meth:`settle` then
    converges to the minimum. After a drag, the local minimum may differ from the minimum of a first call;
    :meth:`reset` forgets the last shape. The public name of the class is ``sshade.Deformer``.

    Parameters
    ----------
    V, F : (n, 3) float64 and (m, 3) int, or mesh
        M. Arrays, and a mesh of trimesh or pyvista, are opened as :func:`sshade.deform` opens them: copies of
        a vertex along seams move as one. A :class:`sshade.Mesh` is taken as it is.
    b : (h,) int or (n,) bool
        Handle vertices: ids, each once, or a mask of all vertices. Their targets come with each call, in this
        order.
    group : (h,) int, optional
        Landmark of each handle, see :class:`sshade.Handles`; by default all handles have the same.
    weight : (h,) float64 or float
        Weight of soft handles, see :class:`sshade.Handles`; by default inf, which is a hard handle.
    method : {"fast", "fine", "paper", "interpolate"}
        The steps of "fine" are those of its proxy; :meth:`solve` and :meth:`settle` also polish.
    progress : Progress
    **options
        See :class:`sshade.problem.options.Options`.

    Raises
    ------
    InputError
        On an invalid mesh or handles, or an unknown method or option.

    Examples
    --------
    >>> import numpy as np
    >>> from sshade import Deformer, Mesh
    >>> V = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0.1], [0, 1, 0]], dtype=float)
    >>> mesh = Mesh(V, np.array([[0, 1, 2], [0, 2, 3]]))
    >>> drag = Deformer(mesh, [0, 2], vertices=4, area=0)
    >>> for height in (0.5, 1.0):
    ...     shape = drag.step(V[[0, 2]] + [0, 0, height], tolerance=1e-4).vertices
    >>> shape.shape
    (4, 3)
    >>> drag.rebind([0, 1, 2])
    >>> raised = drag.step(V[:3] + [0, 0, 1])
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
        method: str = "fast",
        progress: Progress = silent,
        **options: Unpack[OptionValues],
    ) -> None:
        resolved = resolve(method, options)
        self._shape: OpenShape | None = None
        if isinstance(shape, Mesh) and len(arrays) == 1:
            mesh, index = shape, arrays[0]
        else:
            self._shape, (index,) = open_arguments(shape, arrays, ("handles b",))
            mesh = self._shape.mesh
        require_mesh(mesh, "Deformer")
        self._given, rest = self._at_rest(mesh, index, group, weight)
        self._begin(DeformationTask("drag", mesh, rest), resolved, Recipe(), keep=True)
        if method != "interpolate":
            self._bind_pieces(progress)

    @classmethod
    def of_task(
        cls, task: DeformationTask, options: Options, *, recipe: Recipe | None = None, keep: bool = False
    ) -> Self:
        """Bind the mesh and the handle vertices of a task.

        Parameters
        ----------
        task : DeformationTask
        options : Options
            Of :func:`sshade.problem.options.resolve`.
        recipe : Recipe, optional
            How proxies are sampled and projected to, if not as usual.
        keep : bool
            Keep proxies and factors for later calls. Otherwise each call makes them and frees them.
        """
        bound = cls.__new__(cls)
        bound._shape = None
        bound._given = task.handles.index
        bound._begin(task, options, recipe or Recipe(), keep=keep)
        return bound

    def _begin(self, task: DeformationTask, options: Options, recipe: Recipe, *, keep: bool) -> None:
        self._task = task
        self._options = options
        self._recipe = recipe
        self._keep = keep
        #: Kept pieces, by their components.
        self._pieces: dict[int, Piece] = {}
        #: Vertices and faces of the proxies of the last call that was no step.
        self._proxies: list[tuple[np.ndarray, np.ndarray]] = []
        self._take_handles()

    def _take_handles(self) -> None:
        """Bind what depends on the handle vertices, but for the proxies."""
        mesh, handles = self._task.mesh, self._task.handles
        is_one = mesh.topology.components == 1 and mesh.is_manifold and mesh.is_oriented
        is_one = is_one or self._options.method == "interpolate"  # which takes every mesh as it is
        self._components = None if is_one else Components(mesh, handles.index)
        #: The handles of the last call.
        self._last: Handles | None = None

    @property
    def mesh(self) -> Mesh:
        """M."""
        return self._task.mesh

    @property
    def _is_as_given(self) -> bool:
        """Whether the vertices that were given are those of `mesh`."""
        return self._shape is None or len(self._shape.V) == self.mesh.n

    @property
    def index(self) -> np.ndarray:
        """(k,) int64: the handle vertices of `mesh`."""
        return self._task.handles.index

    def solve(
        self,
        targets: Handles | np.ndarray,
        *,
        rotations: np.ndarray | None = None,
        guess: np.ndarray | None = None,
        stop: Stop | None = None,
        progress: Progress = silent,
    ) -> DeformationResult:
        """Deform for targets of the handles, as :func:`sshade.deform` does.

        Kept proxies go on from one inner solve to the next as in a drag. Where there are several, as with a
        volume goal or a mesh that is cut, the shape differs from that of :func:`sshade.deform` by some
        1e-4 of the diagonal.

        Parameters
        ----------
        targets : (h, 3) float64 or Handles
            In the order of the handle vertices. Handles have their own rotations.
        rotations : (h, 3, 3) float64, optional
            Rotations of the handles, NaN where open; see :class:`sshade.Handles`.
        guess : (n, 3) float64, optional
            Shape in which the solve starts, in place of the option `start`.
        stop : Stop, optional
            By default the options' own.
        progress : Progress
        """
        handles = self._at(targets, rotations)
        guess = None if guess is None else self.mesh.checked(guess, "guess")
        _warn_if_nothing_is_fixed(self._task.at(handles), self._options)
        self._last = handles
        task = self._task.at(handles, guess=guess)
        for piece in self._pieces.values():
            piece.reset()
        result = self._deformed(task, stop, anew=True, progress=progress)
        opening = max(result.facts.opening, opening_within(self.mesh, result.vertices) / self.mesh.diagonal)
        facts = replace(
            result.facts,
            options=result.facts.options or ({} if self._recipe.part else as_row(self._options)),
            hard_handle_error=_hard_error(task, result.vertices),
            opening=opening,
        )
        return self._placed(replace(result, facts=facts), self._task.at(handles))

    def step(
        self,
        targets: Handles | np.ndarray,
        *,
        rotations: np.ndarray | None = None,
        tolerance: float | None = None,
        max_iterations: int | None = None,
        out: np.ndarray | None = None,
    ) -> DeformationResult:
        """Take a step of a drag: deform for new targets from where the last call ended.

        Parameters
        ----------
        targets, rotations
            See :meth:`solve`. The first rotation of a handle makes a new factorisation of the proxy.
        tolerance, max_iterations : optional
            By default as in the options. A few iterations keep a drag fluid; the next step continues.
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
        self._last = handles
        task = self._task.at(handles)
        return self._placed(self._deformed(task, stop, step=True, out=self._own(out)), task, out=out)

    def settle(self, *, out: np.ndarray | None = None, progress: Progress = silent) -> DeformationResult:
        """Converge to the minimum for the last call's targets, at the end of a drag.

        A drag lags a few hundred steps behind, and the residual is the length of one step. At the method's
        tolerance the shape is up to some thousandths of the diagonal from the minimum, at :data:`SETTLED`
        times the tolerance less than a thousandth.

        Parameters
        ----------
        out : (n, 3) float64, C-contiguous, optional
        progress : Progress
            Of the polish.

        Raises
        ------
        InputError
            Where the handles had no targets yet.
        """
        if self._last is None:
            raise InputError(
                "there is nothing to settle: no targets were given since these handles were taken"
            )
        handles = self._last
        self._require_out(out)
        stop = replace(self._options.stop, tolerance=SETTLED * self._options.tolerance)
        task = self._task.at(handles)
        found = self._deformed(task, stop, out=self._own(out), progress=progress)
        return self._placed(found, task, out=out)

    def quality(self, V: np.ndarray) -> Quality:
        """Measure a shape (n, 3) of `mesh`, such as the result of the last :meth:`solve`."""
        mesh, volume = self.mesh, None
        if mesh.is_closed and mesh.is_oriented:
            F = mesh.F.astype(np.uint32)
            before, after = (enclosed_volume(np.ascontiguousarray(W), F) for W in (mesh.V, V))
            volume = after / before - 1 if before else None
        return quality(mesh, V, self._proxies, volume=volume)

    def reset(self) -> None:
        """Forget the last shape: the next step starts as the method does."""
        for piece in self._pieces.values():
            piece.reset()

    def rebind(
        self, index: np.ndarray, *, group: np.ndarray | None = None, weight: np.ndarray | float = inf
    ) -> None:
        """Take other handles without sampling and projecting again; the shape stays.

        The nearest vertices of the proxies stand for the handles, at targets corrected for the offset as by
        :meth:`sshade.Handles.from_positions`. A handle that was not bound from the beginning lags slightly
        during a drag; :meth:`settle` brings it to its target. Handles so near to each other that one proxy
        vertex stands for them reach their targets in the mean. Binding takes the time of a factorisation.
        A component without a proxy is bound when a step first needs it. Until other handles are taken,
        :meth:`solve` deforms through these proxies as well.

        Parameters
        ----------
        index, group, weight
            As b, group and weight of :class:`Bound`.

        Raises
        ------
        InputError
            Where handles are too far from the proxy's vertices, or one proxy vertex would stand for handles
            of two groups with different targets. The handles stay as they were then. A later call may raise
            the same.
        """
        given, rest = self._at_rest(self.mesh, index, group, weight)
        found = {}
        for component, piece in self._pieces.items():
            own = rest if self._components is None else self._components.handles_on(component, rest)
            if own is not None:
                found[component] = piece, own, piece.rebound(own)
        self._given = given
        self._task = self._task.at(rest)
        self._pieces = {component: piece for component, (piece, _, _) in found.items()}
        for piece, own, kept in found.values():
            piece.use(own, kept)
        self._take_handles()

    def _bind_pieces(self, progress: Progress) -> None:
        """Bind all parts with handles, at rest."""
        assembly = self._assembly(self._task, progress, rigid=False)
        for part in assembly.parts():
            with part.named():
                self._piece(part, anew=True)
            assembly.put(DeformationResult(part.task.mesh.V, 0, True))

    def _piece(self, part: Part, *, anew: bool) -> Piece:
        """Return the piece of a part: a kept one that fits, or a new one.

        A drag goes on with a piece that has another number of samples, or was bound without rotations.
        """
        handles, known = part.task.handles, self._pieces.get(part.component)
        if known is not None and known.fits(handles, part.options.vertices if anew else None):
            return known
        options = options_of(part).of_proxy()
        keep = self._keep and options.proxy_method is None and options.accelerate
        progress = part.progress if keep else silent
        piece = Piece(part.task.mesh, handles, options, recipe=self._recipe, keep=keep, progress=progress)
        if keep:
            self._pieces[part.component] = piece
        return piece

    def _deformed(
        self,
        task: DeformationTask,
        stop: Stop | None,
        *,
        step: bool = False,
        anew: bool = False,
        out: np.ndarray | None = None,
        progress: Progress = silent,
    ) -> DeformationResult:
        """Deform the mesh for a task at its targets, part by part; `fine` polishes, but not in a step.

        A drag goes on where the last call ended. A deformation that begins `anew` needs pieces that fit
        exactly. `out` is for a mesh of one part.
        """
        if self._options.method == "interpolate":
            return interpolate_handles(task, progress=progress)
        assembly = self._assembly(task, progress)
        self._proxies = self._proxies if step else []
        for part in assembly.parts():
            own, report = part.task, part.progress
            proxies: list[tuple[np.ndarray, np.ndarray]] = []
            with part.named():
                options = part.options if step else options_of(part)
                if self._recipe.part is not None:
                    result = self._recipe.part(own, report)
                elif step:
                    result = self._piece(part, anew=False).deform(own, stop=stop, at_once=False, out=out)
                elif options.polish and own.handles.hard.sum() != own.mesh.n:
                    begin = perf_counter()
                    with beside(partial(set_up, own, options), size=own.mesh.n) as ready:
                        result = polished(
                            own,
                            options,
                            # Only `polished` has the result, and nothing the piece, so that it can free both.
                            self._piece(part, anew=anew).deform(
                                own, stop=stop, proxies=proxies, progress=report
                            ),
                            ready=ready,
                            begin=begin,
                            progress=report,
                        )
                else:
                    result = self._piece(part, anew=anew).deform(
                        own, stop=stop, out=out, proxies=proxies, progress=report
                    )
                if self._recipe.part is None and not step:
                    result = replace(result, facts=self._facts(part, options, result))
            self._proxies += [(self._of_mesh(part, samples), faces) for samples, faces in proxies]
            assembly.put(result)
        result = assembly.together()
        if not step:
            _warn_of_volume(assembly.states)
        return result

    def _of_mesh(self, part: Part, vertices: np.ndarray) -> np.ndarray:
        """Return the vertices of `mesh` for vertices of a part."""
        origin = None if self._components is None else self._components.origin(part.component)
        return vertices if origin is None else origin[vertices]

    def _assembly(
        self, task: DeformationTask, progress: Progress, *, rigid: bool = True
    ) -> Assembly | SinglePart:
        """Return the parts of the mesh at a task's targets."""
        components = self._components
        if components is None or components.is_one_manifold:
            return SinglePart(components, task, self._options, progress)
        return Assembly(components, task, self._options, progress, rigid=rigid)

    def _facts(self, part: Part, options: Options, result: DeformationResult) -> Facts:
        """Return the facts of a part with its options, and the error of its volume goal."""
        given = self._options
        totals = replace(options, vertices=given.vertices, volume=given.volume, volume_goal=given.volume_goal)
        facts = replace(result.facts, options=as_row(totals))
        if options.volume_goal is None:
            return facts
        error = goal_error(part.task.mesh, result.vertices, options.volume_goal)
        if options.volume == inf:
            warn_of_missed(error)
        return replace(facts, volume_goal_error=error)

    def _at_rest(
        self, mesh: Mesh, index: np.ndarray, group: np.ndarray | None, weight: np.ndarray | float
    ) -> tuple[np.ndarray, Handles]:
        """Return the vertices of `mesh` for the given ids (h,), and the handles there, at rest.

        Copies of a vertex along a seam are one handle.
        """
        if self._shape is None:
            given = checked_index(ids_of(index, mesh.n), once=True)
        else:
            ids = checked_index(ids_of(index, len(self._shape.V)), once=True)
            given = self._shape.surface.places(ids)
        handles = Handles(given, mesh.V[given], group=group, weight=weight)  # type: ignore[arg-type]
        return given, DeformationTask("drag", mesh, handles).handles

    def _at(self, targets: Handles | np.ndarray, rotations: np.ndarray | None) -> Handles:
        """Return the handles at targets (h, 3), in the order in which their vertices were given."""
        rest = self._task.handles
        if isinstance(targets, Handles):
            if targets is rest:
                return rest
            targets.require_same(rest)
            return replace(self._task, handles=targets, truth=None, guess=None).handles
        if len(self._given) > len(rest):
            # The first of the given handles at each handle vertex.
            first = np.sort(np.unique(self._given, return_index=True)[1])
            targets = checked_target(targets, self._given)[first]
            rotations = None if rotations is None else np.asarray(rotations)[first]
        return rest.at(targets, rotations)

    def _own(self, out: np.ndarray | None) -> np.ndarray | None:
        """Return `out` if a piece can write all of it: no seam has copies, and the mesh is one part."""
        return out if self._is_as_given and self._components is None else None

    def _require_out(self, out: np.ndarray | None) -> None:
        if out is not None:
            checked_out(out, self.mesh.V.shape if self._shape is None else self._shape.V.shape)

    def _placed(
        self, result: DeformationResult, task: DeformationTask, *, out: np.ndarray | None = None
    ) -> DeformationResult:
        """Return the result for the vertices that were given, written to `out`."""
        as_given = self._is_as_given
        if self._shape is not None and not as_given:
            result = replace(result, vertices=self._shape.placed(result.vertices))
        if out is not None and result.vertices is not out:
            out[:] = result.vertices
            result = replace(result, vertices=out)
        return result.of(task) if as_given else result


def options_of(part: Part) -> Options:
    """Return the options of a part: handle regions and a volume goal change them."""
    mesh, options = part.task.mesh, part.options
    if has_regions(mesh, part.task.handles.index, options):
        options = options.with_regions()
    if options.volume_goal is None:
        return options
    if not mesh.is_closed:
        raise InputError("volume_goal needs a closed surface, and this one has a boundary: close its holes")
    if not abs(mesh.volume) > FLAT * mesh.area**1.5:
        raise InputError("volume_goal needs a volume at rest to compare with, and this surface is flat")
    return options if "area" in options.given else replace(options, area=min(options.area, GOAL_AREA))


def goal_error(mesh: Mesh, V: np.ndarray, volume_goal: float) -> float:
    """Return the relative error of the volume of M' (n, 3)."""
    F = mesh.F.astype(np.uint32)
    return abs(enclosed_volume(V, F) / (volume_goal * enclosed_volume(mesh.V, F)) - 1)


def warn_of_missed(error: float) -> None:
    """Warn of a volume whose relative error is above :data:`MISSED`."""
    if error > MISSED:
        log.warning("the volume of the mesh is %.2g %% from its goal", 100 * error)


def _warn_if_nothing_is_fixed(task: DeformationTask, options: Options) -> None:
    """Warn if all handles make one rigid motion, because the mesh then moves as a whole."""
    handles = task.handles
    if handles.has_rotation.any() or options.volume_goal is not None or task.is_at_rest:
        return
    if common_motion(task.mesh.V[handles.index], handles.target) is not None:
        log.warning(
            "nothing is fixed: all handles make the same move, so that the mesh moves as a whole; fix some "
            "vertices"
        )


def _warn_of_volume(states: list[str]) -> None:
    """Warn once of all parts whose volume should be constrained, but is not, from the states of all parts."""
    for state, count in Counter(state for state in states if state.startswith("off: ")).items():
        where = f" in {count} of {len(states)} components" if len(states) > 1 else ""
        log.warning("the volume is not kept%s: %s", where, NO_VOLUME[state.removeprefix("off: ")])


def _hard_error(task: DeformationTask, V: np.ndarray) -> float:
    """Return the largest distance of a hard handle from its target, as a fraction of the diagonal."""
    handles = task.handles
    distance = np.linalg.norm(V[handles.index] - handles.target, axis=1)[handles.hard]
    return float(distance.max(initial=0.0)) / task.mesh.diagonal


#: The public name.
Deformer = Bound
