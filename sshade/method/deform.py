"""The method: cut a mesh into pieces, deform each through proxies, and put them together.

A component whose handles share a rigid motion moves with them as a whole. A component without handles moves
rigidly with the nearest vertices of another component. `Pieces.together` moves both kinds. All other
components are deformed, in pieces: a piece is a connected, oriented manifold, which is a component, or a part
of one that is cut where it is not manifold. Pieces with handles come first. A piece that is joined to earlier
pieces has their common vertices fixed. See :mod:`sshade.method.pieces`.

The steps of the paper are, for each piece: sample a proxy and bind the mesh to it, solve the proxy, carry its
deformation back to the mesh (:mod:`sshade.method.proxy`), and average over samplings
(:mod:`sshade.method.proxies`). The method `fine` then polishes the piece: from the carried shape, some
iterations minimise the energy at full resolution (:mod:`sshade.method.polish`). Handles are single vertices,
landmarks (a few vertices that move together) or regions (areas). A piece takes the defaults for regions
(:data:`sshade.problem.options.REGIONS`) if most of its handle vertices are inside of regions.

F. Maggioli, D. Baieri, Z. Laehner, S. Melzi, "SShaDe: scalable shape
deformation via local representations", algorithm 1.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from math import inf
from time import perf_counter
from typing import Any

import numpy as np

from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.core.threads import beside
from sshade.mesh.mesh import Mesh
from sshade.mesh.places import opening_within
from sshade.mesh.rigid import common_motion
from sshade.method.dense_handles import interpolate_handles
from sshade.method.pieces import Piece, Pieces, both
from sshade.method.polish import polished, set_up
from sshade.method.proxies import Proxies
from sshade.method.regions import all_on_targets, enclosed_volume, has_regions
from sshade.problem.majority import HandleGroups
from sshade.problem.options import Options, as_row, resolve
from sshade.problem.task import DeformationResult, DeformationTask

log = logging.getLogger(__name__)

#: Largest default weight of the area with a volume goal. A body that grows needs more area.
GOAL_AREA = 0.1
#: Least volume of a piece with a goal, as a multiple of area^1.5. The ratio of two volumes near zero
#: means nothing.
FLAT = 1e-5
#: Relative error of a goal from which on a warning is logged.
MISSED = 0.01
#: Largest move of a handle that is rounding, as a fraction of the bounding-box diagonal.
AT_REST = 1e-9


def deform_task(
    task: DeformationTask,
    *,
    method: str,
    progress: Progress = silent,
    make_proxies: Callable[..., Proxies] = Proxies,
    **values: Any,
) -> DeformationResult:
    """Deform the mesh of a task, piece by piece.

    Parameters
    ----------
    task : DeformationTask
    method : str
        A key of :data:`sshade.problem.options.PRESETS`.
    progress : Progress
    make_proxies : callable
        Gives the proxies of a piece: :class:`sshade.method.proxies.Proxies`, or a function in its place that
        keeps them for the next handle files of a sequence, or samples them in another way.
    **values
        Options, see :class:`sshade.problem.options.Options`; None stands for the method's own value.

    Returns
    -------
    DeformationResult
        See :func:`sshade.deform`.
    """
    whole = resolve(method, values)
    warn_if_nothing_is_fixed(task, whole)
    if method == "interpolate":
        return interpolate_handles(task, progress=progress)
    task = with_majority(task, whole)
    pieces = Pieces(task, whole, progress)
    for piece in pieces.in_order():
        with piece.named():
            result = deform_piece(piece, method, values, whole, make_proxies)
            again = pieces.again(piece, result)  # of a one-sided surface whose sides came apart
            if again is not None:
                result = both(result, deform_piece(again, method, values, whole, make_proxies))
        pieces.put(piece, result)
    result = pieces.together()
    facts = replace(
        result.facts,
        hard_handle_error=_hard_error(task, result.vertices),
        opening=max(result.facts.opening, opening_within(task.mesh, result.vertices) / task.mesh.diagonal),
    )
    if (majority := task.handles.majority) is not None:
        facts = replace(facts, inertia=majority.state)
    return replace(result, facts=replace(facts, options=facts.options or as_row(whole, method)))


def deform_piece(
    piece: Piece,
    method: str,
    values: Mapping[str, Any],
    whole: Options,
    make_proxies: Callable[..., Proxies] = Proxies,
) -> DeformationResult:
    """Deform a connected, oriented manifold.

    Parameters
    ----------
    piece : Piece
    method, values
        See :func:`deform_task`.
    whole : Options
        Options of the whole mesh. Facts record its totals; they do not change the deformation.
    make_proxies : callable
    """
    task, progress = piece.task, piece.progress
    options = options_of_piece(piece, method, values)
    if task.handles.hard.sum() == task.mesh.n:
        result = all_on_targets(task)
    elif options.polish:
        begin = perf_counter()
        with beside(partial(set_up, task, options), size=task.mesh.n) as ready:
            result = polished(
                task,
                options,
                through_proxies(task, options.of_proxy(), make_proxies, progress),
                ready=ready,
                begin=begin,
                progress=progress,
            )
    else:
        result = through_proxies(task, options, make_proxies, progress)
    totals = replace(options, **whole.subset(("vertices", "volume", "volume_goal")))
    facts = replace(result.facts, options=as_row(totals, method))
    if options.volume_goal is not None:
        error = goal_error(task.mesh, result.vertices, options.volume_goal)
        facts = replace(facts, volume_goal_error=error)
        if options.volume == inf:
            warn_of_missed(error)
    return replace(result, facts=facts)


def through_proxies(
    task: DeformationTask, options: Options, make_proxies: Callable[..., Proxies], progress: Progress
) -> DeformationResult:
    """Sample, bind, solve, carry and average; the memory of the proxies is freed before the polish."""
    proxies = make_proxies(task.mesh, task.handles, options)
    return proxies.deform(task.handles, guess=task.guess, progress=progress)


def options_of_piece(piece: Piece, method: str, values: Mapping[str, Any]) -> Options:
    """Return the options of a piece: handle regions and a volume goal change them."""
    mesh, given = piece.task.mesh, {**values, **piece.changes}
    options = resolve(method, given)
    if has_regions(mesh, piece.task.handles.index, options):
        options = resolve(method, given, regions=True)
    return with_goal(mesh, options, area=values.get("area") is not None)


def with_majority(task: DeformationTask, options: Options) -> DeformationTask:
    """Return the task with the majority motion of its handles, if inertia needs it; warn if there is none."""
    if not options.inertia:
        return task
    handles = task.handles
    majority = HandleGroups(task.mesh, handles.index, handles.group).motion(handles.target)
    if not majority.certainty:
        log.warning("inertia is %s", majority.state)
    return replace(task, handles=handles.following(majority))


def warn_if_nothing_is_fixed(task: DeformationTask, options: Options) -> None:
    """Warn if all handles make one rigid motion, because the mesh then moves as a whole."""
    if stays_at_rest(task, options):
        return
    handles = task.handles
    free = handles.has_rotation.any() or options.volume_goal is not None
    if not free and common_motion(task.mesh.V[handles.index], handles.target) is not None:
        log.warning(
            "nothing is fixed: all handles make the same move, so that the mesh moves as a whole; fix some "
            "vertices"
        )


def stays_at_rest(task: DeformationTask, options: Options) -> bool:
    """Whether no handle moves and nothing else changes the mesh."""
    handles, mesh = task.handles, task.mesh
    if handles.has_rotation.any() or options.volume_goal:
        return False
    moved = np.linalg.norm(handles.target - mesh.V[handles.index], axis=1).max()
    return bool(moved <= AT_REST * mesh.diagonal)


def _hard_error(task: DeformationTask, V: np.ndarray) -> float:
    """Return the largest distance of a hard handle from its target, as a fraction of the diagonal."""
    handles = task.handles
    distance = np.linalg.norm(V[handles.index] - handles.target, axis=1)[handles.hard]
    return float(distance.max(initial=0.0)) / task.mesh.diagonal


def with_goal(mesh: Mesh, options: Options, *, area: bool) -> Options:
    """Return the options of a piece: a volume goal limits the default weight of the area.

    Parameters
    ----------
    mesh : Mesh
        The piece.
    options : Options
    area : bool
        Whether the user gave a weight of the area.

    Raises
    ------
    InputError
        When the piece has a goal and no volume at rest.
    """
    if options.volume_goal is None:
        return options
    if not mesh.is_closed:
        raise InputError("volume_goal needs a closed surface, and this one has a boundary: close its holes")
    if not abs(mesh.volume) > FLAT * mesh.area**1.5:
        raise InputError("volume_goal needs a volume at rest to compare with, and this surface is flat")
    return options if area else replace(options, area=min(options.area, GOAL_AREA))


def goal_error(mesh: Mesh, V: np.ndarray, volume_goal: float) -> float:
    """Return the relative error of the volume of M' (n, 3)."""
    F = mesh.F.astype(np.uint32)
    return abs(enclosed_volume(V, F) / (volume_goal * enclosed_volume(mesh.V, F)) - 1)


def warn_of_missed(error: float) -> None:
    """Warn of a volume whose relative error is above :data:`MISSED`."""
    if error > MISSED:
        log.warning("the volume of the mesh is %.2g %% from its goal", 100 * error)
