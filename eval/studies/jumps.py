"""How far the deformation jumps across the proxy's edges: ``sshade-eval jumps MESH HANDLES``.

Each triangle of M turns by some rotation, that of its affine map. Neighbouring
triangles of a smooth deformation turn nearly alike, wherever they lie; frames
that change abruptly from one triangle of the proxy to the next show as lines
along the proxy's edges, and as larger angles between the rotations there.

A pair of neighbouring triangles *crosses* when its four vertices do not all
follow the same triangle of the proxy from the same Voronoi region; the others
are *inside*. The proxy is that of the first sampling, which all settings share.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eval.publish.panels import Panels, draw
from eval.publish.plotting import save
from sshade.carry.affine import affine_maps
from sshade.carry.binding import Binding
from sshade.carry.blended import nearest_rotations
from sshade.carry.neighbours import adjacent_triangles
from sshade.errors import InputError
from sshade.figures import UP, View, require_extra
from sshade.io.handles import read_task
from sshade.mesh.mesh import Mesh
from sshade.pipeline.deform import deform
from sshade.pipeline.deformer import Deformer
from sshade.task import DeformationTask

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: What is compared: the kind of frames and the number of samplings.
SETTINGS = (("triangle", 1), ("triangle", 5), ("affine", 1), ("blended", 1), ("blended_affine", 1))

#: Width of a panel of the close-up in pixels.
PANEL = 700

#: Radius of the close-up over the bounding-box diagonal.
RADIUS = 0.08


@dataclass(frozen=True)
class Jumps:
    """Angles between the rotations of neighbouring triangles, in degrees.

    Parameters
    ----------
    pairs : (p, 2) int64
        Neighbouring triangles of M that have an area in M and M'.
    angle : (p,) float64
        In degrees.
    crossing : (p,) bool
        Whether the pair crosses from one triangle or region of the proxy to another.
    """

    pairs: np.ndarray
    angle: np.ndarray
    crossing: np.ndarray

    def summary(self) -> dict[str, float]:
        """Median and 99th percentile across and inside; NaN where there is no such pair."""
        result = {}
        for name, chosen in (("across", self.crossing), ("inside", ~self.crossing)):
            values = self.angle[chosen]
            for word, percent in (("median", 50), ("p99", 99)):
                result[f"{name} {word}"] = float(np.percentile(values, percent)) if len(values) else np.nan
        return result


def measure_jumps(rest: Mesh, vertices: np.ndarray, *, binding: Binding) -> Jumps:
    """Measure the angles between the rotations of neighbouring triangles.

    Parameters
    ----------
    rest : Mesh
        M.
    vertices : (n, 3) float64
        M'.
    binding : Binding
        Of M to the proxy whose edges count.
    """
    A, known = affine_maps(rest.V, np.ascontiguousarray(vertices, dtype=np.float64), F=rest.F)
    R = nearest_rotations(A)
    pairs = adjacent_triangles(rest.F)
    pairs = pairs[known[pairs].all(axis=1)]
    # |R - R'|_F = sqrt(8) sin(angle / 2) keeps its digits at small angles.
    apart = np.linalg.norm(R[pairs[:, 0]] - R[pairs[:, 1]], axis=(1, 2))
    angle = np.degrees(2 * np.arcsin(np.minimum(apart / np.sqrt(8), 1.0)))
    follows = np.stack([binding.projection.face, binding.sampling.cell], axis=1)[rest.F[pairs].reshape(-1, 6)]
    return Jumps(pairs, angle, (follows != follows[:, :1]).any(axis=(1, 2)))


def compare(task: DeformationTask, *, vertices: int, seed: int = 0) -> dict[str, tuple[np.ndarray, Jumps]]:
    """Deform with each of the :data:`SETTINGS`: positions (n, 3) and jumps by the setting's name."""
    handles = task.handles
    deformer = Deformer(
        task.mesh, handles.index, group=handles.group, method="paper", vertices=vertices, seed=seed
    )
    binding = deformer.bindings[0]
    result = {}
    for frames, samplings in SETTINGS:
        V = deform(
            task,
            method="paper",
            vertices=vertices,
            samplings=samplings,
            frames=frames,
            start="rigid",
            seed=seed,
        ).vertices
        result[f"{frames} x{samplings}"] = V, measure_jumps(task.mesh, V, binding=binding)
    return result


