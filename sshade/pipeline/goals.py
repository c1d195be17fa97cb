"""Goals for the volume of a component and of its parts: on the mesh, and on its proxies.

A part of M stands for the faces of a proxy N that lie in it. Both parts end at slightly different places, so
that a goal on N gives M' another volume. :class:`sshade.pipeline.engine.BoundProxy` therefore corrects the
goals on N in a few rounds. A small move along the normals removes the remaining deficit.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from sshade.errors import InputError
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.ids import flagged
from sshade.mesh.mesh import Mesh, unit_rows
from sshade.mesh.surface import cut_surface
from sshade.mesh.unconstrained import without_handles
from sshade.options import Options, resolve
from sshade.sampling.fronts import Fronts
from sshade.sampling.proxy import Sampling
from sshade.solver.capped import CappedVolume
from sshade.task import DeformationTask
from sshade.volume_goals import VolumeGoal

log = logging.getLogger(__name__)

#: Largest default weight of the area with a volume goal. A body that grows needs more area.
GOAL_AREA = 0.1
#: Least volume of a part, as a multiple of area^1.5. The ratio of two volumes near zero means nothing.
FLAT = 1e-5
#: Relative difference at which two goals for one volume contradict each other.
SAME = 1e-9
#: Relative error of a goal from which on a warning is logged.
MISSED = 0.01
#: Largest correction of the volumes of a proxy, as a multiple of the deficits of M'.
LONGEST = 5.0
#: Number of Newton steps of the last correction.
NEWTON_STEPS = 5


def with_ratios(
    task: DeformationTask, method: str, values: Mapping[str, Any]
) -> tuple[DeformationTask, Mapping[str, Any]]:
    """Return a task whose volume goals are ratios of parts, and the options with the goal of the whole.

    Parameters
    ----------
    task : DeformationTask
    method : str
        A key of :data:`sshade.options.PRESETS`.
    values : mapping
        Options of the user.

    Raises
    ------
    InputError
        When the whole has two goals, volumes are unconstrained, the mesh has no volume to compare with, or a
        part lies on components without handles.
    """
    if not task.volumes:
        return task, values
    options = resolve(method, values)
    if options.volume == 0:
        raise InputError("volume goals need a weight of the volume, which is 0 here; give volume=inf")
    if options.coarse is not None:
        raise InputError("volume goals need our solver; leave `coarse` out")
    # Whether each vertex is on a component without handles, which keeps its shape.
    carried = np.isin(task.mesh.component, without_handles(task.mesh, task.handles.index))
    parts, ratio = [], options.volume_goal
    for goal in task.volumes:
        if goal.faces is not None and not (~carried[task.mesh.F[goal.faces, 0]]).any():
            raise InputError(f"{goal.title} lies on components without handles, which keep their shape")
        value = goal.ratio if goal.volume is None else goal.volume / _rest_volume(task, goal, carried)
        assert value is not None
        if goal.faces is not None:
            parts.append(VolumeGoal(ratio=value, faces=goal.faces, name=goal.name))
        elif options.volume_goal is not None:
            raise InputError("the whole mesh has two volume goals; leave the option volume_goal out")
        else:
            ratio = value
    return replace(task, volumes=tuple(parts)), {**values, "volume_goal": ratio}


def _rest_volume(task: DeformationTask, goal: VolumeGoal, carried: np.ndarray) -> float:
    """Volume of a part at rest, without `carried` vertices (n,) bool; positive also inside of a vessel."""
    mesh = task.mesh
    cut = cut_surface(mesh)
    if cut.one_sided.any():
        raise InputError("a one-sided surface has no volume; give no volume goal")
    faces = np.ones(mesh.m, dtype=bool) if goal.faces is None else flagged(goal.faces, mesh.m)
    faces &= ~carried[mesh.F[:, 0]]
    # Cutting keeps the order of faces; duplicates of faces are left out before.
    if len(cut.mesh.F) != mesh.m:
        raise InputError("a volume in units needs a mesh without duplicate faces; give a ratio, or repair it")
    measured = CappedVolume(cut.mesh.F[faces]).measure(cut.mesh.V) if faces.any() else np.zeros(2)
    _require_volume(measured, goal.title)
    return abs(float(measured[0]))


def _require_volume(measured: np.ndarray, title: str) -> None:
    """Raise InputError if a volume, measured with its area, is nearly zero."""
    volume, area = measured
    if not abs(volume) > FLAT * area**1.5:
        raise InputError(f"{title} has no volume at rest to compare with: its faces and caps are flat")


def on_component(
    mesh: Mesh, volumes: Sequence[VolumeGoal], options: Options, *, area: bool
) -> tuple[Options, tuple[VolumeGoal, ...]]:
    """Return the options of a component with the goal of its whole volume, and the goals of its parts.

    A closed component whose parts have goals, and whose whole has none, keeps the volume outside of the
    parts. The whole of an open component is a part with all faces. Without goals nothing changes.

    Parameters
    ----------
    mesh : Mesh
        The component: an oriented manifold.
    volumes : sequence of VolumeGoal
        Ratios of disjoint parts.
    options : Options
        `volume_goal` is the ratio of the whole, or None.
    area : bool
        Whether the user gave a weight of the area.

    Raises
    ------
    InputError
        When goals contradict each other, or a part has no volume at rest.
    """
    ratio = options.volume_goal
    if ratio is None and not volumes:
        return options, ()
    if options.volume == 0:
        raise InputError("volume goals need a weight of the volume, which is 0 here; give volume=inf")
    all_faces = np.arange(mesh.m)
    whole = CappedVolume(mesh.F, caps=not mesh.is_closed).measure(mesh.V)
    _require_volume(whole, "the mesh")
    parts, implied, covered = list[VolumeGoal](), 1.0, 0
    for goal in volumes:
        assert goal.faces is not None and goal.ratio is not None
        if len(goal.faces) == mesh.m:
            if ratio is not None and abs(goal.ratio - ratio) > SAME * ratio:
                raise InputError(
                    f"{goal.title} is the whole mesh, whose goal is {ratio:g} and not {goal.ratio:g} times "
                    "its volume; give one goal"
                )
            ratio = goal.ratio
            continue
        measured = CappedVolume(mesh.F[goal.faces]).measure(mesh.V)
        _require_volume(measured, goal.title)
        parts.append(goal)
        implied += (goal.ratio - 1.0) * measured[0] / whole[0]
        covered += len(goal.faces)
    if covered == mesh.m:  # their volumes add up
        if ratio is not None and abs(implied - ratio) > SAME * ratio:
            raise InputError(
                f"the parts cover the mesh, and their goals add up to {implied:g} and not {ratio:g} times "
                "its volume; leave out the goal of the mesh"
            )
        ratio, parts = implied, parts[:-1]
    if mesh.is_closed:
        ratio = implied if ratio is None else ratio
        if not ratio > 0:
            raise InputError("the goals of the parts leave the mesh no volume; give smaller changes")
    elif ratio is not None:
        parts, ratio = [VolumeGoal(ratio=ratio, faces=all_faces, name="the whole"), *parts], None
    options = replace(options, volume_goal=ratio)
    if not area:
        options = replace(options, area=min(options.area, GOAL_AREA))
    return options, tuple(parts)


class Goals:
    """The volume goals of a component M, and its proxies' parts.

    Parameters
    ----------
    mesh : Mesh
        M.
    ratio : float, optional
        Goal of the whole of a closed mesh.
    parts : sequence of VolumeGoal
        Ratios of parts.

    Attributes
    ----------
    ratio, parts
        The parameters.
    """

    def __init__(self, mesh: Mesh, ratio: float | None, parts: Sequence[VolumeGoal]) -> None:
        self._mesh, self.ratio, self.parts = mesh, ratio, tuple(parts)
        self._first_part = 0 if ratio is None else 1

    @cached_property
    def _volumes(self) -> list[CappedVolume]:
        """The volumes that have goals, the whole before the parts."""
        F, faces = self._mesh.F, [goal.faces for goal in self.parts if goal.faces is not None]
        whole = [] if self.ratio is None else [CappedVolume(F, caps=False)]
        return [*whole, *(CappedVolume(F[own]) for own in faces)]

    @cached_property
    def _targets(self) -> np.ndarray:
        """The goals of these volumes, in length^3."""
        whole = [] if self.ratio is None else [self.ratio]
        ratios = np.array([*whole, *(goal.ratio for goal in self.parts)], dtype=np.float64)
        return ratios * self._measured(self._mesh.V)

    def _measured(self, V: np.ndarray, first: int = 0) -> np.ndarray:
        return np.array([volume.measure(V)[0] for volume in self._volumes[first:]])

    def deficits(self, V: np.ndarray) -> np.ndarray:
        """Return (p,) the volumes that the parts of M' (n, 3) lack, in length^3."""
        return self._targets[self._first_part :] - self._measured(V, self._first_part)

    def relative_error(self, V: np.ndarray) -> float:
        """Return the largest error of a part's volume in M' (n, 3), as a fraction of its goal."""
        return float(np.abs(self.deficits(V) / self._targets[self._first_part :]).max(initial=0.0))

    def errors(self, V: np.ndarray) -> list[tuple[str, float]]:
        """Return the name of each part and the relative error of its goal in M' (n, 3); first the mesh."""
        names = ["the mesh"] * self._first_part + [goal.name or "a part" for goal in self.parts]
        errors = self._measured(V) / self._targets - 1
        return list(zip(names, errors.tolist(), strict=True))

    def on_proxy(self, proxy: Mesh, sampling: Sampling, fixed: np.ndarray) -> list[np.ndarray]:
        """Return the faces (f,) of N that stand for each part.

        A vertex of M is in a part if most of its faces are; a face of N if most of its corners are. Vertices
        of M in `fixed` (n,) are hard handles.

        Raises
        ------
        InputError
            When a part has no face, or there are more goals than movable vertices.
        """
        goals, free = len(self._volumes), int((~fixed[sampling.samples]).sum())
        if goals > free:
            raise InputError(
                f"{goals} volume goals are too many for a proxy with {free} vertices that are no handles; "
                "raise the option vertices, or lower the option coarser"
            )
        F, n = self._mesh.F, self._mesh.n
        count, found = np.bincount(F.ravel(), minlength=n), []
        for goal in self.parts:
            assert goal.faces is not None
            within = np.bincount(F[goal.faces].ravel(), minlength=n)
            inside = 2 * within > count
            faces = np.flatnonzero(inside[sampling.samples][proxy.F].sum(axis=1) >= 2)
            if len(faces) == 0:
                finer = "raise the option vertices, or lower the option coarser"
                if len(sampling.samples) == n:
                    finer = "give it more faces: most faces of two vertices must belong to it"
                raise InputError(f"{goal.title} is smaller than the proxy's triangles; {finer}")
            found.append(np.arange(proxy.m) if len(goal.faces) == len(F) else faces)
        return found

    def corrected(self, V: np.ndarray, movable: np.ndarray, *, most: float) -> np.ndarray:
        """Move vertices along their normals until all goals hold; the move fades out at the ends of parts.

        Parameters
        ----------
        V : (n, 3) float64
            M'.
        movable : (n,) float64
            Weight of the move of each vertex, from 0 to 1.
        most : float
            Largest move, in the unit of length.
        """
        volumes, targets = self._volumes, self._targets
        normal = np.zeros((len(V), 3))
        CappedVolume(self._mesh.F, caps=False).add_gradient(V, 1.0, normal)
        normal = unit_rows(normal) * movable[:, None]
        weight = [np.ones(len(V))] * self._first_part + self._fades
        slope = np.empty((len(volumes), len(volumes)))
        for q, volume in enumerate(volumes):
            G = np.zeros((len(V), 3))
            volume.add_gradient(V, 1.0, G)
            along = np.einsum("ic,ic->i", G, normal)
            slope[q] = [along @ own for own in weight]
        shift, moved, best, smallest = np.zeros(len(volumes)), V, V, np.inf
        for _ in range(NEWTON_STEPS):
            deficit = targets - self._measured(moved)
            error = float(np.abs(deficit / targets).max())
            if error >= smallest:
                break
            best, smallest = moved, error
            if error <= SAME:
                break
            shift = shift + np.linalg.lstsq(slope, deficit, rcond=1e-8)[0]
            length = sum(m * own for m, own in zip(shift, weight, strict=True))
            length *= min(1.0, most / (np.abs(length).max() or 1.0))
            moved = V + length[:, None] * normal
        return best

    @cached_property
    def _fades(self) -> list[np.ndarray]:
        """(n,) weights of each part: 0 outside and at its ends, 1 half-way to its inside."""
        graph, found = vertex_graph(self._mesh), []
        for goal, volume in zip(self.parts, self._volumes[self._first_part :], strict=True):
            assert goal.faces is not None
            inside, others = flagged(volume.vertex, self._mesh.n), ~flagged(goal.faces, self._mesh.m)
            outside = flagged(self._mesh.F[others], self._mesh.n)
            weight, ends = inside.astype(np.float64), np.flatnonzero(inside & outside)
            if len(ends):
                distance = np.where(inside, Fronts(graph, ends).distance, 0.0)
                x = np.minimum(distance / (0.5 * distance.max() or 1.0), 1.0)
                weight = x * x * (3 - 2 * x)
            found.append(weight)
        return found


