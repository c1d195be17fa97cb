"""The pieces of a mesh of several components, or that is not manifold.

The engine needs a connected, oriented manifold. Other meshes are cut into an oriented manifold
(:mod:`sshade.mesh.cutting`). Vertices that cutting has copied are placed first, by one coarse solve of
all components that have such vertices (:mod:`sshade.method.junctions`). The components are then deformed
one after another, with their copies fixed there, so that they fit together again. A component without
handles that is joined to no other is unconstrained: a task refuses it, or lets it follow the nearest
component rigidly.

A one-sided surface becomes a surface of twice its area, its two sides, which are deformed together; each
vertex goes to the mean of its two copies. The mean is as smooth as the sides are, so nothing tears.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sshade.core.errors import InputError, counted
from sshade.core.progress import Progress, renamed
from sshade.mesh.cutting import cut_to_manifold, without_duplicates
from sshade.mesh.unconstrained import contacts, leaders, move_rigidly
from sshade.method.component_set import ComponentSet, at_means
from sshade.problem.facts import Facts
from sshade.problem.options import Options
from sshade.problem.task import DeformationResult, DeformationTask, joined

log = logging.getLogger(__name__)

#: Why a volume cannot be kept, by the reasons of :mod:`sshade.solver.constraints`.
NO_VOLUME = {
    "boundary": "the surface has a boundary",
    "orientation": "the surface has no inside",
    "flat": "the surface is flat",
    "one-sided": "the surface has one side",
}

#: Largest distance of the sides of a one-sided surface from their mean, as a fraction of the diagonal. Sides
#: farther apart are in two local minima; the surface is deformed again, both sides from their mean.
APART = 0.01
#: Number of copies over the number of vertices from which on a cut mesh is taken for one with inner faces.
INNER = 0.5


@dataclass(frozen=True)
class Piece:
    """A connected, oriented manifold that is deformed by itself.

    Attributes
    ----------
    task : DeformationTask
    changes : mapping
        Options that differ from the options of the whole.
    progress : Progress
    component : int
        Of the cut mesh.
    where : str
        Place for errors; empty if the piece is the whole mesh.
    """

    task: DeformationTask
    changes: Mapping[str, Any]
    progress: Progress
    component: int = 0
    where: str = ""

    @contextmanager
    def named(self) -> Iterator[None]:
        """Name the piece in an InputError."""
        try:
            yield
        except InputError as error:
            if not self.where:
                raise
            raise InputError(f"{self.where} cannot be deformed: {error}") from error


class Pieces:
    """The pieces of a task's mesh, and their results.

    A connected, oriented manifold is one piece; other meshes are cut. A component whose hard handles
    share one rigid motion moves with them, without a proxy, unless it is joined to another component.
    Unconstrained components follow the nearest component: see
    :func:`sshade.mesh.unconstrained.move_rigidly`.

    Parameters
    ----------
    task : DeformationTask
    options : Options
        `vertices` is a total, distributed over components by area. A component with n vertices has at most
        n / 4 proxy vertices, and at least its handles and a few more: see
        :func:`sshade.proxy.sample.proxy_vertices`. Other components get the rest of its portion. Both sides
        of a one-sided surface count.
    progress : Progress

    Raises
    ------
    InputError
        If the proxy cannot hold the handles.
    """

    def __init__(self, task: DeformationTask, options: Options, progress: Progress) -> None:
        self._task, self._options, self._progress = task, options, progress
        self._results: list[DeformationResult] = []
        self._facts: dict[str, Any] = {}
        self._parts: ComponentSet | None = None
        self._alone: DeformationTask | None = task
        whole = task.mesh
        if whole.topology.components == 1 and whole.is_manifold and whole.is_oriented:
            return
        mesh = without_duplicates(whole)
        self._mesh, self._unconstrained = mesh, mesh.components_without(task.handles.index)
        self._contact = contacts(mesh, self._unconstrained)
        self._contact.warn()
        cut = cut_to_manifold(mesh)
        self._facts = {
            "components": 1,
            "unconstrained": len(self._unconstrained),
            "touching": self._contact.components,
            "duplicates": whole.m - mesh.m,
            "one_sided": 0,
            "copies": len(cut.origin) - mesh.n - len(np.unique(mesh.F[cut.one_sided])),
            "turned": cut.turned,
            "gap": 0.0,
        }
        sheets = cut.mesh.topology.components
        if self._facts["copies"] > INNER * mesh.n:
            log.warning(
                "more than two faces meet at an edge in most of the mesh, as faces inside of a solid do, and "
                "it is cut into %s; leave out the inner faces, and keep the outer surface",
                counted(sheets, "sheet", "sheets"),
            )
        if sheets == 1 and cut.mesh is mesh:
            self._alone = replace(task, mesh=mesh)
            return
        self._alone, self._parts = None, ComponentSet(mesh, cut, task, options)
        every = self._parts.order()
        self._order = [component for component in every if not self._parts.move_with_handles(component)]
        self._facts |= {"components": len(every), "rigid": len(every) - len(self._order)}
        self._parts.place_junctions(self._order, progress)

    def in_order(self) -> Iterator[Piece]:
        """Yield the pieces; :meth:`put` takes each result before the next piece is made.

        Pieces with handles come first, then pieces that are joined to earlier pieces.
        """
        parts = self._parts
        if parts is None:
            assert self._alone is not None
            yield Piece(self._alone, {}, self._progress)
            return
        vertices = parts.proxy_vertices(self._order)
        for number, component in enumerate(self._order):
            stage = f"component {number + 1}/{len(self._order)}"
            task, changes = parts.part(component, int(vertices[number]))
            report = renamed(self._progress, stage, within=True)
            where = f"the component of {task.mesh.n} vertices around vertex {parts.origin(component)[0]}"
            yield Piece(task, changes, report, component, where)

    def again(self, piece: Piece, result: DeformationResult) -> Piece | None:
        """Return the piece from the mean of its sides, if it is one-sided and its sides came apart."""
        if self._parts is None or self._parts.sides(piece.component) == 1:
            return None
        means = at_means(self._parts.origin(piece.component), result.vertices)
        if np.linalg.norm(result.vertices - means, axis=1).max() <= APART * piece.task.mesh.diagonal:
            return None
        return replace(piece, task=replace(piece.task, guess=means))

    def put(self, piece: Piece, result: DeformationResult) -> None:
        """Take the result of a piece."""
        if self._parts is not None:
            self._parts.put(piece.component, result.vertices)
            if self._parts.sides(piece.component) == 2 and self._options.volume > 0:
                facts = replace(result.facts, volume_constraint="off: one-sided")
                result = replace(result, facts=facts)
        self._results.append(result)

    def together(self) -> DeformationResult:
        """Return the result of the whole mesh.

        Of a mesh that was cut, `iterations` is the mean over components.
        """
        results, parts = self._results, self._parts
        _warn_of_volume([result.facts for result in results])
        if parts is None:
            return replace(results[0], facts=replace(results[0].facts, **self._facts))
        V = parts.positions
        move_rigidly(self._mesh, V, leaders(self._mesh, self._unconstrained))
        gaps = {**parts.gaps, "opening": self._contact.opening(V)}
        facts = {**self._facts, "one_sided": int(parts.one_sided.sum())}
        facts |= {name: gap / self._mesh.diagonal for name, gap in gaps.items()}
        all_rigid = DeformationResult(V, 0, True, facts=Facts(residual=0.0))
        joint = joined(V, results or [all_rigid], "pieces")
        seconds = {**parts.seconds, **joint.seconds}
        return replace(joint, seconds=seconds, facts=replace(joint.facts, **facts))


def both(first: DeformationResult, again: DeformationResult) -> DeformationResult:
    """Return the second result of a piece that was deformed twice, with the work of both."""
    work = joined(again.vertices, [first, again], "pieces")
    return replace(again, iterations=2 * work.iterations, seconds=work.seconds)


def _warn_of_volume(facts: list[Facts]) -> None:
    """Warn once of all pieces whose volume should be constrained, but is not."""
    states = [fact.volume_constraint or "" for fact in facts]
    for state, count in Counter(state for state in states if state.startswith("off: ")).items():
        where = f" in {count} of {len(facts)} components" if len(facts) > 1 else ""
        log.warning("the volume is not kept%s: %s", where, NO_VOLUME[state.removeprefix("off: ")])
