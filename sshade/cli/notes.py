"""Sentences of ``sshade deform``: handles that miss their targets, rounded positions, and unusual facts."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from sshade.cli.arguments import OpenTask
from sshade.core.console import say
from sshade.core.errors import counted
from sshade.core.threads import in_ranges
from sshade.files.by_library import EXTRA
from sshade.files.handle_files import HandleFile
from sshade.files.mesh_file import MeshFile
from sshade.files.meshes import SINGLE, read_file
from sshade.mesh.mesh import Mesh
from sshade.mesh.quality import Gap
from sshade.mesh.surface import Surface, as_single
from sshade.problem.facts import Facts
from sshade.problem.handle_checks import SAME_TARGET, astray
from sshade.problem.handles import Handles
from sshade.regions.handle_regions import are_dense

#: Distance between vertices that touched, as a fraction of the diagonal, up to which they still touch.
APART = 1e-6
#: Distance of a handle from its target that is rounding, as a fraction of the bounding-box diagonal.
ON_TARGET = 1e-6
#: Distance of a hard handle from its target that is a warning, as a fraction of the bounding-box diagonal.
MISSED = 1e-4
#: What to say where handles are dense and the method fits others, and where they are not.
DENSITY = {
    True: "the handles are dense: --method interpolate follows them without an elastic surface in between",
    False: "the handles are not dense, and --method interpolate knows no surface; --method fast does",
}
#: Rounding of positions that is worth a detail, as a fraction of the bounding-box diagonal.
COARSE = 1e-6
#: Distance on the mesh that matters: a smaller one is a detail. As a fraction of the bounding-box diagonal.
MATTERS = 1e-3
#: Length of triangles that are long, as a fraction of the diagonal, and least number of triangles that a bend
#: between fixed and moved handles needs.
LONG, STEPS = 0.03, 3
#: Largest number of vertices that a note names.
NAMED = 10


@contextmanager
def announced_warnings() -> Iterator[None]:
    """Print the warnings that methods log, such as a constraint that is off; each once, at once."""

    class WarningPrinter(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if record.getMessage() not in printed:
                printed.add(record.getMessage())
                say(f"note: {record.getMessage()}")

    printed: set[str] = set()
    logger, announcement = logging.getLogger("sshade"), WarningPrinter(logging.WARNING)
    logger.addHandler(announcement)
    try:
        yield
    finally:
        logger.removeHandler(announcement)


def tell(
    options: argparse.Namespace,
    opened: OpenTask,
    facts: Facts,
    *,
    error: float,
    rounding: float,
    gaps: Iterable[Gap | None],
) -> None:
    """Print the warnings and notes of a deformation, or of all poses of a sequence together.

    Parameters
    ----------
    options : Namespace
    opened : OpenTask
    facts : Facts
        Facts of the result. A sequence has the facts of its first pose, with the largest gaps of all poses.
    error : float
        Largest distance of a hard handle from its target, as a fraction of the diagonal.
    rounding : float
        Largest distance of a stored position from the computed one.
    gaps : iterable of Gap or None
        Largest gap between near components in each pose.
    """
    file, shape, given, poses, task = opened
    moved = rounding / shape.mesh.diagonal
    if error > max(MISSED, 2 * moved):
        advice = "; --method fast puts handles exactly at their targets" if options.method == "paper" else ""
        say(f"warning: a handle is {_percent(error)} away from its target{advice}")
    snap = max(float(handles.snapping.distance.max()) for handles in poses)
    dense = are_dense(task)
    unfit = DENSITY[dense] if dense != (options.method == "interpolate") else None
    worst = max(filter(None, gaps), key=lambda gap: gap.distance, default=None)
    if worst is not None:  # it is the gap of parts that touched, with names
        facts = replace(facts, opening=0.0)
    found = [
        *(
            (1.0, note)
            for note in handle_notes(given[0], poses[0], shape.mesh, original=shape.surface.original)
        ),
        *notes(facts, shape.surface, snap=snap, unfit=unfit),
    ]
    if moved > COARSE:
        single = (
            f"{options.output} stores single precision, which moves positions by up to {_percent(moved)}; "
        )
        single += "write .obj or .off in double precision, or move the mesh to the origin"
        found.append((moved, single))
    shown = [note for size, note in found if size >= MATTERS or options.verbose]
    for note in shown:
        say(f"note: {note}")
    if hidden := len(found) - len(shown):
        say(f"note: {counted(hidden, 'detail changes', 'details change')} little; --verbose tells more")
    if worst is not None:
        one, other = (part_name(component, opened) for component in worst.components)
        more = f", and {counted(worst.pairs - 1, 'other pair', 'other pairs')}" if worst.pairs > 1 else ""
        say(
            f"note: parts that overlapped or nearly touched came apart by up to {_percent(worst.distance)}: "
            f"{one} and {other}{more}; give them common handles, or make them one surface"
        )


def part_name(component: int, opened: OpenTask) -> str:
    """Return the name of a component: its name in the file, or the name of a handle group on it."""
    file, shape, given, poses, _ = opened
    of_vertex, handles = shape.mesh.component, poses[0]
    vertex = shape.surface.original[np.argmax(of_vertex == component)]
    face = int(np.argmax((vertex == file.F).any(axis=1)))
    names = [name for first, name in file.parts if first <= face][-1:]
    groups = handles.group[of_vertex[handles.index] == component]
    names = [f'"{name}"' for name in names if name]
    names += [
        f'the part of "{group.name}"' for group in given[0].groups if group.name and group.number in groups
    ]
    return f"{names[0]} (vertex {vertex})" if names else f"the part of vertex {vertex}"


def notes(facts: Facts, surface: Surface, *, snap: float, unfit: str | None) -> Iterator[tuple[float, str]]:
    """Yield a sentence for each unusual fact, and how much it matters, as a fraction of the diagonal.

    Parameters
    ----------
    facts : Facts
        Of the result.
    surface : Surface
    snap : float
        Largest distance of a handle given by position from its vertex.
    unfit : str, optional
        Why another method fits the handles better.
    """
    rest = surface.facts
    if rest.near:
        lie = counted(rest.near, "vertex lies", "vertices lie")
        within = f"at most {rest.tolerance:.2g} of the diagonal from their common place"
        moves = "moves" if rest.near == 1 else "move"
        yield rest.tolerance, f"{lie} near another vertex, and {moves} with it ({within})"
    if snap > 0:
        share = snap / surface.mesh.diagonal
        yield share, f"handles given by position were snapped by at most {snap:.3g}, {_percent(share)}"
    if unfit:
        yield 1.0, unfit
    if "yielding" in (facts.volume_constraint or ""):
        share = facts.volume_error or 0.0
        more = "more" if (facts.volume_pressure or 0.0) < 0 else "less"
        yield share, f"the handles ask for {100 * share:.2g} % {more} volume; the volume yields"
    if "yielding" in (facts.area_constraint or ""):
        share = facts.area_error or 0.0
        words = f"the area yields by {100 * share:.2g} % on the proxy"
        yield share, f"the handles ask for another area; {words}"
    if flat := facts.faces_without_area:
        yield 0.0, f"{counted(flat, 'face without area was', 'faces without area were')} slightly enlarged"
    if dropped := facts.duplicates + rest.duplicates + rest.collapsed:
        repeat = counted(dropped, "face that repeats", "faces that repeat")
        yield 0.0, f"{repeat} a vertex or another face {'was' if dropped == 1 else 'were'} ignored"
    if unused := rest.unused:
        stay = counted(unused, "vertex without a face stays", "vertices without a face stay")
        yield 0.0, f"{stay} in place"
    yield from _on_pieces(facts)


def _on_pieces(facts: Facts) -> Iterator[tuple[float, str]]:
    """Yield sentences on the parts of the mesh that were deformed, and how much they matter."""
    if turned := facts.turned:
        words = counted(turned, "face was", "faces were")
        yield 0.0, f"{words} turned around, to agree with their neighbours"
    if copies := facts.copies:
        duplicated = f"{counted(copies, 'vertex was', 'vertices were')} duplicated, and joined again"
        gaps = f" over gaps of at most {_percent(facts.gap)}" if facts.gap > APART else ""
        yield facts.gap, f"the surface was cut where it is not manifold: {duplicated}{gaps}"
    if one_sided := facts.one_sided:
        lie = counted(one_sided, "vertex lies", "vertices lie")
        mean = f"the result is their mean, at most {_percent(facts.side_gap)} from either side"
        yield facts.side_gap, f"{lie} on one-sided surfaces: both sides were deformed, and {mean}"
    if unconstrained := facts.unconstrained:
        follow = counted(
            unconstrained, "component without handles follows", "components without handles follow"
        )
        yield 1.0, f"{follow} the nearest component rigidly"
    if facts.opening > APART:
        yield facts.opening, f"parts of the mesh that touched came apart by {_percent(facts.opening)}"


def _percent(fraction: float) -> str:
    return f"{100 * fraction:.2g} % of the diagonal"


def stored_positions(path: Path, file: MeshFile, V: np.ndarray) -> np.ndarray:
    """Return the positions that `path` holds after V (n, 3) were written to it: V itself, or rounded.

    Libraries may merge, split and renumber vertices, and leave out vertices without a face.
    """
    suffix = path.suffix.lower()
    if suffix in EXTRA:
        found, used, stored = read_file(path).V, np.unique(file.F), V.copy()
        stored[used] = found[cKDTree(found).query(V[used])[1]]
        return stored
    if suffix not in file.suffixes:  # a file of the mesh alone
        return as_single(V) if suffix in SINGLE else V
    return read_file(path).V if file.stored is None else file.stored(V)


def near_target(error: float) -> str:
    """Return how near handles are to their targets; the largest distance is a fraction of the diagonal."""
    return "on target" if error <= ON_TARGET else f"at most {_percent(error)} from target"


def reached(stored: np.ndarray, whole: Surface, handles: Handles) -> tuple[str, float]:
    """Return how near handles are to their targets, for the summary, and the error of the hard handles.

    Errors are fractions of the diagonal: the largest of the hard handles, and the mean of the soft handles.
    """
    at = whole.picked(stored)
    distance = np.linalg.norm(at[handles.index] - handles.target, axis=1)
    distance /= whole.mesh.diagonal
    hard = handles.hard
    error = float(distance[hard].max(initial=0.0))
    exact, soft = int(hard.sum()), int((~hard).sum())
    parts = []
    if exact:
        parts.append(f"{counted(exact, 'handle', 'handles')} {near_target(error)}")
    if soft:
        mean = _percent(float(distance[~hard].mean()))
        parts.append(f"{counted(soft, 'soft handle', 'soft handles')} {mean} from target on average")
    return ", ".join(parts), error


def handle_notes(
    file: HandleFile, handles: Handles, mesh: Mesh, *, original: np.ndarray | None = None
) -> list[str]:
    """Return a sentence for each unusual fact about the handles of a file on a mesh.

    The mesh file has other numbers of the vertices, `original` (n,), if they are given.
    """
    found = []
    own = [group.number for group in file.groups if group.moves and group.motion is None]
    placed = np.flatnonzero(np.isin(handles.group, own) & handles.hard)
    if len(far := placed[astray(mesh.V[handles.index[placed]], handles.target[placed])]):
        ids = np.sort(handles.index[far] if original is None else original[handles.index[far]])
        more = f" and {len(ids) - NAMED} more" if len(ids) > NAMED else ""
        found.append(
            f"{counted(len(ids), 'handle goes', 'handles go')} far from where neighbours go, which may shred "
            f"the surface: vertex {', '.join(map(str, ids[:NAMED]))}{more}; check the order of the targets"
        )
    if handles.snapping.merge_distance > SAME_TARGET * mesh.diagonal:
        merged = counted(handles.snapping.merged, "position was", "positions were")
        apart = _percent(handles.snapping.merge_distance / mesh.diagonal)
        found.append(
            f"{merged} merged with another position of the group at the same vertex; the vertex goes to the "
            f"mean of their targets, at most {apart} from each target"
        )
    if note := _long_triangles(handles, mesh):
        found.append(note)
    turned = []
    for group in file.groups:
        if group.motion is not None and group.motion.center is None and not group.motion.is_translation:
            points = mesh.V[handles.index[handles.group == group.number]]
            if len(points) and not ((points.min(axis=0) <= 0) & (points.max(axis=0) >= 0)).all():
                turned.append(str(group.number))
    if turned:
        entries = "entry" if len(turned) == 1 else "entries"
        found.append(
            f"the rotation or scale of {entries} {', '.join(turned)} is about the origin, which lies outside "
            'of the bounding box of its vertices; "center": "centroid" moves them about their mean'
        )
    return found


def _long_triangles(handles: Handles, mesh: Mesh) -> str:
    """Return a sentence if the triangles that deform are long; empty if they are not."""
    fixed, moved = (mesh.V[handles.index[handles.dynamic == moves]] for moves in (False, True))
    if not (len(fixed) and len(moved)):
        return ""
    group = np.full(mesh.n, -1)
    group[handles.index] = handles.group
    areas = mesh.face_areas

    def lengths(first: int, end: int) -> np.ndarray:
        """Return the area of faces that deform, and the sum of their longest sides times their areas."""
        F, area = mesh.F[first:end], areas[first:end].copy()
        own = group[F]
        area[(own[:, 0] >= 0) & (own == own[:, :1]).all(axis=1)] = 0.0
        P = mesh.V[F]
        sides = P - P[:, [1, 2, 0]]
        return np.array([area.sum(), area @ np.sqrt(np.einsum("fkc,fkc->fk", sides, sides).max(axis=1))])

    area, sum_of_lengths = np.sum(in_ranges(lengths, mesh.m), axis=0)
    if not area:
        return ""
    length = float(sum_of_lengths / area)
    distance = float(cKDTree(fixed).query(moved)[0].min())
    if length <= max(LONG * mesh.diagonal, distance / STEPS):
        return ""
    return (
        f"the triangles between the handles are {length:.3g} long in the mean, and fixed and moved handles "
        f"are {distance:.3g} apart; a surface bends at its vertices alone: subdivide it, or it may crumple"
    )
