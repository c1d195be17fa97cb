"""The components of a mesh that is cut, and how the results of its pieces are put together.

A piece is a connected, oriented manifold. Other meshes are cut into an oriented manifold
(:mod:`sshade.mesh.cutting`), whose components are deformed one after another:

- a component whose hard handles share a rigid motion moves with them as a whole, without a proxy, unless it
  is joined to another component;
- vertices that cutting has copied are placed first, by one coarse solve of all components that have such
  vertices (:mod:`sshade.method.junctions`). The components are then deformed with their copies fixed there,
  so that they fit together again;
- a component without handles that is joined to no other is free: it moves rigidly with the nearest vertices
  of another component.

A one-sided surface becomes a surface of twice its area, its two sides, which are deformed together; each
vertex goes to the mean of its two copies. The mean is as smooth as the sides are, so nothing tears.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from scipy.sparse import csr_array

from sshade.core.errors import InputError, counted
from sshade.core.progress import Progress, renamed
from sshade.mesh.cutting import cut_to_manifold, without_duplicates
from sshade.mesh.incidence import at_means, flagged, members, numbered
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import common_motion
from sshade.mesh.unconstrained import contacts, leaders, move_rigidly
from sshade.method.junctions import deform_joined
from sshade.problem.facts import Facts
from sshade.problem.options import Options
from sshade.problem.task import DeformationResult, DeformationTask, Handles, joined
from sshade.proxy.sample import least_vertices, proxy_vertices, shared_vertices
from sshade.regions.handle_regions import EDGE_SAMPLES

log = logging.getLogger(__name__)

#: Largest distance of the sides of a one-sided surface from their mean, as a fraction of the diagonal. Sides
#: farther apart are in two local minima; the surface is deformed again, both sides from their mean.
APART = 0.01
#: Number of copies over the number of vertices from which on a cut mesh is taken for one with inner faces.
INNER = 0.5


@dataclass(frozen=True)
class Part:
    """The task of a connected, oriented manifold that is deformed by itself.

    Attributes
    ----------
    task : DeformationTask
    options : Options
    progress : Progress
    component : int
        Of the cut mesh.
    where : str
        Place for errors; empty if it is the whole mesh.
    """

    task: DeformationTask
    options: Options
    progress: Progress
    component: int = 0
    where: str = ""

    @contextmanager
    def named(self) -> Iterator[None]:
        """Name the part in an InputError."""
        try:
            yield
        except InputError as error:
            if not self.where:
                raise
            raise InputError(f"{self.where} cannot be deformed: {error}") from error


class Components:
    """The components of a mesh that is no connected, oriented manifold, for one set of handle vertices.

    Parameters
    ----------
    mesh : Mesh
    index : (k,) int
        Handle vertices.

    Attributes
    ----------
    mesh : Mesh
        Without faces that are there twice.
    cut : Cut
    component : (c,) int64
        Component of each vertex of the cut mesh.
    area : (c,) float64
        Of each component.
    sides : (c,) int64
        Number of sides of the surface in each component: 2 where it covers a one-sided surface.
    copies : (n, c) csr_array
        Number of copies of each vertex in each component.
    order : list of int
        Components with handles, then components joined to earlier components; larger first.
    is_one_manifold : bool
        Whether the mesh without faces that are there twice is one connected, oriented manifold.
    """

    def __init__(self, mesh: Mesh, index: np.ndarray) -> None:
        self.mesh = without_duplicates(mesh)
        self._free = self.mesh.components_without(index)
        self._contact = contacts(self.mesh, self._free)
        self._contact.warn()
        self._led = leaders(self.mesh, self._free)
        self.cut = cut_to_manifold(self.mesh)
        sheets = self.cut.mesh.topology.components
        self.is_one_manifold = sheets == 1 and self.cut.mesh is self.mesh
        self._duplicates = mesh.m - self.mesh.m
        self._copies = len(self.cut.origin) - self.mesh.n - len(np.unique(self.mesh.F[self.cut.one_sided]))
        if self._copies > INNER * self.mesh.n:
            log.warning(
                "more than two faces meet at an edge in most of the mesh, as faces inside of a solid do, and "
                "it is cut into %s; leave out the inner faces, and keep the outer surface",
                counted(sheets, "sheet", "sheets"),
            )
        self.component = self.cut.mesh.component
        self._members = members(self.component, sheets)
        of_face = self.component[self.cut.mesh.F[:, 0]]
        self._faces = members(of_face, sheets)
        self.area = np.bincount(of_face, self.cut.mesh.face_areas)
        self.sides = np.where(flagged(of_face[self.mesh.m :], sheets), 2, 1)
        entries = np.ones(len(self.cut.origin)), (self.cut.origin, self.component)
        self.copies = csr_array(entries, shape=(self.mesh.n, sheets))
        self.order = self._in_order(numbered(index, self.mesh.n) >= 0)

    def _in_order(self, handle: np.ndarray) -> list[int]:
        copies = self.copies
        beside, waiting = copies.T @ copies, copies.T @ handle > 0
        found: list[int] = []
        seen = waiting
        while waiting.any():
            ids = np.flatnonzero(waiting)
            found += ids[np.argsort(-self.area[ids], kind="stable")].tolist()
            waiting = (beside @ waiting > 0) & ~seen
            seen = seen | waiting
        return found

    def origin(self, component: int) -> np.ndarray:
        """Return the vertices (k,) of the uncut mesh of a component's vertices."""
        return self.cut.origin[self._members[component]]

    def part(self, component: int) -> Mesh:
        """Return the mesh of a component."""
        return self.cut.mesh.part(self._members[component], self._faces[component])

    def move_free(self, V: np.ndarray) -> None:
        """Move the free components of positions V (n, 3)."""
        move_rigidly(self.mesh, V, self._led)

    def handles_on(self, component: int, handles: Handles) -> Handles | None:
        """Return the handles on a component; None without any, or if others share its vertices."""
        origin = self.origin(component)
        number = numbered(handles.index, self.mesh.n)[origin]
        own = np.flatnonzero(number >= 0)
        if len(own) == 0 or (np.diff(self.copies.indptr)[origin] > 1).any():
            return None
        own = own[np.argsort(number[own], kind="stable")]
        return handles.sampled(number[own], own, self.mesh.V)

    def facts_of(self, result: DeformationResult) -> Facts:
        """Return the facts of a result, and those of the cut."""
        return replace(
            result.facts,
            unconstrained=len(self._free),
            touching=self._contact.components,
            duplicates=self._duplicates,
            copies=self._copies,
            turned=self.cut.turned,
        )

    def opening(self, V: np.ndarray) -> float:
        """Return the largest gap at a contact, at positions V (n, 3), as a fraction of the diagonal."""
        return self._contact.opening(V) / self.mesh.diagonal


