"""Draw the pictures of the pages: ``python -m docs.pictures [NAME ...]``; the default is all.

Bodies come from ``data/defaust_20k``, which ``make tables`` builds, and those of full size from
``data/defaust``, built by ``defaust build source=synthetic out=data/defaust``. docs/tracks.md has the command
for noisy bodies. The editor needs Chromium and playwright.
"""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from shutil import which
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image

from baselines.accelerated import accelerated_elastic
from defaust.example import write_example
from defaust.tasks import load_task
from docs.gallery import Vector, save
from eval.metrics import Deformed
from eval.publish.plotting import picture
from sshade import DeformationTask, Handles, Mesh, deform
from sshade.plotting.pictures import View

FIGURES, DATA = Path(__file__).with_name("figures"), Path(__file__).parents[1] / "data"
#: In place of the largest bend of the scale of colours: no colours.
PLAIN = 0.0
#: Flags of Chromium on a machine without a graphics card.
FLAGS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
#: Motion of the hand in the picture of the editor, a quarter turn, and all handles.
HAND = {"translation": [0.12, 0.55, 0.1], "rotation": [0, 0, 0.7071, 0.7071], "center": "centroid"}
EDITED = {
    "handles": [
        {"name": "feet", "kind": "fixed", "boxes": [[[-1, -0.1, -1], [1, 0.09, 1]]]},
        {"name": "head", "kind": "fixed", "boxes": [[[-1, 1.6, -1], [1, 2, 1]]]},
        {"name": "hand", "boxes": [[[0.53, 0.8, -1], [1, 1.2, 1]]], **HAND},
    ]
}


@dataclass(frozen=True)
class Row:
    """Shapes side by side, at one scale.

    Parameters
    ----------
    shapes : list of Deformed
    towards : (3,) tuple of float
        Direction to the camera.
    shown : (n,) bool
        Vertices that fill the picture.
    hidden : (n,) bool, optional
        Vertices whose faces are left out.
    top : float
        Bend in degrees at the end of the scale of colours, or :data:`PLAIN`.
    width : int
        Width of a shape in pixels.
    """

    shapes: list[Deformed]
    towards: Vector
    shown: np.ndarray
    hidden: np.ndarray | None = None
    top: float = PLAIN
    width: int = 200


def solved(task: DeformationTask, methods: str) -> list[Deformed]:
    """Return the results of methods with their options, separated by semicolons."""
    results = []
    for method in methods.split("; "):
        name, *options = method.split()
        values = {key: float(value) for key, value in (option.split("=") for option in options)}
        if name == "rest":
            V = task.mesh.V
        elif name == "truth":
            V = task.truth
        elif name == "Elastic":
            V = accelerated_elastic(task, start="rigid").vertices
        else:
            V = deform(task, method=name, **values).vertices
        results.append(Deformed(task, V))
    return results


def body(pose: int, *places: Vector, handles: str = "stored") -> DeformationTask:
    """Load a body. The 30 vertices nearest to each place become a handle group that goes to the true pose."""
    task = load_task(DATA / "defaust_20k", subject=0, pose=pose, handles=handles)
    for place in places:
        near, old = np.argsort(np.linalg.norm(task.mesh.V - place, axis=1), kind="stable")[:30], task.handles
        index, target = np.append(old.index, near), np.concatenate([old.target, task.truth[near]])
        group = np.append(old.group, np.full(30, old.group.max() + 1))
        task = replace(task, handles=Handles(index, target, group=group))
    return task


def artefacts_waist() -> Row:
    """A sitting body, of which the picture shows one half, with 7 groups and with 11."""
    few = body(9)
    more = body(9, (0, 0.95, -0.15), (0, 1.3, 0.2), (0.13, 0.5, 0.1), (-0.13, 0.5, 0.1))
    shapes = solved(few, "rest; Elastic; fast; fine") + solved(more, "fast; truth")
    x, y, _ = few.mesh.V.T
    return Row(shapes, (1, 0.05, 0.15), (y > 0.4) & (abs(x + 0.12) < 0.12), hidden=x > 0, top=30)


def artefacts_face() -> Row:
    """A head whose nose is fixed at 1 vertex and at 30."""
    one = body(1, handles="points")
    shapes = solved(one, "rest; Elastic; fast; fine; fast bending=0.01; fine proxy_bending=0.01")
    shapes += solved(body(1), "fine")
    x, y, _ = one.mesh.V.T
    return Row(shapes, (0.6, 0.1, 1), (y > 1.45) & (abs(x) < 0.15), hidden=y < 0, top=25)


