"""Write the tables of blender.md from blender.csv: ``python -m docs.blender``.

``--measure PYTHON`` writes blender.csv first, where PYTHON has bpy and this package. It deforms bodies of
three sizes in Blender, which takes half an hour. A combination that needs more than :data:`LIMIT` seconds is
ended, and the table says so. ``--picture PYTHON`` draws docs/figures/blender.png.

Both need the bodies ``data/blender/25000``, ``62500`` and ``100000``, built by
``defaust build source=synthetic out=data/blender/25000 subjects=[0] target_vertices=25000`` and so on.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from defaust.tasks import load_task
from docs.blocks import circumstances, fill, markdown
from eval.bench.turns import read_machine, used_by_others
from eval.metrics import METRICS, Deformed
from eval.run.environment import environment
from sshade import DeformationTask, Handles, Mesh
from sshade.core.console import say
from sshade.mesh.rigid import rigid_motion
from sshade.plotting.pictures import View, new_plotter, panel

ROOT = Path(__file__).parents[1]
PAGE, ROWS = Path(__file__).with_suffix(".md"), Path(__file__).with_suffix(".csv")
FIGURE = ROOT / "docs" / "figures" / "blender.png"
#: Body, number of subdivisions, and poses of each size.
SIZES = ((25_000, 0, (1, 2, 3)), (100_000, 0, (1, 2, 3)), (62_500, 2, (1, 3)))
#: Methods of :mod:`docs.blender_runs`, with their titles.
METHODS = {
    "fast": "sshade `fast`",
    "fine": "sshade `fine`",
    "live": "sshade, live mode",
    "laplacian": "Laplacian Deform",
    "surface": "Laplacian Deform of a proxy, Surface Deform",
}
#: Columns of measures, and their metrics.
MEASURES = {"volume": "volume", "edge": "edge", "truth": "truth_distance"}
#: Size of the picture in pixels, and number of its colours.
PICTURE, COLOURS = (800, 480), 256
#: Seconds after which a run is ended.
LIMIT = 300


def case_of(size: int, level: int, pose: int) -> tuple[DeformationTask, dict[str, np.ndarray]]:
    """Return a task and the arrays of :mod:`docs.blender_runs`.

    Each group of handles moves by the rigid motion that fits its true positions best. A subdivision puts a
    vertex at the middle of each edge, of the rest shape and of the true pose alike.
    """
    import igl

    base = load_task(ROOT / "data" / "blender" / str(size), subject=0, pose=pose)
    truth, _ = igl.upsample(np.array(base.truth), np.array(base.mesh.F), level)
    V, F = igl.upsample(np.array(base.mesh.V), np.array(base.mesh.F), level)
    V = V.astype(np.float32)
    index, (_, group) = base.handles.index, np.unique(base.handles.group, return_inverse=True)
    motions, target = np.tile(np.eye(4), (group.max() + 1, 1, 1)), V[index].astype(np.float64)
    for number, motion in enumerate(motions):
        own = group == number
        if base.handles.dynamic[own].any():
            motion[:3, :3], motion[:3, 3] = rigid_motion(target[own], truth[index[own]])
            target[own] = target[own] @ motion[:3, :3].T + motion[:3, 3]
    mesh = Mesh(V.astype(np.float64), F)
    task = DeformationTask("blender", mesh, Handles(index, target, group=group), truth=truth)
    return task, {"V": V, "F": F, "index": index, "group": group, "motions": motions}


def run(python: str, method: str, case: Path, output: Path) -> str:
    """Deform a case in a new process; return what failed, an empty text if nothing did."""
    call = [python, "-m", "docs.blender_runs", str(case), method, str(output)]
    try:
        subprocess.run(call, check=True, timeout=LIMIT, cwd=ROOT, capture_output=True, text=True)
    except subprocess.TimeoutExpired:
        return f"more than {LIMIT} s"
    except subprocess.CalledProcessError as error:
        say(error.stderr[-2000:])
        return f"crashes, exit code {error.returncode}"
    return ""


def measured(python: str, folder: Path) -> Iterator[dict[str, Any]]:
    """Yield the rows of all runs. A method that failed at a size is not tried at the next pose."""
    for size, level, poses in SIZES:
        failed: dict[str, str] = {}
        for pose in poses:
            task, arrays = case_of(size, level, pose)
            np.savez(case := folder / "case.npz", **arrays)
            for method in METHODS:
                row: dict[str, Any] = {"vertices": task.mesh.n, "pose": pose, "method": method}
                machine, output = read_machine(), folder / "out.npz"
                failure = failed.get(method) or run(python, method, case, output)
                row["others"] = used_by_others(machine, read_machine())
                if not failure:
                    with np.load(output) as found:
                        failure = str(found["failure"]) if "failure" in found else ""
                        row |= {name: float(found[name]) for name in found if found[name].dtype == float}
                        row |= {} if failure else measures(task, found["U"])
                if failure:
                    failed[method] = row["failure"] = failure
                say(f"{row}")
                yield row


def measures(task: DeformationTask, U: np.ndarray) -> dict[str, float]:
    """Return the measures of a shape in percent."""
    if not np.isfinite(U).all():
        return {"failure": "positions are not finite"}  # type: ignore[dict-item]
    deformed = Deformed(task, U.astype(np.float64))
    return {title: METRICS[name].function(deformed) for title, name in MEASURES.items()}


def measure(python: str) -> None:
    """Write blender.csv."""
    facts = {name: environment(jobs=1)[name] for name in ("machine", "commit")}
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for row in measured(python, Path(folder)):
            rows.append(row | facts)
            pd.DataFrame(rows).to_csv(ROWS, index=False, float_format="%.5g", lineterminator="\n")


def table_of_methods(rows: pd.DataFrame) -> str:
    """Return the comparison on the smallest and the largest mesh.

    It has the fastest times, the largest memory, and means of other columns over the poses.
    """
    head = ["method", "vertices", "bind (s)", "deform (s)", "peak (MiB)", "volume (%)", "EL (%)"]
    head += ["truth (%)"]
    ends = rows["vertices"].isin([rows["vertices"].min(), rows["vertices"].max()])
    over_poses = {"bind": "min", "deform": "min", "peak": "max"} | dict.fromkeys(MEASURES, "mean")
    lines = []
    for (vertices, method), some in rows[ends].groupby(["vertices", "method"], sort=False):
        texts = [
            "-" if pd.isna(value) else f"{value:.{4 if name == 'peak' else 2}g}"
            for name, value in some.agg(over_poses).items()
        ]
        lines.append([METHODS[method], f"{vertices:,}", *texts])
    note = "Times are the fastest of all poses, with up to 5 runs each. Memory is the largest peak. "
    note += "Other columns are means over the poses. "
    return f"{markdown(head, lines)}\n\n{note}{circumstances(rows)}"


def table_of_live_mode(rows: pd.DataFrame) -> str:
    """Return the times of the live mode: fastest of the poses."""
    some = rows[rows["method"] == "live"].groupby("vertices")
    head = ["vertices", "start (s)", "step: computation (ms)", "steps a second", "step with Blender (ms)"]
    lines = [
        [f"{vertices:,}", f"{row['bind']:.2g}", f"{1000 * row['step']:.3g}", f"{1 / row['step']:.3g}"]
        + [f"{1000 * row['frame']:.3g}"]
        for vertices, row in some.min(numeric_only=True).iterrows()
    ]
    return markdown(head, lines)


def tables(rows: pd.DataFrame) -> dict[str, str]:
    """Return the tables of the page by the names of their blocks."""
    return {"methods": table_of_methods(rows), "live": table_of_live_mode(rows)}


def picture(python: str) -> None:
    """Draw the picture of the page: the rest shape with its handles, and two shapes that Blender computes."""
    from PIL import Image

    task, arrays = case_of(25_000, 0, 1)
    moves = (arrays["motions"] != np.eye(4)).any(axis=(1, 2))
    handles = replace(task.handles, dynamic=moves[task.handles.group])
    shapes = {"rest and handles": arrays["V"]}
    with tempfile.TemporaryDirectory() as folder:
        np.savez(case := Path(folder) / "case.npz", **arrays)
        for method, title in (("fast", "sshade, fast"), ("laplacian", "Laplacian Deform")):
            if failure := run(python, method, case, output := Path(folder) / "out.npz"):
                raise RuntimeError(f"{title}: {failure}")
            with np.load(output) as found:
                shapes[title] = found["U"]
    view = View.of(shapes.values(), towards=(0, 0, 1)).with_foot(0.08)
    plotter = new_plotter(shape=(1, len(shapes)), window_size=PICTURE)
    for column, (title, V) in enumerate(shapes.items()):
        plotter.subplot(0, column)
        panel(plotter, task.mesh, V, view, handles=handles)
        plotter.add_text(title, position="lower_edge", font_size=9, color="black")
    # Without k-means, the few pixels of handles lose their colours.
    small = Image.fromarray(plotter.screenshot(return_img=True))
    small.quantize(COLOURS, kmeans=2, dither=Image.Dither.NONE).save(FIGURE, optimize=True)
    plotter.close()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--measure", metavar="PYTHON", help="make blender.csv first")
    parser.add_argument("--picture", metavar="PYTHON", help="draw the picture")
    options = parser.parse_args()
    if options.measure:
        measure(options.measure)
    if options.picture:
        picture(options.picture)
    fill(PAGE, tables(pd.read_csv(ROWS)))
