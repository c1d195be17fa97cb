"""A body and pictures for the examples of the pages; ``make docs`` builds ``data/defaust_20k``."""

from __future__ import annotations

import base64
import tempfile
from pathlib import Path

import numpy as np

from defaust.tasks import load_task
from sshade import Handles, Mesh
from sshade.plotting.pictures import draw

DATA = Path(__file__).parents[1] / "data" / "defaust_20k"


def body(*, pose: int) -> tuple[Mesh, Handles]:
    """Return the first body, of 20,000 vertices, and its handles for a pose."""
    task = load_task(DATA, subject=0, pose=pose)
    return task.mesh, task.handles


def picture(mesh: Mesh, V: np.ndarray, handles: Handles) -> str:
    """Return a picture as HTML: the rest shape with its handles, and the deformed shape with its errors."""
    plotter = draw(mesh, handles, [V], colour="stretch")
    with tempfile.NamedTemporaryFile(suffix=".png") as file:
        plotter.screenshot(file.name)
        data = base64.b64encode(Path(file.name).read_bytes()).decode()
    plotter.close()
    return f'<img alt="Rest shape with handles, and the deformed one" src="data:image/png;base64,{data}">'