class SinglePart:
    """The one part of a connected, oriented manifold; see :class:`Assembly`.

    Parameters
    ----------
    components : Components or None
        If faces that are there twice were left out.
    task, options, progress
    """

    def __init__(
        self, components: Components | None, task: DeformationTask, options: Options, progress: Progress
    ) -> None:
        self._components = components
        task = task if components is None else replace(task, mesh=components.mesh)
        self._part = Part(task, options, progress)

    def parts(self) -> Iterator[Part]:
        yield self._part

    def put(self, result: DeformationResult) -> None:
        self._result = result

    @property
    def states(self) -> list[str]:
        return [self._result.facts.volume_constraint or ""]

    def together(self) -> DeformationResult:
        if self._components is None:
            return self._result
        return replace(self._result, facts=self._components.facts_of(self._result))


class Assembly:
    """The parts of one deformation of a mesh that is cut, and the positions found so far.

    Parameters
    ----------
    components : Components
    task : DeformationTask
        Of the whole mesh.
    options : Options
        `vertices` is a total, distributed over components by area. A component with n vertices has at most
        n / 4 proxy vertices, and at least its handles and a few more: see
        :func:`sshade.proxy.sample.proxy_vertices`. Other components get the rest of its portion. Both sides
        of a one-sided surface count.
    progress : Progress
    rigid : bool
        Move components rigidly whose handles make a rigid motion; otherwise they are parts.

    Raises
    ------
    InputError
        If the proxy cannot hold the handles.
    """

    def __init__(
        self,
        components: Components,
        task: DeformationTask,
        options: Options,
        progress: Progress,
        *,
        rigid: bool = True,
    ) -> None:
        self._components = components
        self._task = task
        self._handles = task.handles
        self._options = options
        self._progress = progress
        self._number = numbered(task.handles.index, components.mesh.n)
        self._hard = task.handles.hard & ~task.handles.has_rotation
        self._guess = [task.guess] * len(components.area)
        self._found = DeformationResult(np.empty((0, 3)), 0, None)
        self._results: list[DeformationResult] = []
        self._seconds: dict[str, float] = {}
        self._positions = np.array(components.mesh.V)
        self._done = np.zeros(components.mesh.n, dtype=bool)
        #: Largest distance of a copy from the position of its vertex; the same for sides of a surface.
        self._gap = self._side_gap = 0.0
        self._one_sided = np.zeros(components.mesh.n, dtype=bool)
        self._order = [one for one in components.order if not (rigid and self._move_with_handles(one))]
        self._place_junctions(progress)

    def parts(self) -> Iterator[Part]:
        """Yield the parts; :meth:`put` takes each result before the next part is made.

        Parts with handles come first, then parts that are joined to earlier parts. A one-sided part whose
        sides came apart comes again, from the mean of its sides.
        """
        components, vertices = self._components, self._proxy_vertices()
        for number, component in enumerate(self._order):
            task, options = self._part(component, int(vertices[number]))
            stage = f"component {number + 1}/{len(self._order)}"
            report = renamed(self._progress, stage, within=True)
            first = components.origin(component)[0]
            where = f"the component of {task.mesh.n} vertices around vertex {first}"
            part = Part(task, options, report, component, where)
            yield part
            if components.sides[component] == 2:
                first = self._found
                means = at_means(components.origin(component), first.vertices)
                if np.linalg.norm(first.vertices - means, axis=1).max() > APART * task.mesh.diagonal:
                    yield replace(part, task=replace(task, guess=means))
                    work = joined(means, [first, self._found], "pieces")
                    self._found = replace(self._found, iterations=2 * work.iterations, seconds=work.seconds)
            self._take(component, self._found)

    def put(self, result: DeformationResult) -> None:
        """Take the result of the last part."""
        self._found = result

    @property
    def states(self) -> list[str]:
        """States of the volume of all parts."""
        return [result.facts.volume_constraint or "" for result in self._results]

    def _take(self, component: int, result: DeformationResult) -> None:
        V, origin = result.vertices, self._components.origin(component)
        new = ~self._done[origin]
        self._positions[origin[new]] = at_means(origin[new], V[new])
        self._done[origin] = True
        gap = float(np.linalg.norm(V - self._positions[origin], axis=1).max())
        if self._components.sides[component] == 1:
            self._gap = max(self._gap, gap)
        else:
            self._side_gap = max(self._side_gap, gap)
            self._one_sided[origin] = True
            if self._options.volume > 0:
                result = replace(result, facts=replace(result.facts, volume_constraint="off: one-sided"))
        self._results.append(replace(result, vertices=np.empty((0, 3))))

    def together(self) -> DeformationResult:
        """Return the result of the whole mesh; `iterations` is the mean over parts."""
        components, V, diagonal = self._components, self._positions, self._components.mesh.diagonal
        components.move_free(V)
        all_rigid = DeformationResult(V, 0, True, facts=Facts(residual=0.0))
        joint = joined(V, self._results or [all_rigid], "pieces")
        facts = replace(
            components.facts_of(joint),
            components=len(components.order),
            rigid=len(components.order) - len(self._order),
            one_sided=int(self._one_sided.sum()),
            gap=self._gap / diagonal,
            side_gap=self._side_gap / diagonal,
            opening=components.opening(V),
        )
        return replace(joint, seconds={**self._seconds, **joint.seconds}, facts=facts)

    def _move_with_handles(self, component: int) -> bool:
        """Move a component by the rigid motion that its hard handles share; return whether there is one.

        Components that are joined to others stay, because a joint may belong to a shape that bends.
        """
        origin, handles = self._components.origin(component), self._handles
        number = np.unique(self._number[origin])
        number = number[number >= 0]
        if len(number) == 0 or not self._hard[number].all():
            return False
        if (np.diff(self._components.copies.indptr)[origin] > 1).any():
            return False
        if self._options.volume_goal is not None:
            return False
        motion = common_motion(self._task.mesh.V[handles.index[number]], handles.target[number])
        if motion is None:
            return False
        R, t = motion
        self._positions[origin] = self._task.mesh.V[origin] @ R.T + t
        self._positions[handles.index[number]] = handles.target[number]
        self._done[origin] = True
        return True

    def _place_junctions(self, progress: Progress) -> None:
        """Fix the junctions of components that will be deformed, and let each of them begin where they fit.

        A junction has copies in several components, or more copies than sides in one component.
        """
        components = self._components
        chosen = flagged(np.array(self._order, dtype=np.int64), len(components.area))
        junction = components.copies @ (chosen / components.sides) > 1
        chosen &= components.copies.T @ junction > 0
        number = self._number[junction]
        if (self._handles.hard[number] & (number >= 0)).all():
            return
        begin = perf_counter()
        vertex = np.flatnonzero(chosen[components.component])
        cut, origin, guess = components.cut.mesh, components.cut.origin[vertex], self._task.guess
        V = deform_joined(
            cut.part(vertex, chosen[components.component[cut.F[:, 0]]]),
            origin,
            junction[origin],
            self._handles_of(origin),
            self._options,
            guess=None if guess is None else guess[origin],
            progress=progress,
        )
        placed = np.array(self._task.mesh.V)
        placed[origin] = at_means(origin, V)
        junction[self._handles.index[self._handles.hard]] = False
        self._positions[junction] = placed[junction]
        self._done[junction] = True
        for component in np.flatnonzero(chosen):
            self._guess[component] = placed
        self._seconds["junctions"] = perf_counter() - begin

    def _proxy_vertices(self) -> np.ndarray:
        """Return (c,) int64: the numbers of proxy vertices of components in their order.

        Raise InputError if the handles of the components find no room on the proxy.
        """
        asked, handles = self._options.vertices, int((~self._done[self._handles.index]).sum())
        if asked < (needed := min(handles, EDGE_SAMPLES)):
            raise InputError(
                f"{asked} proxy vertices were asked for: at least {needed} are needed, to hold the {handles} "
                "handle vertices; raise the option vertices"
            )
        order, components = self._order, self._components
        fixed = self._done | (self._number >= 0)
        least, most = np.zeros((2, len(order)), dtype=np.int64)
        for number, component in enumerate(order):
            origin = components.origin(component)
            n, handles = len(origin), int(fixed[origin].sum())
            least[number] = min(n, least_vertices(handles))
            most[number] = proxy_vertices(n, n, handles, coarser=self._options.coarser)
            fixed[origin] = True
        return shared_vertices(asked, components.area[order], least, most)

    def _part(self, component: int, vertices: int) -> tuple[DeformationTask, Options]:
        """Return the task and the options of a component, with its share of the proxy vertices."""
        origin, guess, options = self._components.origin(component), self._guess[component], self._options
        shape, handles = self._components.part(component), self._handles_of(origin)
        vertices = max(vertices, least_vertices(len(handles)))
        vertices = proxy_vertices(vertices, shape.n, len(handles), coarser=options.coarser)
        options = replace(options, vertices=vertices)
        if self._components.sides[component] == 2:
            if options.volume_goal is not None:
                raise InputError(
                    f"the surface around vertex {origin[0]} has one side and no volume; give it no volume "
                    "goal"
                )
            options = replace(options, volume=0.0, thickness=0.0)  # the sides enclose nothing
        guess = None if guess is None else guess[origin]
        return DeformationTask("component", shape, handles, guess=guess), options

    def _handles_of(self, origin: np.ndarray) -> Handles:
        """Handles of a component, then copies of finished vertices, fixed at their positions."""
        handles, number = self._handles, self._number[origin]
        fixed = self._done[origin] & ~((number >= 0) & handles.hard[number])  # also where a handle is soft
        with_handle, seam = np.flatnonzero((number >= 0) & ~fixed), np.flatnonzero(fixed)
        with_handle = with_handle[np.argsort(number[with_handle], kind="stable")]
        number = number[with_handle]
        vertex, count = np.concatenate([with_handle, seam]), len(seam)
        rotation = handles.rotation
        if rotation is not None:
            rotation = np.concatenate([rotation[number], np.full((count, 3, 3), np.nan)])
        portion = handles.portion
        if portion is not None:
            portion = np.concatenate([portion[number], np.ones(count)])
        return Handles(
            vertex,
            np.concatenate([handles.target[number], self._positions[origin[seam]]]),
            dynamic=np.concatenate([handles.dynamic[number], np.ones(count, dtype=bool)]),
            group=np.concatenate([handles.group[number], np.full(count, handles.group.max() + 1)]),
            weight=np.concatenate([handles.weight[number], np.full(count, np.inf)]),
            rotation=rotation,
            area_portion=portion,
        )
