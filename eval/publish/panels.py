"""Pictures of results side by side: a row of panels for each case.

A row has the rest shape with its handles (blue: fixed, yellow: moved), the true pose if known, and the
result of each method. Colours show the distance to the true pose, or else the change of edge lengths.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from textwrap import fill, shorten
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eval.metrics import Task
from eval.publish.plotting import new_figure, picture, style
from eval.rows.store import Row
from sshade.mesh.mesh import Mesh
from sshade.plotting.pictures import COLOURS, View, colour_range, edge_error
from sshade.problem.task import DeformationTask, Handles, TransferTask

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Width of a panel, largest width of all panels, and largest mean height of a row, in inches; pixels of a
#: panel.
INCHES, WIDEST, TALLEST, PIXELS = 2.1, 12.0, 2.8, 600
#: Letters of the title in an inch.
LETTERS = 11
#: Largest number of characters of the text in an empty panel.
REASON = 90
#: Beginning of the name of a source -> name of a subject.
SUBJECTS = {
    "animals": "animal",
    "shapes": "shape",
    **dict.fromkeys(("synth", "new_b", "noisy", "faust"), "body"),
}


class Camera(NamedTuple):
    """Direction (3,) from the scene to the camera, and upright direction (3,)."""

    towards: np.ndarray
    up: np.ndarray


class Case(NamedTuple):
    """A task with the vertices (n, 3) of each method, or the reason why there are none, and the rows."""

    task: Task
    results: dict[str, np.ndarray | str]
    rows: dict[str, Row]


class Panel(NamedTuple):
    """A shape (n, 3) with its view, or the reason why there is no shape; an error (n,) colours the shape."""

    name: str
    shape: np.ndarray | str
    view: View
    caption: str = ""
    error: np.ndarray | None = None
    handles: Handles | None = None


class PanelRow(NamedTuple):
    """Panels of one mesh at one scale, with a title in words and the name of the task."""

    title: str
    name: str
    mesh: Mesh
    panels: list[Panel]

    def scaled(self, width: float) -> PanelRow:
        """Return the row with panels of a width, in units of the diagonal of the rest shape."""

        def wider(view: View) -> View:
            return replace(view, size=np.array([width * self.mesh.diagonal, *view.size[1:]]))

        return self._replace(panels=[panel._replace(view=wider(panel.view)) for panel in self.panels])

    @property
    def nearest(self) -> str:
        """The name of the result with the least mean error."""
        means = {panel.name: panel.error.mean() for panel in self.panels if panel.error is not None}
        return min(means, key=means.__getitem__, default="")

    @property
    def width(self) -> float:
        """The width of a panel, in units of the diagonal of the rest shape."""
        return self.panels[0].view.size[0] / self.mesh.diagonal


def error_of(task: Task, V: np.ndarray) -> np.ndarray:
    """Return the error at each vertex, (n,), in percent.

    With a known true pose: the distance to it, % of the diagonal. Otherwise the mean change of edge lengths
    at a vertex, % of the lengths.
    """
    if task.truth is None:
        return edge_error(task.mesh, V)
    return 100 * np.linalg.norm(V - task.truth, axis=1) / task.mesh.diagonal


def error_label(task: Task) -> str:
    """Return the name and unit of the error of :func:`error_of`."""
    if task.truth is None:
        return "change of edge length at a vertex (% of each edge; EL: % of the longest)"
    return "distance to the true pose (% of the bounding-box diagonal)"


def what_to_see(task: Task) -> str:
    """Return a sentence on the colours for somebody who sees them for the first time."""
    if task.truth is None:
        return "The lighter, the less edges change their length."
    return "The lighter, the nearer to the true pose."


def task_title(task: Task) -> str:
    """Return a task in words, such as "body 1, arms up"; its name if it is of no dataset."""
    pose = task.meta.get("source_pose")
    if pose is None or "subject" not in task.meta:
        return task.name
    source = str(task.meta.get("source"))
    subject = next((word for name, word in SUBJECTS.items() if source.startswith(name)), "subject")
    variants = task.name.split("/")[3:]
    words = [re.sub(r"^\d+_", "", pose), *variants]
    return ", ".join([f"{subject} {task.meta['subject']}", *(word.replace("_", " ") for word in words)])


def row_of(case: Case, camera: Camera) -> PanelRow:
    """Return the row of a case."""
    task = case.task
    shapes: dict[str, np.ndarray | str] = {**_inputs(task), **case.results}
    found = {name: V for name, V in shapes.items() if isinstance(V, np.ndarray)}
    views = {name: View.of([V], towards=camera.towards, up=camera.up) for name, V in found.items()}
    size = np.max([view.size for view in views.values()], axis=0)  # a unit of length has one size
    panels = []
    for name, V in shapes.items():
        panel = Panel(name, V, replace(views.get(name, views["rest"]), size=size))
        if name in case.results and isinstance(V, np.ndarray):
            error = error_of(task, V)
            panel = panel._replace(error=error, caption=_caption(error, case.rows.get(name, {})))
        panels.append(panel)
    if isinstance(task, DeformationTask):
        panels[0] = panels[0]._replace(handles=task.handles)
    return PanelRow(task_title(task), task.name, task.mesh, panels)


def _inputs(task: Task) -> dict[str, np.ndarray]:
    """Return the shapes that are given, and the true pose."""
    true = {} if task.truth is None else {"true pose": task.truth}
    if not isinstance(task, TransferTask):
        return {"rest": task.mesh.V, **true}
    if task.mesh is task.rest:
        return {"rest": task.rest.V, "pose": task.posed}
    return {"rest": task.rest.V, "edited": task.mesh.V, "pose": task.posed, **true}


def _caption(error: np.ndarray, row: Row) -> str:
    """Return the mean error of a result and the time of its method."""
    seconds = row.get("seconds.total")
    return f"{error.mean():.2g} %" + ("" if seconds is None else f", {seconds:.2g} s")


def top_of(rows: Sequence[PanelRow]) -> float:
    """Return the upper end of the common colour scale of some rows."""
    return colour_range(panel.error for row in rows for panel in row.panels if panel.error is not None)


@style()
def draw(rows: Sequence[PanelRow], *, title: str, label: str) -> Figure:
    """Draw rows of panels at one scale, with one colour bar, labelled `label`."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    width, top = max(row.width for row in rows), top_of(rows)
    rows = [row.scaled(width) for row in rows]
    columns = max(len(row.panels) for row in rows)
    heights = [row.panels[0].view.size[1] / row.panels[0].view.size[0] for row in rows]
    inches = min(INCHES, WIDEST / columns, TALLEST * len(rows) / sum(heights))
    across = inches * columns + 1.1
    title = "\n".join(fill(line, int(LETTERS * across)) for line in title.splitlines())
    figure = new_figure(across, inches * sum(heights) + 0.55 + 0.15 * title.count("\n") + 0.3 * len(rows))
    axes = figure.subplots(len(rows), columns, squeeze=False, height_ratios=heights)
    for place in axes.flat:
        place.set_axis_off()
    for row, places in zip(rows, axes, strict=True):
        for place, panel in zip(places, row.panels, strict=False):
            text = "\n".join(filter(None, (panel.name, panel.caption)))
            place.set_title(text, fontsize=8, fontweight="bold" if panel.name == row.nearest else "normal")
            if isinstance(panel.shape, str):
                reason = shorten(panel.shape, REASON, placeholder="...")
                place.text(
                    0.5,
                    0.5,
                    fill(reason, 22),
                    transform=place.transAxes,
                    ha="center",
                    va="center",
                    fontsize=6,
                    color="#7f7f7f",
                )
            else:
                place.imshow(picture_of(panel, row.mesh, width=PIXELS, top=top))
        _write_beside(places[0], -0.12, row.title, size=9)
        if row.name != row.title:
            _write_beside(places[0], -0.03, row.name, size=5)
    colours = ScalarMappable(Normalize(0, top), COLOURS)
    bar = figure.colorbar(colours, ax=axes, extend="max", shrink=0.6, pad=0.01)
    bar.set_label(fill(label, 42))
    bar.ax.tick_params(labelsize=7)
    figure.suptitle(title, fontsize=10)
    return figure


def _write_beside(place: Axes, x: float, text: str, *, size: int) -> None:
    """Write a text upwards at the left side of a panel."""
    place.text(x, 0.5, text, transform=place.transAxes, fontsize=size, rotation=90, ha="right", va="center")


def picture_of(panel: Panel, mesh: Mesh, *, width: int, top: float) -> np.ndarray:
    """Return the picture of a panel with a shape, (h, w, 3) uint8; its colours go from 0 to `top`."""
    assert isinstance(panel.shape, np.ndarray), "an empty panel has no picture"
    return picture(
        mesh, panel.shape, view=panel.view, width=width, error=panel.error, top=top, handles=panel.handles
    )
