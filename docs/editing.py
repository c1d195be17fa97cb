"""Measure the editor in a browser and write the table of edit.md: ``python -m docs.editing``.

``python -m docs.editing --picture`` only makes the picture of the page, from a body of ``make tables``. Run
``make bench`` before measuring, which builds the bodies. The script drags a group of a body in Chromium as a
person would. The processor also draws, because Chromium has no graphics card here. The machine must do
nothing else.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from math import cos, pi, sin
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, sleep
from typing import Any

import igl
import numpy as np
from PIL import Image
from playwright.sync_api import Browser, Page, Response, sync_playwright

from defaust.tasks import load_task
from docs.blocks import fill, markdown
from eval.run.environment import environment
from sshade.core.console import say
from sshade.edit.groups import Motion
from sshade.edit.session import Session
from sshade.files.meshes import write_mesh

PAGE = Path(__file__).with_name("edit.md")
PICTURE = Path(__file__).parent / "figures" / "edit.png"
#: Body of the picture, and how its hand moves: by lengths in metres, and a quarter turn about z.
SHOWN, MOVE, TURN, AT_REST = "data/defaust_20k", (0.12, 0.55, 0.1), (0, 0, 1, 1), (0, 0, 0, 1)
#: Folders of bodies, and how often their triangles are split in four.
BODIES = {"data/defaust_20k": 0, "data/defaust_170k": 0, "data/bench/15625": 3}
#: Number of drags, seconds of each, and radius in pixels of the circle that the mouse follows in two seconds.
DRAGS, SECONDS, RADIUS = 5, 4.0, 60
#: The same flags as in tests/browser.py.
FLAGS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
PATIENCE = 600_000


def write_task(root: str, level: int, folder: Path, move: Any = (0, 0.02, 0), turn: Any = AT_REST) -> None:
    """Write a body whose feet and head are fixed and whose left hand moves.

    The hand is away from rest, because a group at rest would be read as fixed.
    """
    mesh = load_task(root, subject=0, pose=1).mesh
    V, F = igl.upsample(np.array(mesh.V), np.array(mesh.F), level)
    write_mesh(folder / "body.ply", V, F)
    x, y, _ = ((V - V.min(axis=0)) / np.ptp(V, axis=0)).T
    groups = [
        {"landmark": name, "kind": "static", "vertices": np.flatnonzero(inside).tolist()}
        for name, inside in (("feet", y < 0.05), ("head", y > 0.93))
    ]
    hand = np.flatnonzero(x > 0.97)
    targets = Motion.about(V[hand].mean(axis=0), np.array(turn), np.array(move))(V[hand])
    groups.append(
        {"landmark": "hand", "kind": "dynamic", "vertices": hand.tolist(), "target": targets.tolist()}
    )
    (folder / "handles.json").write_text(json.dumps({"handles": groups}))


def step_alone(folder: Path) -> tuple[int, float]:
    """Return the number of vertices and the median time of a step without a browser, in seconds."""
    session = Session(folder / "body.ply", handles=folder / "handles.json")
    (group,) = (group for group in session.state.groups if group.kind == "moved")
    seconds = []
    for k in range(120):
        angle, begin = 2 * pi * k / 120, perf_counter()
        session.drag(group.number, Motion(np.eye(3), 0.05 * np.array([cos(angle) - 1, sin(angle), 0])))
        seconds.append(perf_counter() - begin)
    return session.mesh.n, float(np.median(seconds[20:]))


def drag(page: Page, x: float, y: float) -> tuple[float, float, float]:
    """Drag around a circle; return steps per second and the last position of the mouse."""
    steps: list[str] = []

    def count(answer: Response) -> None:
        if answer.url.endswith("/drag"):
            steps.append(answer.url)

    page.on("response", count)
    page.mouse.move(x, y)
    page.mouse.down()
    begin = perf_counter()
    while (now := perf_counter() - begin) < SECONDS:
        at = x + RADIUS * (cos(pi * now) - 1), y - RADIUS * sin(pi * now)
        page.mouse.move(*at)
        sleep(1 / 100)
    page.mouse.up()
    rate = len(steps) / (perf_counter() - begin)
    page.remove_listener("response", count)
    page.wait_for_selector("#stage[data-state=converged]", timeout=PATIENCE)
    return rate, *at


@contextmanager
def opened(browser: Browser, folder: Path, height: int) -> Iterator[tuple[Page, float]]:
    """Yield a page of the editor with the hand selected, and the seconds until the mesh appeared."""
    command = [sys.executable, "-m", "sshade", "edit", "body.ply", "handles.json", "--no-browser"]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True) as running:
        try:
            assert running.stdout is not None
            address, begin = running.stdout.readline().strip(), perf_counter()
            page = browser.new_page(viewport={"width": 1280, "height": height})
            page.goto(address, timeout=PATIENCE)
            page.wait_for_selector("#stage[data-state=converged]", timeout=PATIENCE)
            loaded = perf_counter() - begin
            yield page, loaded
            page.close()
        finally:
            running.terminate()


def in_browser(browser: Browser, folder: Path) -> tuple[float, list[float]]:
    """Return the seconds until the mesh appears, and the steps per second of each drag."""
    with opened(browser, folder, 900) as (page, loaded):
        sleep(5)  # the editor binds the mesh meanwhile
        stage = page.locator("#stage")
        box, place = stage.bounding_box(), stage.get_attribute("data-gizmo")
        assert box is not None and place is not None
        x, y = (float(number) for number in place.split(","))
        x, y, rates = x + box["x"], y + box["y"], []
        for _ in range(DRAGS):
            rate, x, y = drag(page, x, y)
            rates.append(rate)
            sleep(1)
    return loaded, rates


def picture(browser: Browser) -> None:
    """Take the picture of the page with a raised hand."""
    with TemporaryDirectory() as folder:
        write_task(SHOWN, 0, Path(folder), MOVE, TURN)
        with opened(browser, Path(folder), 800) as (page, _):
            sleep(2)
            image = Image.open(BytesIO(page.screenshot())).convert("RGB")
            image.quantize(256, dither=Image.Dither.NONE).save(PICTURE, optimize=True)


def main() -> int:
    """Measure and write the table of the page."""
    head = ["vertices", "seconds until the mesh appears", "step without a browser (ms)", "steps a second"]
    rows = []
    with sync_playwright() as running:
        browser = running.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        picture(browser)
        if "--picture" in sys.argv[1:]:
            return 0
        for root, level in BODIES.items():
            with TemporaryDirectory() as folder:
                write_task(root, level, Path(folder))
                n, step = step_alone(Path(folder))
                loaded, rates = in_browser(browser, Path(folder))
            rate = f"{np.median(rates):.1f} ({min(rates):.1f} to {max(rates):.1f})"
            rows.append([f"{n:,}", f"{loaded:.1f}", f"{1000 * step:.1f}", rate])
            say(" | ".join(rows[-1]))
        version = browser.version
        browser.close()
    note = f"{DRAGS} drags of {SECONDS:.0f} s each: median, minimum and maximum. "
    facts = environment(jobs=1)
    note += f"Machine: {facts['machine']}; Chromium {version}, which draws by the processor. "
    note += f"Commit {facts['commit'][:8]}."
    fill(PAGE, {"rates": f"{markdown(head, rows)}\n\n{note}"})
    return 0


if __name__ == "__main__":
    sys.exit(main())