def joints() -> Row:
    """Hands above the head: without round joints, with round joints, by `fine`, and the true pose."""
    task = body(6)
    shapes = solved(task, "fast joints=0; fast; fine; truth")
    return Row(shapes, (0.3, 0.1, 1), task.mesh.V[:, 1] > 1.0, width=400)


def without(subject: int, pose: int, options: dict[str, float], towards: Vector, *, above: float) -> Row:
    """A body at full size by `fast` with other options, by `fast`, and in its true pose, above a height."""
    task = load_task(DATA / "defaust", subject=subject, pose=pose, resolution="high")
    found = (deform(task, **own).vertices for own in (options, {}))
    return Row([Deformed(task, V) for V in (*found, task.truth)], towards, task.mesh.V[:, 1] > above)


def beyond_attachment() -> Row:
    """A head fixed at its nose: without attachment, with attachment, and the true pose."""
    return without(7, 3, {"attachment": 0.0}, (1, 0.1, 0.8), above=1.15)


def beyond_guide() -> Row:
    """A sitting body: without the guide energy, with the guide energy, and the true pose."""
    return without(5, 9, {"guide_attachment": 0.0}, (1, 0.2, 0.6), above=0)


def colours(result: Deformed, top: float) -> np.ndarray | None:
    """Return the largest bend at each vertex (n,); None for plain."""
    if top == PLAIN:
        return None
    ends, found = result.rest.topology.dihedral[:2], np.zeros(result.mesh.n)
    np.maximum.at(found, ends, np.broadcast_to(result.dihedral_changes, ends.shape))
    return found


def drawn(row: Row) -> Image.Image:
    """Return the picture of a row."""
    mesh = row.shapes[0].mesh
    hidden = np.zeros(mesh.n, bool) if row.hidden is None else row.hidden
    vertex, F = np.unique(mesh.F[~hidden[mesh.F].any(axis=1)], return_inverse=True)
    part = Mesh(mesh.V[vertex], F.reshape(-1, 3))
    centred = []
    for shape in (one.shape.V for one in row.shapes):
        low, high = shape[row.shown].min(axis=0), shape[row.shown].max(axis=0)
        centred.append(shape - 0.5 * (low + high))
    view = View.of([V[row.shown] for V in centred], towards=row.towards)
    panels = []
    for result, V in zip(row.shapes, centred, strict=True):
        handles, error = result.task.handles, colours(result, row.top)
        seen = np.isin(handles.index, vertex)
        index = handles.index[seen]
        marks = Handles(np.searchsorted(vertex, index), V[index], dynamic=handles.dynamic[seen])
        paint = {} if error is None else {"error": error[vertex], "top": row.top}
        panels.append(picture(part, V[vertex], view=view, width=row.width, handles=marks, **paint))
    return Image.fromarray(np.hstack(panels))


def edit() -> Image.Image:
    """The editor with a raised hand."""
    from playwright.sync_api import sync_playwright

    with TemporaryDirectory() as folder, sync_playwright() as running:
        write_example(Path(folder))
        (Path(folder) / "handles.json").write_text(json.dumps(EDITED))
        browser = running.chromium.launch(executable_path=which("chromium"), args=FLAGS)
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        command = [sys.executable, "-m", "sshade", "edit", "rest.ply", "handles.json", "--no-browser"]
        with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True) as editor:
            page.goto(editor.stdout.readline().strip())
            page.wait_for_selector("#stage[data-state=converged]", timeout=120_000)
            page.wait_for_timeout(2000)
            image = Image.open(BytesIO(page.screenshot())).convert("RGB")
            editor.terminate()
        browser.close()
    return image


FUNCTIONS = (
    *(artefacts_waist, artefacts_face, joints),
    *(beyond_attachment, beyond_guide, edit),
)
#: Functions that return a picture, by the names of their files.
PICTURES = {made.__name__: made for made in FUNCTIONS}


def main(names: list[str]) -> None:
    """Write pictures."""
    for name in names or PICTURES:
        made = PICTURES[name]()
        image = drawn(made) if isinstance(made, Row) else made
        save(image, FIGURES / f"{name}.png")


if __name__ == "__main__":
    main(sys.argv[1:])
