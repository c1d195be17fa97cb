"""The comparison picture of pose transfers, which :mod:`eval.publish.figures` draws where the tasks are such.

Two rows a case: the rest shape, the edited one, the pose and each method's result,
coloured by its distance to the truth; then the same for the surroundings of the
place where the results are farthest from it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from eval.publish.plotting import new_figure, save
from sshade.figures import COLOURS, View, colour_range, edge_error, picture
from sshade.mesh.mesh import Mesh
from sshade.pipeline.transfer_task import TransferTask

#: Reach of a close-up over the bounding-box diagonal.
CLOSE_UP = 0.06

#: Width of a panel in inches.
PANEL = 2.0


class Panels(NamedTuple):
    """A row of panels: shapes of one connectivity, each from its own side but at one scale."""

    label: str
    mesh: Mesh
    shapes: Mapping[str, np.ndarray]
    errors: Mapping[str, np.ndarray]
    views: Sequence[View]


def error_of(task: TransferTask, V: np.ndarray) -> np.ndarray:
    """(n,) distance to the truth in percent of the diagonal; without a truth, the change of edge lengths."""
    if task.truth is None:
        return edge_error(task.mesh, V)
    return 100 * np.linalg.norm(V - task.truth, axis=1) / task.mesh.diagonal


def draw(
    cases: Sequence[tuple[TransferTask, Mapping[str, np.ndarray]]],
    path: Path,
    *,
    title: str,
    towards: np.ndarray,
    up: np.ndarray,
) -> None:
    """Draw the comparison.

    Parameters
    ----------
    cases : sequence of (TransferTask, {method: vertices})
    path : path
        A .png, .pdf or .svg file.
    title : str
    towards, up : (3,) float64
        From the scene to the camera, and the upright direction.
    """
    rows = [row for task, results in cases for row in rows_of(task, results, towards=towards, up=up)]
    top = colour_range(error for row in rows[::2] for error in row.errors.values())
    columns = max(len(row.shapes) for row in rows)
    heights = [row.views[0].height / row.views[0].width for row in rows]
    figure = new_figure(PANEL * columns + 0.9, PANEL * sum(heights) + 0.6 + 0.2 * len(rows))
    axes = figure.subplots(len(rows), columns, squeeze=False, height_ratios=heights)
    for row, panels in zip(rows, axes, strict=True):
        _draw_row(row, panels, top=top)
    known = all(task.truth is not None for task, _ in cases)
    _add_bar(
        figure, axes, top, "distance to the truth (% of the diagonal)" if known else "change of edges (%)"
    )
    figure.suptitle(title, fontsize=10)
    save(figure, path)


def rows_of(
    task: TransferTask, results: Mapping[str, np.ndarray], *, towards: np.ndarray, up: np.ndarray
) -> tuple[Panels, Panels]:
    """The whole shapes, and the surroundings of the largest error."""
    shapes = {"rest": task.rest.V, "pose": task.posed}
    if task.mesh is not task.rest:
        shapes = {"rest": task.rest.V, "edited": task.mesh.V, "pose": task.posed}
        shapes |= {} if task.truth is None else {"truth": task.truth}
    shapes |= results
    errors = {name: error_of(task, V) for name, V in results.items()}
    views = _alike([View.of([V], towards=towards, up=up) for V in shapes.values()])

    worst = int(np.argmax(sum(errors.values())))
    ids, patch = surroundings(task.rest, worst, CLOSE_UP * task.rest.diagonal)
    close = {name: V[ids] for name, V in shapes.items()}
    near = _alike([View.of([V], towards=_outwards(patch, V), up=up) for V in close.values()])
    in_patch = {name: error[ids] for name, error in errors.items()}
    return Panels(task.name, task.mesh, shapes, errors, views), Panels(
        "largest error", patch, close, in_patch, near
    )


def surroundings(mesh: Mesh, vertex: int, radius: float) -> tuple[np.ndarray, Mesh]:
    """The faces at a vertex, and those in a ball about it that hang together with it: vertex ids and mesh."""
    inside = np.linalg.norm(mesh.V - mesh.V[vertex], axis=1) <= radius
    F = mesh.F[inside[mesh.F].all(axis=1) | (vertex == mesh.F).any(axis=1)]
    i, j = F.ravel(), F[:, [1, 2, 0]].ravel()
    graph = coo_array((np.ones(len(i)), (i, j)), shape=(mesh.n, mesh.n))
    _, label = connected_components(graph, directed=False)
    ids, faces = np.unique(F[label[F[:, 0]] == label[vertex]], return_inverse=True)
    return ids, Mesh(mesh.V[ids], faces.reshape(-1, 3))


def _outwards(patch: Mesh, V: np.ndarray) -> np.ndarray:
    """The mean normal of a piece of surface in a pose."""
    a, b, c = (V[patch.F[:, k]] for k in range(3))
    return np.cross(b - a, c - a).sum(axis=0)


def _alike(views: list[View]) -> list[View]:
    """The same views with the extents of the largest, so that a length has one size in all."""
    width, height, depth = (max(getattr(v, name) for v in views) for name in ("width", "height", "depth"))
    return [replace(view, width=width, height=height, depth=depth) for view in views]


def _draw_row(row: Panels, panels: Sequence[Any], *, top: float) -> None:
    for panel in panels:
        panel.set_axis_off()
    for panel, view, (name, V) in zip(panels, row.views, row.shapes.items(), strict=False):
        error = row.errors.get(name)
        panel.imshow(picture(row.mesh, V, view=view, error=error, top=top))
        panel.set_title(name if error is None else f"{name}\nmean {error.mean():.2g} %", fontsize=8)
    panels[0].text(
        -0.03,
        0.5,
        row.label,
        rotation=90,
        transform=panels[0].transAxes,
        ha="right",
        va="center",
        fontsize=7,
    )


def _add_bar(figure: Any, axes: np.ndarray, top: float, label: str) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    scale = ScalarMappable(Normalize(0, top), COLOURS)
    bar = figure.colorbar(scale, ax=axes, shrink=0.6, extend="max", pad=0.01)
    bar.set_label(label, fontsize=8)
    bar.ax.tick_params(labelsize=7)
