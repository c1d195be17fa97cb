"""Draw the picture of the README from the runs of `make cover`: ``python -m docs.cover``.

The picture has the rest shape with its handles, the results and the true pose, with a text below each. Colour
shows the distance of a result to the true pose.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eval.publish.figures import Case, read_cases
from eval.publish.plotting import FIGURES, new_figure, picture, save, style
from sshade.plotting.pictures import View, colour_range
from sshade.problem.task import DeformationTask

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RUNS = Path("out/runs/cover")
TASK = "defaust-new_bodies/subject_11/pose_6"
#: Titles of the panels.
TITLES = {
    "rest": "Rest shape",
    "elastic": "Elastic (libigl)",
    "fast": "sshade fast",
    "fine": "sshade fine",
    "truth": "True pose",
}
#: Columns of rows, with the formats of the lines below a result.
CAPTIONS = {
    "seconds.total": "{:.1f} s",
    "metric.volume": "volume changed by {:.1f} %",
    "metric.truth_distance": "{:.1f} % from the true pose",
}
#: Direction from the scene to the camera, and upright direction.
VIEW = {"towards": np.array([0.15, 0.15, 1.0]), "up": np.array([0.0, 1.0, 0.0])}
#: Colour map whose pale colours keep shapes visible; width of all panels in inches; pixels of an inch.
COLOURS, INCHES, PIXELS = "OrRd", 12.0, 286


def captions(case: Case) -> dict[str, str]:
    """Return the texts below the panels."""
    assert isinstance(case.task, DeformationTask)
    stay = "" if case.task.handles.dynamic.all() else "blue handles stay,\n"
    below = {"rest": f"{case.task.mesh.n:,} vertices\n{stay}yellow handles move"}
    for name, row in case.rows.items():
        below[name] = "\n".join(form.format(row[column]) for column, form in CAPTIONS.items())
    return below


def panel_views(shapes: Mapping[str, np.ndarray]) -> dict[str, View]:
    """Return a view of each shape, at one scale and as wide as the shape."""
    whole = View.of(shapes.values(), **VIEW)
    right = whole.axes[0]
    views = {}
    for name, V in shapes.items():
        own = View.of([V], **VIEW)
        centre = whole.centre + (own.centre - whole.centre) @ right * right
        views[name] = replace(whole, centre=centre, size=np.array([own.size[0], *whole.size[1:]]))
    return views


@style()
def draw(case: Case) -> Figure:
    """Draw the panels of a case whose methods all have a result."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    task: Any = case.task
    assert isinstance(task, DeformationTask) and task.truth is not None
    results = {name: V for name, V in case.results.items() if isinstance(V, np.ndarray)}
    shapes = {"rest": task.mesh.V, **results, "truth": task.truth}
    moves = {name: np.linalg.norm(results.get(name, task.truth) - task.truth, axis=1) for name in shapes}
    errors = {name: 100 * move / task.mesh.diagonal for name, move in moves.items()}
    top = colour_range(errors[name] for name in results)
    views = panel_views(shapes)
    widths = [view.size[0] for view in views.values()]
    scale = INCHES / sum(widths)
    figure = new_figure(INCHES + 0.5, scale * views["rest"].size[1] + 2.0)
    axes = figure.subplots(1, len(shapes), width_ratios=widths)
    below, place = captions(case), {"ha": "center", "va": "top", "fontsize": 12, "linespacing": 1.4}
    for panel, (name, view) in zip(axes, views.items(), strict=True):
        panel.set_axis_off()
        form = {
            "error": errors[name],
            "top": top,
            "colours": COLOURS,
            "width": round(PIXELS * scale * view.size[0]),
        }
        form["handles"] = task.handles if name == "rest" else None
        panel.imshow(picture(task.mesh, shapes[name], view=view, **form))
        panel.set_title(TITLES.get(name, name), fontsize=13, fontweight="bold")
        panel.text(0.5, -0.01, below.get(name, ""), transform=panel.transAxes, **place)
    colours = ScalarMappable(Normalize(0, top), COLOURS)
    bar = figure.colorbar(colours, ax=axes, extend="max", location="bottom", shrink=0.4, aspect=40)
    bar.set_label("distance to the true pose (% of the bounding-box diagonal)", fontsize=11)
    bar.ax.tick_params(labelsize=10)
    return figure


if __name__ == "__main__":
    (case,) = read_cases(RUNS, names=[TASK], methods=["elastic", "fast", "fine"])
    save(draw(case), FIGURES / "cover.png", small=True)