def table(results: dict[str, tuple[np.ndarray, Jumps]]) -> str:
    """The summaries as a Markdown table, in degrees."""
    rows = {name: jumps.summary() for name, (_, jumps) in results.items()}
    names = list(next(iter(rows.values())))
    lines = [["frames", *names], ["---", *["---:"] * len(names)]]
    lines += [[name, *(f"{row[column]:.2f}" for column in names)] for name, row in rows.items()]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def close_up(mesh: Mesh, results: dict[str, tuple[np.ndarray, Jumps]]) -> tuple[int, Figure]:
    """Draw the place with the most large jumps in each result: shaded above, coloured by the jumps below.

    Parameters
    ----------
    mesh : Mesh
        M.
    results : mapping
        From :func:`compare`; the first one chooses the place and the scale of colours.

    Returns
    -------
    int, Figure
        The vertex in the middle, seen along the normal there, and the picture.

    Raises
    ------
    InputError
        When the mesh is so coarse that no triangle lies within :data:`RADIUS` diagonals of the place.
    """
    V, jumps = next(iter(results.values()))
    radius = RADIUS * mesh.diagonal
    centre = busiest(mesh, jumps, radius=radius)
    near = np.linalg.norm(mesh.V - mesh.V[centre], axis=1) < radius
    shown = near[mesh.F].all(axis=1)
    if not shown.any():
        raise InputError(
            f"no triangle within {radius:.3g} of vertex {centre}: the mesh is too coarse to show"
        )
    towards = Mesh(V, mesh.F).face_normals[shown].sum(axis=0)
    up = np.array(UP) if abs(towards[1]) < 0.9 * np.linalg.norm(towards) else np.array([0.0, 0.0, 1.0])
    shapes = {name: V for name, (V, _) in results.items()}
    errors = {name: at_vertices(mesh, jumps) for name, (_, jumps) in results.items()}
    views = [View.of([V[near] for V in shapes.values()], towards=towards, up=up)] * len(shapes)
    return centre, draw(
        [Panels("", mesh, shapes, {}, views), Panels("", mesh, shapes, errors, views)],
        title="",
        top=float(np.percentile(at_vertices(mesh, jumps)[near], 99)),
        label="largest angle to a neighbouring triangle's rotation (degrees)",
        pixels=PANEL,
    )


def at_vertices(mesh: Mesh, jumps: Jumps) -> np.ndarray:
    """(n,) largest angle of the pairs whose triangles touch a vertex, in degrees."""
    result = np.zeros(mesh.n)
    np.maximum.at(result, mesh.F[jumps.pairs].reshape(-1, 6), jumps.angle[:, None])
    return result


def busiest(mesh: Mesh, jumps: Jumps, *, radius: float) -> int:
    """The vertex with the most of the largest hundredth of the crossing jumps within a radius."""
    from scipy.spatial import cKDTree

    angle = np.where(jumps.crossing, jumps.angle, -1.0)
    largest = np.argsort(-angle, kind="stable")[: max(1, int(jumps.crossing.sum()) // 100)]
    at = mesh.F[jumps.pairs[largest, 0], 0]
    tree = cKDTree(mesh.V[at])
    return int(at[np.argmax(tree.query_ball_point(mesh.V[at], radius, return_length=True))])


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("mesh", metavar="MESH", help="rest shape")
    parser.add_argument("handles", metavar="HANDLES", help="handle file")
    parser.add_argument("--vertices", type=int, default=6000, metavar="N", help="of the proxy (6000)")
    parser.add_argument("--seed", type=int, default=0, metavar="S")
    parser.add_argument("-o", "--out", type=Path, help="picture of the place with the most large jumps")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    if options.out is not None:
        require_extra()
    task = read_task(options.mesh, handles=options.handles)
    results = compare(task, vertices=options.vertices, seed=options.seed)
    print(f"{task.name}: angles between neighbouring triangles' rotations, in degrees\n")  # noqa: T201
    print(table(results))  # noqa: T201
    if options.out is not None:
        centre, figure = close_up(task.mesh, results)
        print(f"\naround vertex {centre}:")  # noqa: T201
        save(figure, options.out)
    return 0
