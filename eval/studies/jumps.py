"""Jumps of the deformation across edges of the proxy: ``sshade-eval jumps MESH HANDLES``.

The affine map of each triangle of M has a rotation. Neighbouring triangles of a smooth deformation have
nearly equal rotations. If frames change abruptly between triangles of the proxy, lines are visible along the
edges of the proxy, and the angles between neighbouring rotations are large there.

A pair of neighbouring triangles *crosses* an edge of the proxy if its four vertices do not all follow the
same triangle of the proxy from the same cell. Other pairs are *inside*. The proxy comes from the
first sampling, which all settings share.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from eval.publish.markdown import markdown_lines
from eval.publish.panels import Panels, draw
from eval.publish.plotting import save
from sshade.carry.affine import affine_maps
from sshade.carry.binding import Binding
from sshade.carry.blended import nearest_rotations
from sshade.carry.neighbours import adjacent_triangles
from sshade.errors import InputError
from sshade.figures import UP, View
from sshade.io.handles import read_task
from sshade.mesh.mesh import Mesh
from sshade.pipeline.deform import deform
from sshade.pipeline.deformer import Deformer
from sshade.task import DeformationTask

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Kinds of frames and numbers of samplings to compare.
SETTINGS = (("triangle", 1), ("triangle", 5), ("affine", 1), ("blended", 1), ("blended_affine", 1))
#: Width of a panel of the close-up, in pixels.
PANEL = 700
#: Radius of the close-up, as a fraction of the bounding-box diagonal.
RADIUS = 0.08


class Jumps(NamedTuple):
    """Angles between the rotations of neighbouring triangles, in degrees.

    Parameters
    ----------
    pairs : (p, 2) int64
        Neighbouring triangles of M; triangles without area in M or M' are left out.
    angle : (p,) float64
        Degrees.
    crossing : (p,) bool
        Whether the pair crosses an edge of the proxy.
    """

    pairs: np.ndarray
    angle: np.ndarray
    crossing: np.ndarray

    def summary(self) -> dict[str, float]:
        """Return the median and 99th percentile across and inside; NaN if there is no such pair."""
        result = {}
        for name, pairs in (("across", self.crossing), ("inside", ~self.crossing)):
            values = self.angle[pairs]
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
        Binding of M to the proxy.
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
    """Deform with each of the :data:`SETTINGS`; return vertices (n, 3) and jumps by setting."""
    handles = task.handles
    common: dict[str, Any] = {"method": "paper", "vertices": vertices, "seed": seed}
    binding = Deformer(task.mesh, handles.index, group=handles.group, **common).bindings[0]
    result = {}
    for frames, samplings in SETTINGS:
        V = deform(task, samplings=samplings, frames=frames, start="rigid", **common).vertices
        result[f"{frames} x{samplings}"] = V, measure_jumps(task.mesh, V, binding=binding)
    return result


def table(results: dict[str, tuple[np.ndarray, Jumps]]) -> str:
    """Return the summaries as a Markdown table, in degrees."""
    rows = {name: jumps.summary() for name, (_, jumps) in results.items()}
    names = list(next(iter(rows.values())))
    body = [[name, *(f"{row[column]:.2f}" for column in names)] for name, row in rows.items()]
    return "\n".join(markdown_lines(["frames", *names], body, left=["frames"]))


def close_up(mesh: Mesh, results: dict[str, tuple[np.ndarray, Jumps]]) -> tuple[int, Figure]:
    """Draw the place with the most large jumps in each result, shaded and coloured by the jumps.

    Parameters
    ----------
    mesh : Mesh
        M.
    results : mapping
        Results of :func:`compare`. The first result determines the place and the scale of colours.

    Returns
    -------
    int, Figure
        The vertex in the centre, seen along its normal, and the picture.

    Raises
    ------
    InputError
        If no triangle lies within :data:`RADIUS` diagonals of the place.
    """
    V, jumps = next(iter(results.values()))
    radius = RADIUS * mesh.diagonal
    centre = busiest(mesh, jumps, radius=radius)
    near = np.linalg.norm(mesh.V - mesh.V[centre], axis=1) < radius
    shown = near[mesh.F].all(axis=1)
    if not shown.any():
        raise InputError(f"no triangle within {radius:.3g} of vertex {centre}: a mesh too coarse to show")
    towards = Mesh(V, mesh.F).face_normals[shown].sum(axis=0)
    up = np.array(UP) if abs(towards[1]) < 0.9 * np.linalg.norm(towards) else np.array([0.0, 0.0, 1.0])
    shapes = {name: V for name, (V, _) in results.items()}
    errors = {name: at_vertices(mesh, jumps) for name, (_, jumps) in results.items()}
    views = [View.of([V[near] for V in shapes.values()], towards=towards, up=up)] * len(shapes)
    panels = [Panels("", mesh, shapes, shown, views) for shown in ({}, errors)]
    top = float(np.percentile(at_vertices(mesh, jumps)[near], 99))
    label = "largest angle to a neighbouring triangle's rotation (degrees)"
    return centre, draw(panels, title="", top=top, label=label, pixels=PANEL)


def at_vertices(mesh: Mesh, jumps: Jumps) -> np.ndarray:
    """Return the largest angle at each vertex, (n,), of the pairs that touch it, in degrees."""
    result = np.zeros(mesh.n)
    np.maximum.at(result, mesh.F[jumps.pairs].reshape(-1, 6), jumps.angle[:, None])
    return result


def busiest(mesh: Mesh, jumps: Jumps, *, radius: float) -> int:
    """Return the vertex with most of the largest 1 % of the crossing jumps within a radius."""
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
    parser.add_argument(
        "--vertices", type=int, default=6000, metavar="N", help="vertices of the proxy (default: 6000)"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="seed of the sampling (default: 0)")
    parser.add_argument(
        "-o", "--out", type=Path, help="picture to write, of the place with most large jumps (default: none)"
    )


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    if options.out is not None:
        import matplotlib  # noqa: F401 - refused before the deformations
        import pyvista  # noqa: F401
    task = read_task(options.mesh, handles=options.handles)
    results = compare(task, vertices=options.vertices, seed=options.seed)
    print(f"{task.name}: angles between neighbouring triangles' rotations, in degrees\n")  # noqa: T201
    print(table(results))  # noqa: T201
    if options.out is not None:
        centre, figure = close_up(task.mesh, results)
        print(f"\naround vertex {centre}:")  # noqa: T201
        save(figure, options.out)
    return 0
