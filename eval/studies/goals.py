"""Volumes that were asked for and reached: ``sshade-eval goals``.

The command generates shapes with handles at both ends, deforms them with goals for volumes, and prints the
goals and the volumes of the results. A second table has the local thickness
(:mod:`eval.studies.thickness`) of vessels and other shapes, bent by 90 degrees, without and with the option
`thickness`. Half of the cases are held out: no setting was chosen by them.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from eval.publish.markdown import markdown_table
from eval.studies.thickness import local_thickness, opposite_points
from sshade.mesh.mesh import Mesh
from sshade.pipeline.deform import deform
from sshade.solver.capped import CappedVolume
from sshade.task import DeformationTask, Handles
from sshade.volume_goals import VolumeGoal

#: Weights of the thickness in the second table.
WEIGHTS = (0.0, 1.0)
#: Portion of the length at each end that is a handle region, and points around a shape.
END, AROUND = 0.08, 64


class Case(NamedTuple):
    """A task with goals.

    Attributes
    ----------
    task : DeformationTask
    held_out : bool
    ratio : float or None
        Goal of the whole.
    """

    task: DeformationTask
    held_out: bool
    ratio: float | None = None

    def asked(self) -> dict[str, tuple[float, np.ndarray]]:
        """Return the goals by name, each with its faces (k,)."""
        mesh = self.task.mesh
        found = {} if self.ratio is None else {"whole": (self.ratio, np.arange(mesh.m))}
        for goal in self.task.volumes:
            assert goal.ratio is not None and goal.faces is not None
            found[goal.name] = goal.ratio, goal.faces
        return found


def lathe(profile: np.ndarray, *, around: int = AROUND, wrap: bool = False) -> Mesh:
    """Return the surface of revolution around z of a profile (k, 2) of radii and heights.

    Parameters
    ----------
    profile : (k, 2) float64
        From the lowest to the highest point of the outside. An end at radius 0 is a pole.
    around : int
        Number of vertices of each circle.
    wrap : bool
        The profile is a closed curve.
    """
    ring = profile[profile[:, 0] > 0]
    angle = 2 * np.pi * np.arange(around) / around
    x, y = np.outer(ring[:, 0], np.cos(angle)), np.outer(ring[:, 0], np.sin(angle))
    V = np.stack([x, y, np.repeat(ring[:, 1:], around, axis=1)], axis=-1).reshape(-1, 3)
    low = np.arange(len(ring) if wrap else len(ring) - 1)[:, None] * around
    high = (low + around) % len(V)
    i = np.arange(around)
    j = (i + 1) % around
    a, b, c, d = low + i, low + j, high + j, high + i
    F = np.concatenate([np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((a, b, c), (a, c, d))])
    for end, first in ((0, 0), (-1, len(V) - around)):
        if not wrap and profile[end, 0] == 0:
            side = (first + j, first + i) if end == 0 else (first + i, first + j)
            F = np.append(F, np.stack([np.full(around, len(V)), *side], axis=1), axis=0)
            V = np.append(V, [[0.0, 0.0, profile[end, 1]]], axis=0)
    return Mesh(V, F)


def capsule(length: float, *, bumps: float = 0.0, rings: int = 160) -> Mesh:
    """Return a closed rod of radius 1, with three bulges of the given height, or waists if it is negative."""
    z = np.linspace(0, length, rings)
    edge = np.minimum(np.minimum(z, length - z), 1.0)
    radius = np.sqrt(np.maximum(1 - (1 - edge) ** 2, 0.0)) * (1 + bumps * np.sin(3 * np.pi * z / length) ** 2)
    radius[[0, -1]] = 0.0
    return lathe(np.stack([radius, z], axis=1))


def tube(length: float, *, rings: int = 160) -> Mesh:
    """Return an open tube of radius 1."""
    return lathe(np.stack([np.ones(rings), np.linspace(0, length, rings)], axis=1))


def vessel(length: float, wall: float, *, rings: int = 120) -> Mesh:
    """Return a tube of radius 1 with a wall, a closed surface."""
    z = np.linspace(0, length, rings)
    outside = np.stack([np.ones(rings), z], axis=1)
    return lathe(np.concatenate([outside, np.stack([np.full(rings, 1 - wall), z[::-1]], axis=1)]), wrap=True)


def two_rods() -> Mesh:
    """Return two parallel rods."""
    one, other = capsule(6.0), capsule(6.0, bumps=0.2)
    return Mesh(np.concatenate([one.V, other.V + [4.0, 0, 0]]), np.concatenate([one.F, other.F + one.n]))


def bent(V: np.ndarray, degrees: float) -> np.ndarray:
    """Bend positions (n, 3) around y, so that z runs along a circle; both ends stay rigid."""
    z = V[:, 2]
    length = float(z.max() - z.min())
    first, last = END * length, (1 - END) * length
    angle = np.radians(degrees)
    radius = (last - first) / angle
    along = np.clip(z - first, 0.0, last - first) / radius
    rest = z - first - along * radius  # beyond the bent part, straight on
    x, c, s = radius - V[:, 0], np.cos(along), np.sin(along)
    return np.stack([radius - x * c + rest * s, V[:, 1], first + x * s + rest * c], axis=1)


def middle(mesh: Mesh, *, width: float = 0.3) -> np.ndarray:
    """Return the faces around the middle height, over a portion of the height."""
    z = mesh.V[mesh.F].mean(axis=1)[:, 2]
    low, high = z.min(), z.max()
    return np.flatnonzero(np.abs((z - low) / (high - low) - 0.5) < width / 2)


def side(mesh: Mesh) -> np.ndarray:
    """Return the faces around the middle height on the side of positive x: a belly."""
    faces = middle(mesh, width=0.5)
    return faces[mesh.V[mesh.F[faces]].mean(axis=1)[:, 0] > 0.2]


def inside(mesh: Mesh) -> np.ndarray:
    """Return the faces of a vessel that face its axis."""
    centre = mesh.V[mesh.F].mean(axis=1)
    return np.flatnonzero((centre[:, :2] * mesh.face_normals[:, :2]).sum(axis=1) < -0.1)


def task_of(name: str, mesh: Mesh, degrees: float, parts: tuple[VolumeGoal, ...] = ()) -> DeformationTask:
    """Return the task that bends a mesh by its ends."""
    z = mesh.V[:, 2]
    length = z.max() - z.min()
    group = np.where(z <= z.min() + END * length, 0, np.where(z >= z.max() - END * length, 1, -1))
    index = np.flatnonzero(group >= 0)
    handles = Handles(index, bent(mesh.V, degrees)[index], group=group[index])
    return DeformationTask(name, mesh, handles, volumes=parts)


def cases() -> Iterator[Case]:
    """Yield the cases; every second one is held out."""

    def part(ratio: float, faces: np.ndarray, name: str) -> tuple[VolumeGoal, ...]:
        return (VolumeGoal(ratio=ratio, faces=faces, name=name),)

    rod, body, pipe = capsule(8.0), capsule(9.0, bumps=0.35), tube(8.0)
    yield Case(task_of("rod", rod, 60.0), False, 1.2)
    yield Case(task_of("rod with bulges", body, 60.0), True, 0.8)
    yield Case(task_of("two rods", two_rods(), 20.0), False, 1.1)
    yield Case(task_of("rod, little bent", rod, 10.0), True, 1.5)
    yield Case(task_of("belly", rod, 40.0, part(1.3, side(rod), "belly")), False)
    yield Case(task_of("belly of a body", body, 40.0, part(1.2, side(body), "belly")), True, 1.05)
    yield Case(task_of("waist", body, 30.0, part(0.75, middle(body), "waist")), False)
    yield Case(task_of("chest of a rod", rod, 70.0, part(1.25, middle(rod, width=0.2), "chest")), True)
    yield Case(task_of("open tube", pipe, 90.0), False, 1.0)
    yield Case(task_of("open tube, blown up", pipe, 30.0), True, 1.3)
    for wall, held_out in ((0.2, False), (0.35, True)):
        hose = vessel(8.0, wall)
        name = f"vessel, wall {wall:g}"
        yield Case(task_of(name, hose, 90.0, part(1.0, inside(hose), "inside")), held_out)


def bends() -> Iterator[Case]:
    """Yield shapes without goals that are bent by 90 degrees, for the thickness."""
    for wall, held_out in ((0.2, False), (0.1, True)):
        yield Case(task_of(f"vessel, wall {wall:g}", vessel(8.0, wall), 90.0), held_out)
    for name, bumps, held_out in (("bulges", 0.35, False), ("waists", -0.3, True)):
        yield Case(task_of(f"rod with {name}", capsule(9.0, bumps=bumps), 90.0), held_out)


def reached(case: Case, V: np.ndarray) -> dict[str, float]:
    """Return the volumes of a result V (n, 3) as multiples of the volumes at rest, by the goals' names."""
    mesh = case.task.mesh
    found = {}
    for name, (_, faces) in case.asked().items():
        volume = CappedVolume(mesh.F[faces])
        found[name] = float(volume.measure(V)[0] / volume.measure(mesh.V)[0])
    return found


