"""Rows of panels for the comparison picture: shapes, coloured by their errors on one scale.

A deformation has a row: the rest shape with its handles (blue: fixed, yellow: moved) and the result of each
method. A pose transfer has two rows: the rest shape, the edited shape, the pose and each result; then a
close-up of the place where the results are farthest from the ground truth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from textwrap import fill, shorten
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eval.metrics import Task
from eval.publish.plotting import new_figure, picture, style
from sshade.mesh.connectivity import connectivity
from sshade.mesh.mesh import Mesh
from sshade.plotting.pictures import COLOURS, View, edge_error
from sshade.problem.task import Handles, TransferTask

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Radius of a close-up, as a fraction of the bounding-box diagonal.
CLOSE_UP = 0.06
#: Width of a panel, largest width of all panels, and largest mean height of a row, in inches; pixels of a
#: panel.
INCHES, WIDEST, TALLEST, PIXELS = 2.1, 12.0, 2.8, 600
#: Largest number of characters of the text in an empty panel.
REASON = 125
_MIDDLE = {"ha": "center", "va": "center", "fontsize": 6, "color": "#7f7f7f"}


class Panels(NamedTuple):
    """A row of panels: shapes (n, 3) of one connectivity, with a view each and one scale.

    Shapes with an error (n,) are coloured by it. Handles are drawn on the shape named "rest". A text in place
    of a shape is the reason why there is no shape.
    """

    label: str
    mesh: Mesh
    shapes: Mapping[str, np.ndarray | str]
    errors: Mapping[str, np.ndarray]
    views: Sequence[View]
    handles: Handles | None = None


def error_of(task: Task, V: np.ndarray) -> np.ndarray:
    """Return the error at each vertex, (n,), in percent.

    For a pose transfer with ground truth: the distance to it, % of the diagonal. Otherwise the change of edge
    lengths at a vertex, % of the lengths.
    """
    if not _has_truth(task):
        return edge_error(task.mesh, V)
    return 100 * np.linalg.norm(V - task.truth, axis=1) / task.mesh.diagonal


def error_label(task: Task) -> str:
    """Return the name and unit of the error of :func:`error_of`."""
    if _has_truth(task):
        return "distance to the ground truth (% of the diagonal)"
    return "change of edge length at a vertex (% of each edge; EL: % of the longest)"


def _has_truth(task: Task) -> bool:
    return isinstance(task, TransferTask) and task.truth is not None


def rows_of(
    task: Task, results: Mapping[str, np.ndarray | str], *, towards: np.ndarray, up: np.ndarray
) -> list[Panels]:
    """Return the rows of a case.

    Parameters
    ----------
    task : DeformationTask or TransferTask
    results : mapping
        Method -> shape (n, 3), or the reason why there is no shape.
    towards, up : (3,) float64
        Direction from the scene to the camera, and upright direction.
    """
    found = {name: V for name, V in results.items() if isinstance(V, np.ndarray)}
    errors = {name: error_of(task, V) for name, V in found.items()}
    if not isinstance(task, TransferTask):
        view = View.of([task.mesh.V, *found.values()], towards=towards, up=up)
        shapes = {"rest": task.mesh.V, **results}
        return [Panels(_label(task), task.mesh, shapes, errors, [view] * len(shapes), task.handles)]
    edited = task.mesh is not task.rest
    inputs = {"rest": task.rest.V} | ({"edited": task.mesh.V} if edited else {}) | {"pose": task.posed}
    inputs |= {"truth": task.truth} if edited and task.truth is not None else {}
    shapes = inputs | found
    views = _at_one_scale([View.of([V], towards=towards, up=up) for V in shapes.values()])
    worst = int(np.argmax(sum(errors.values())))
    ids, patch = surroundings(task.rest, worst, CLOSE_UP * task.rest.diagonal)
    close = {name: V[ids] for name, V in shapes.items()}
    near = _at_one_scale([View.of([V], towards=_outwards(patch, V), up=up) for V in close.values()])
    in_patch = {name: error[ids] for name, error in errors.items()}

    def row(label: str, mesh: Mesh, of: Mapping[str, np.ndarray], error: Mapping[str, np.ndarray], sides):
        """Return a row that has the texts of methods without a shape."""
        shapes = {name: of.get(name, results.get(name, "")) for name in (*inputs, *results)}
        side = dict(zip(of, sides, strict=True))
        return Panels(label, mesh, shapes, error, [side.get(name, sides[0]) for name in shapes])

    return [
        row(_label(task), task.mesh, shapes, errors, views),
        row("largest error", patch, close, in_patch, near),
    ]


def _label(task: Task) -> str:
    """Return the name of a task without its dataset, and the name of its pose."""
    pose = task.meta.get("source_pose")
    return f"{task.name.partition('/')[2] or task.name}\n{pose}" if pose else task.name


def surroundings(mesh: Mesh, vertex: int, radius: float) -> tuple[np.ndarray, Mesh]:
    """Return the part of a mesh in a ball around a vertex that is connected to it: vertex ids and mesh."""
    inside = np.linalg.norm(mesh.V - mesh.V[vertex], axis=1) <= radius
    F = mesh.F[inside[mesh.F].all(axis=1) | (vertex == mesh.F).any(axis=1)]
    part = connectivity(F, mesh.n).component
    ids, faces = np.unique(F[part[F[:, 0]] == part[vertex]], return_inverse=True)
    return ids, Mesh(mesh.V[ids], faces.reshape(-1, 3))


def _outwards(patch: Mesh, V: np.ndarray) -> np.ndarray:
    """Return the mean normal of a patch in a pose, not normalised."""
    a, b, c = (V[patch.F[:, k]] for k in range(3))
    return np.cross(b - a, c - a).sum(axis=0)


def _at_one_scale(views: list[View]) -> list[View]:
    """Return the views with the largest extents, so that a unit of length has the same size in all."""
    size = np.max([view.size for view in views], axis=0)
    return [replace(view, size=size) for view in views]


@style()
def draw(rows: Sequence[Panels], *, title: str, top: float, label: str) -> Figure:
    """Draw rows of panels with a colour bar, labelled `label`, from 0 to `top`."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    columns = max(len(row.shapes) for row in rows)
    heights = [row.views[0].size[1] / row.views[0].size[0] for row in rows]
    inches = min(INCHES, WIDEST / columns, TALLEST * len(rows) / sum(heights))
    figure = new_figure(inches * columns + 0.9, inches * sum(heights) + 0.6 + 0.3 * len(rows))
    axes = figure.subplots(len(rows), columns, squeeze=False, height_ratios=heights)
    for panel in axes.flat:
        panel.set_axis_off()
    for row, panels in zip(rows, axes, strict=True):
        for panel, view, (name, V) in zip(panels, row.views, row.shapes.items(), strict=False):
            if isinstance(V, str):
                panel.set_title(name, fontsize=8)
                reason = shorten(V, REASON, placeholder="...")
                panel.text(0.5, 0.5, fill(reason, 22), transform=panel.transAxes, **_MIDDLE)
                continue
            error = row.errors.get(name)
            handles = row.handles if name == "rest" else None
            panel.imshow(picture(row.mesh, V, view=view, width=PIXELS, error=error, top=top, handles=handles))
            panel.set_title(name if error is None else f"{name}\nmean {error.mean():.2g}", fontsize=8)
        beside = {"rotation": 90, "ha": "right", "va": "center", "fontsize": 7}
        panels[0].text(-0.03, 0.5, row.label, transform=panels[0].transAxes, **beside)
    colours = ScalarMappable(Normalize(0, top), COLOURS)
    bar = figure.colorbar(colours, ax=axes, extend="max", shrink=0.6, pad=0.01)
    bar.set_label(label)
    bar.ax.tick_params(labelsize=7)
    figure.suptitle(title, fontsize=10)
    return figure
