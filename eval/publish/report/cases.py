"""The sections of cases in a report: pictures of the rest shape and of each result, and the 3D view."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from eval.metrics import Task
from eval.publish.columns import Column
from eval.publish.html import texts
from eval.publish.panels import error_label, error_of
from eval.publish.plotting import picture
from eval.rows.collect import Experiment
from eval.rows.store import Row
from eval.run.config import load_task
from sshade.core.errors import InputError
from sshade.plotting.pictures import View, colour_range
from sshade.plotting.view import ViewShape, packed_view
from sshade.problem.task import TransferTask

#: Width of a rendering in pixels.
PANEL = 360


@dataclass
class ReportCase:
    """A section of the report.

    Parameters
    ----------
    rows : list of rows
        One row per method.
    missing : list of str
        Sentences on parts that cannot be shown.
    panels : list of dict
        Name, caption and image (a data URI) of each rendering.
    label : str
        Name of the error that the colours show.
    top : float
        Upper end of the colour scale.
    handles : bool
        Whether the rest shape shows handles.
    view : dict, optional
        Data of the 3D view.
    """

    rows: list[Row]
    missing: list[str] = field(default_factory=list)
    panels: list[dict[str, str]] = field(default_factory=list)
    label: str = ""
    top: float = 1.0
    handles: bool = False
    view: dict[str, Any] | None = None

    @property
    def name(self) -> str:
        """The name of the task."""
        return self.rows[0]["task.name"]

    def numbers(self, columns: Sequence[Column]) -> list[list[str]]:
        """Return a line for each method: its name, and the printed numbers of columns."""
        return [[row["method.name"], *texts(row, columns)] for row in self.rows]


def show_case(
    experiment: Experiment, rows: list[Row], *, towards: np.ndarray, up: np.ndarray, turnable: bool
) -> ReportCase:
    """Render a case from its stored runs.

    Parameters
    ----------
    experiment : Experiment
    rows : list of rows
        Rows of the case, one per method.
    towards, up : (3,) float64
        Direction from the scene to the camera, and upright direction.
    turnable : bool
        Pack the shapes for the 3D view as well.
    """
    case = ReportCase(rows)
    found = [(row, V) for row in rows if (V := experiment.vertices(row)) is not None]
    absent = [row["method.name"] for row in rows if experiment.folder(row) is None]
    if absent:
        where = ", ".join(str(root) for root in experiment.runs)
        case.missing.append(f"No stored vertices of {', '.join(absent)} in {where}: only the numbers.")
    if not found:
        return case
    try:
        task = load_task(found[0][0])
    except (InputError, OSError, ImportError) as error:
        case.missing.append(f"No pictures: {error}.")
        return case
    case.label, shapes = error_label(task), _shapes(task, found)
    case.top = colour_range(shape.values for shape in shapes if shape.values is not None)
    view = View.of([shape.V for shape in shapes], towards=towards, up=up)
    handles = getattr(task, "handles", None)
    case.handles = handles is not None
    try:
        for shape in shapes:
            at_rest = handles if shape.name == "rest" else None
            colours = {"error": shape.values, "top": case.top, "handles": at_rest}
            pixels = picture(task.mesh, shape.V, view=view, width=PANEL, **colours)
            case.panels.append({"name": shape.name, "caption": shape.caption, "image": image_uri(pixels)})
    except InputError as error:  # the system cannot draw
        case.missing.append(f"No pictures: {error}.")
    if turnable:
        view = packed_view(task.mesh, shapes, handles=handles, top=case.top, label=case.label)
        case.view = {**view, "name": case.name}
    return case


def _shapes(task: Task, found: list[tuple[Row, np.ndarray]]) -> list[ViewShape]:
    """Return the shapes of a case."""
    counts = f"{task.mesh.n:,} vertices"
    shapes = [ViewShape("rest", counts, task.mesh.V)]
    if isinstance(task, TransferTask) and task.truth is not None:
        shapes.append(ViewShape("truth", "", task.truth))
    for row, V in found:
        error = error_of(task, V)
        shapes.append(ViewShape(row["method.name"], f"mean {error.mean():.2g} %", V, error))
    return shapes


def image_uri(pixels: np.ndarray) -> str:
    """Return an image, (h, w, 3) uint8, as a data URI."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "WEBP", quality=82, method=4)
    return f"data:image/webp;base64,{base64.b64encode(file.getvalue()).decode('ascii')}"