def volumes(methods: list[str]) -> list[list[str]]:
    """Deform all cases and return the rows of the first table."""
    rows = []
    for case in cases():
        for method in methods:
            begin = perf_counter()
            options: dict[str, Any] = {} if case.ratio is None else {"volume_goal": case.ratio}
            result = deform(case.task, method=method, **options)
            seconds = perf_counter() - begin
            found = reached(case, result.vertices)
            for name, (ratio, _) in case.asked().items():
                error = f"{abs(found[name] / ratio - 1):.0e}"
                handles = f"{result.extra['hard_handle_error']:.0e}"
                cells = f"{ratio:.3f}", f"{found[name]:.5f}", error, handles, f"{seconds:.1f}"
                rows.append([case.task.name, _held(case), method, name, *cells])
    return rows


def thickness(methods: list[str]) -> list[list[str]]:
    """Bend shapes and return the rows of the second table; the exact bend is the first row of each."""
    rows = []
    for case in [*bends(), *(case for case in cases() if case.task.name.startswith("vessel"))]:
        mesh = case.task.mesh
        free = ~np.isin(mesh.F, case.task.handles.index).any(axis=1)
        pairs = opposite_points(mesh, faces=np.flatnonzero(free))
        goal = ", ".join(f"{name} {ratio:g}" for name, (ratio, _) in case.asked().items())
        shapes = {} if goal else {"exact bend": bent(mesh.V, 90.0)}
        for method in methods:
            for weight in WEIGHTS:
                name = f"{method}, thickness {weight:g}" if weight else method
                shapes[name] = deform(case.task, method=method, thickness=weight).vertices
        for method, V in shapes.items():
            ratio = local_thickness(mesh, V, pairs)
            cells = f"{ratio['p5']:.3f}", f"{ratio['median']:.3f}", f"{ratio['p95']:.3f}"
            rows.append([case.task.name, _held(case), method, goal or "none", *cells])
    return rows


def _held(case: Case) -> str:
    return "yes" if case.held_out else "no"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    text = "methods to compare (default: fast fine)"
    parser.add_argument("--methods", nargs="+", default=["fast", "fine"], metavar="METHOD", help=text)


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    methods = options.methods
    left = ["case", "held out", "method", "goal of"]
    header = [*left, "asked", "reached", "error", "handle error", "seconds"]
    print("Volumes as multiples of the volumes at rest\n")  # noqa: T201
    print(markdown_table(header, volumes(methods), left=left), flush=True)  # noqa: T201
    left = ["case", "held out", "method", "volume goal"]
    print("\nThickness as a fraction of the thickness at rest, bent by 90 degrees\n")  # noqa: T201
    print(markdown_table([*left, "5 %", "median", "95 %"], thickness(methods), left=left))  # noqa: T201
    return 0
