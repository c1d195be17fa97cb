"""Draw the picture of docs/python.md, and measure its table: ``python -m docs.notebooks``.

The first cells of docs/examples/deform.ipynb run here, and Chromium draws the figure of a cell.
"""

from __future__ import annotations

import html
import json
import shutil
from contextlib import chdir
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import igl
import numpy as np
from PIL import Image
from playwright.sync_api import sync_playwright

from defaust.example import write_example
from docs.blocks import fill, markdown
from docs.editing import FLAGS
from eval.run.environment import environment
from sshade import DeformationTask, Mesh, plot, read_handles
from sshade.core.console import say

PAGE = Path(__file__).with_name("python.md")
NOTEBOOK = Path(__file__).parent / "examples" / "deform.ipynb"
PICTURE = Path(__file__).parent / "figures" / "notebook.png"
#: Width and height of the picture in pixels, the name that its cell defines, and number of colours.
WIDTH, HEIGHT, CELL, COLOURS = 760, 590, "result", 256
STYLE = (
    "body { margin: 8px } pre { padding: 8px; border: 1px solid #ddd; background: #f7f7f7; margin: 0 0 4px }"
)
#: Number of subdivisions of each body of the table.
LEVELS = (1, 2, 4)


def run_cells() -> tuple[Any, str]:
    """Run the cells of the notebook up to the drawn cell; return its value and its text."""
    names: dict[str, Any] = {}
    for cell in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code" and CELL not in names:
            source = "".join(cell["source"])
            exec(source, names)
    return names[CELL], source


def draw() -> None:
    """Write the picture of a cell and its figure."""
    with TemporaryDirectory() as folder, sync_playwright() as running:
        with chdir(folder):
            shown, source = run_cells()
        path = Path(folder) / "cell.html"
        text = f"<style>{STYLE}</style><pre>{html.escape(source)}</pre>{shown._repr_html_()}"
        path.write_text(text, encoding="utf-8")
        browser = running.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        page.goto(path.as_uri())
        page.frame_locator("iframe").locator("#turn-stage[data-shape]").wait_for()
        page.wait_for_timeout(1000)
        image = Image.open(BytesIO(page.screenshot())).convert("RGB")
        image.quantize(COLOURS, dither=Image.Dither.NONE).save(PICTURE, optimize=True)
        browser.close()


def measure(level: int) -> list[str]:
    """Return a line of the table: vertices, size of a figure in MB, and seconds of the first and second."""
    with TemporaryDirectory() as folder:
        rest = write_example(Path(folder), subdivisions=min(level, 2))
        mesh = Mesh(*igl.upsample(np.array(rest.V), np.array(rest.F), max(level - 2, 0)))
        task = DeformationTask("pose", mesh, read_handles(Path(folder) / "pose_6.json", mesh))
    mesh.connectivity  # noqa: B018 - deforming computes it anyway
    line, seconds = [f"{mesh.n:,}"], []
    for _ in range(2):
        begin = perf_counter()
        figure = plot(task, 1.01 * mesh.V)
        seconds.append(f"{perf_counter() - begin:.1f}")
    return [*line, f"{len(figure._repr_html_()) / 1e6:.1f}", *seconds]


def main() -> None:
    """Write the picture and the table."""
    draw()
    head = ["vertices", "size (MB)", "first figure (s)", "next figures of the mesh (s)"]
    lines = [measure(level) for level in LEVELS]
    facts = environment(jobs=1)
    note = f"A rest shape and a pose with colours. Machine: {facts['machine']}. Commit {facts['commit'][:8]}."
    fill(PAGE, {"figures": f"{markdown(head, lines)}\n\n{note}"})
    say(f"{PICTURE}, {PAGE}")


if __name__ == "__main__":
    main()