class Secants:
    """Corrections of a proxy's volumes, from how the volumes of M' answered earlier corrections (Broyden).

    Parameters
    ----------
    count : int
        Number of volumes.
    """

    def __init__(self, count: int) -> None:
        self._slope = np.eye(count)
        self.forget_step()

    def forget_step(self) -> None:
        """Learn nothing from the next deficits: the handles have moved."""
        self._last: tuple[np.ndarray, np.ndarray] | None = None

    def step(self, deficits: np.ndarray) -> np.ndarray:
        """Return (k,) the changes of the volumes of N that correct the deficits (k,) of M', in length^3."""
        if self._last is not None:
            step, before = self._last
            answer, square = before - deficits, float(step @ step)
            self._slope += np.outer(answer - self._slope @ step, step) / (square or 1.0)
        step = np.linalg.lstsq(self._slope, deficits, rcond=1e-3)[0]
        longest = LONGEST * float(np.linalg.norm(deficits))
        step *= min(1.0, longest / (float(np.linalg.norm(step)) or 1.0))
        self._last = step, deficits
        return step


def warn_of_missed(errors: list[tuple[str, float]]) -> None:
    """Warn of volumes that are farther than :data:`MISSED` from their goals."""
    for name, error in errors:
        if abs(error) > MISSED:
            log.warning("the volume of %s is %.2g %% from its goal", name, 100 * abs(error))
