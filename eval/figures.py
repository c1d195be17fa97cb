"""The comparison picture: ``python -m eval.figures [EXPERIMENT]``, needs the extra ``figures``.

One row a case: the rest shape with its handles (blue: static, yellow: dynamic),
then each method's result, coloured by how much the edges at a vertex changed
their length, on one scale. Made from run folders; no method is run.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eval.metrics import edge_lengths
from eval.provenance import task_checksum
from eval.store import FOLDER_HELP, VALID, Row, experiment_folder, read_row, read_vertices, run_folders
from eval.targets import instantiate
from sshade.console import run_command
from sshade.errors import InputError
from sshade.files import replacing
from sshade.mesh import Mesh
from sshade.task import DeformationTask

STATIC, DYNAMIC, BODY = "#2166ac", "#f2c200", "#d9d5cf"
COLOURS = "magma_r"

#: Width of a panel in pixels.
PANEL = 600

#: Radius of a handle's sphere over the bounding-box diagonal.
SPHERE = 0.006


@dataclass(frozen=True)
class Case:
    """A task and the vertices that each method left for it."""

    task: DeformationTask
    results: dict[str, np.ndarray]


@dataclass(frozen=True)
class View:
    """A parallel projection that shows a box whole.

    Parameters
    ----------
    right, up, towards : (3,) float64
        Axes of the picture, and the direction from the scene to the camera.
    centre : (3,) float64
    width, height : float
        Extent of the scene in the picture.
    """

    right: np.ndarray
    up: np.ndarray
    towards: np.ndarray
    centre: np.ndarray
    width: float
    height: float


def edge_error(rest: Mesh, vertices: np.ndarray) -> np.ndarray:
    """(n,) relative length change of the edges at each vertex, the mean, in percent."""
    before = edge_lengths(rest.V, rest.edges)
    after = edge_lengths(vertices, rest.edges)
    # An edge without length at rest counts as unchanged as long as it has none.
    change = np.abs(after - before) / np.where(before > 0, before, np.inf)
    ends = rest.edges.T.ravel()
    total = np.bincount(ends, np.tile(change, 2), rest.n)
    return 100 * total / np.bincount(ends, minlength=rest.n)


def read_cases(folder: Path, *, names: list[str], methods: list[str]) -> list[Case]:
    """Read tasks and results from the run folders of an experiment.

    Parameters
    ----------
    folder : path
    names, methods : list of str
        Cases and methods to show; empty: three spread over the cases, and all methods.

    Raises
    ------
    InputError
        When there is no such run, or a dataset is not the one that was run on.
    """
    found: dict[str, dict[str, tuple[Row, Path]]] = {}
    for run in run_folders(folder):
        row = read_row(run)
        if row is None or row["status"] not in VALID:
            continue
        of_task = found.setdefault(row["task.name"], {})
        if row["method.name"] not in of_task or row["date"] > of_task[row["method.name"]][0]["date"]:
            of_task[row["method.name"]] = row, run
    if not found:
        raise InputError(f"{folder}: no runs with a result there")
    missing = [name for name in names if name not in found]
    if missing:
        raise InputError(f"{folder}: no case {missing[0]!r}; there are {', '.join(sorted(found))}")
    if not names:
        known = sorted(found)
        names = [known[i] for i in np.unique(np.linspace(0, len(known) - 1, 3).astype(int))]
    cases = []
    for name in names:
        runs = found[name]
        shown = methods or sorted(runs, key=lambda method: (method.startswith("sshade"), method))
        absent = [method for method in shown if method not in runs]
        if absent:
            raise InputError(f"{folder}: case {name!r} has no result of {absent[0]!r}")
        task = _load_task(next(iter(runs.values()))[0])
        cases.append(Case(task, {method: read_vertices(runs[method][1]) for method in shown}))
    return cases


def _load_task(row: Row) -> DeformationTask:
    if not row.get("task.source"):
        raise InputError(f"the row of {row['task.name']} does not say where its task comes from")
    task = instantiate(json.loads(row["task.source"]))
    if task_checksum(task) != row["task.checksum"]:
        raise InputError(f"the dataset of {row['task.name']} has changed since the run; run it again")
    return task


def draw(cases: list[Case], path: Path, *, title: str, towards: np.ndarray, up: np.ndarray) -> None:
    """Draw the comparison.

    Parameters
    ----------
    cases : list of Case
    path : path
        A .png or .pdf file.
    title : str
    towards, up : (3,) float64
        From the scene to the camera, and the upright direction.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    errors = [[edge_error(case.task.mesh, V) for V in case.results.values()] for case in cases]
    # The few most stretched vertices would take all of the scale.
    top = float(np.percentile(np.concatenate([error for row in errors for error in row]), 98))
    scale = Normalize(0, top if top > 0 else 1.0)
    views = [_view(case, towards=towards, up=up) for case in cases]
    columns = 1 + max(len(case.results) for case in cases)
    heights = [view.height / view.width for view in views]
    width = 2.2 * columns + 0.9
    figure, axes = plt.subplots(
        len(cases),
        columns,
        figsize=(width, 2.2 * sum(heights) + 0.8),
        squeeze=False,
        height_ratios=heights,
        layout="constrained",
    )
    for case, view, values, panels in zip(cases, views, errors, axes, strict=True):
        for panel in panels:
            panel.set_axis_off()
        panels[0].imshow(_picture(case.task.mesh, case.task.mesh.V, view=view, handles=case.task))
        panels[0].set_title("rest", fontsize=9)
        panels[0].text(
            -0.03,
            0.5,
            case.task.name,
            rotation=90,
            transform=panels[0].transAxes,
            ha="right",
            va="center",
            fontsize=8,
        )
        for panel, (method, V), error in zip(panels[1:], case.results.items(), values, strict=False):
            panel.imshow(_picture(case.task.mesh, V, view=view, error=error, top=scale.vmax))
            panel.set_title(f"{method} (mean {error.mean():.1f} %)", fontsize=9)
    bar = figure.colorbar(ScalarMappable(scale, COLOURS), ax=axes, shrink=0.6, extend="max", pad=0.01)
    bar.set_label("change of edge length at a vertex (%)", fontsize=9)
    bar.ax.tick_params(labelsize=8)
    figure.suptitle(f"{title}  (handles: blue static, yellow dynamic)", fontsize=11)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=200)
    plt.close(figure)


def _view(case: Case, *, towards: np.ndarray, up: np.ndarray) -> View:
    """The view of a case in which its rest shape and every result fit, with a margin."""
    towards = towards / np.linalg.norm(towards)
    right = np.cross(up, towards)
    if np.linalg.norm(right) < 1e-9:
        raise InputError("the camera looks along the upright direction; choose another --towards or --up")
    right = right / np.linalg.norm(right)
    axes = np.stack([right, np.cross(towards, right), towards])
    points = np.concatenate([case.task.mesh.V, *case.results.values()]) @ axes.T
    low, high = points.min(axis=0), points.max(axis=0)
    size = 1.06 * (high - low)
    return View(*axes, 0.5 * (low + high) @ axes, float(size[0]), float(size[1]))


def _picture(
    mesh: Mesh,
    V: np.ndarray,
    *,
    view: View,
    error: np.ndarray | None = None,
    top: float = 1.0,
    handles: DeformationTask | None = None,
) -> np.ndarray:
    """(h, w, 3) uint8 rendering of one panel."""
    import pyvista

    # Without a display VTK warns about it, then renders off-screen as it should.
    pyvista.vtk_verbosity("error")
    size = (PANEL, max(1, round(PANEL * view.height / view.width)))
    plotter = pyvista.Plotter(off_screen=True, window_size=size)
    plotter.set_background("white")
    surface = pyvista.PolyData.from_regular_faces(V, mesh.F)
    if error is None:
        plotter.add_mesh(surface, color=BODY, smooth_shading=True)
    else:
        plotter.add_mesh(
            surface,
            scalars=error,
            clim=(0, top),
            cmap=COLOURS,
            smooth_shading=True,
            show_scalar_bar=False,
            ambient=0.4,  # or shading darkens the colours away from those of the bar
            diffuse=0.6,
        )
    if handles is not None:
        ball = pyvista.Sphere(radius=SPHERE * mesh.diagonal, theta_resolution=12, phi_resolution=12)
        for dynamic, colour in ((False, STATIC), (True, DYNAMIC)):
            points = mesh.V[handles.handles.index[handles.handles.dynamic == dynamic]]
            if len(points):
                balls = pyvista.PolyData(points).glyph(geom=ball, scale=False, orient=False)
                plotter.add_mesh(balls, color=colour)
    plotter.enable_parallel_projection()
    plotter.camera.focal_point = view.centre
    plotter.camera.position = view.centre + 10 * mesh.diagonal * view.towards
    plotter.camera.up = view.up
    plotter.camera.parallel_scale = 0.5 * view.height
    plotter.reset_camera_clipping_range()
    plotter.enable_anti_aliasing("ssaa")
    picture = plotter.screenshot(return_img=True)
    plotter.close()
    return picture


def main(arguments: list[str] | None = None) -> int:
    """Command line of ``python -m eval.figures``."""
    parser = argparse.ArgumentParser(prog="python -m eval.figures", description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=Path("quick"), help=FOLDER_HELP)
    parser.add_argument("--cases", nargs="+", default=[], help="task names (default: three of them)")
    parser.add_argument("--methods", nargs="+", default=[], help="method names (default: all)")
    parser.add_argument("--towards", nargs=3, type=float, default=(0.5, 0.25, 1.0), metavar=("X", "Y", "Z"))
    parser.add_argument("--up", nargs=3, type=float, default=(0.0, 1.0, 0.0), metavar=("X", "Y", "Z"))
    parser.add_argument("-o", "--out", type=Path, help="default: results/figures/<experiment>.png")
    options = parser.parse_args(arguments)
    _require_extra()
    folder = experiment_folder(options.folder)
    cases = read_cases(folder, names=options.cases, methods=options.methods)
    path = options.out or Path("results/figures") / f"{folder.name}.png"
    draw(
        cases,
        path,
        title=folder.name,
        towards=np.array(options.towards),
        up=np.array(options.up),
    )
    print(path)  # noqa: T201
    return 0


def _require_extra() -> None:
    try:
        import matplotlib  # noqa: F401
        import pyvista  # noqa: F401
    except ImportError as error:
        raise InputError(f"{error.name} is not installed; pip install sshade[figures]") from error


if __name__ == "__main__":
    sys.exit(run_command(main))
