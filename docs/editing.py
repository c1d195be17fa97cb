"""How fast the editor is in a browser, into edit.md: ``python docs/editing.py``, after ``make bench``.

A group of a body is dragged in Chromium as by a person. It has no graphics card there, so that the processor
draws, beside all else. The machine must do nothing else.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from math import cos, pi, sin
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, sleep

import igl
import numpy as np
from playwright.sync_api import Browser, Page, sync_playwright

from defaust.tasks import load_task
from eval.run.provenance import SOURCES, environment
from sshade.cli.console import say
from sshade.edit.session import Session
from sshade.edit.state import Motion
from sshade.io.meshes import write_mesh

PAGE = Path(__file__).with_name("edit.md")
#: Bodies, and how often their triangles are split in four.
BODIES = {"data/defaust_170k": 0, "data/bench/15625": 3}
#: Drags, seconds of each, and the radius in pixels of the circle that the mouse goes around in two seconds.
DRAGS, SECONDS, RADIUS = 5, 4.0, 60
#: As tests/browser.py.
FLAGS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
PATIENCE = 600_000


def write_task(root: str, level: int, folder: Path) -> None:
    """A body whose feet and head are held, and whose left hand moves."""
    mesh = load_task(root, subject=0, pose=1).mesh
    V, F = np.array(mesh.V), np.array(mesh.F)
    for _ in range(level):
        V, F = igl.upsample(V, F)
    write_mesh(folder / "body.ply", V, F)
    x, y, _ = ((V - V.min(axis=0)) / np.ptp(V, axis=0)).T
    groups = [
        {"landmark": name, "kind": "static", "vertices": np.flatnonzero(own).tolist()}
        for name, own in (("feet", y < 0.05), ("head", y > 0.93))
    ]
    hand = np.flatnonzero(x > 0.97)
    targets = V[hand] + [0, 0.02, 0]  # a group that stays at rest in a file is static
    groups.append(
        {"landmark": "hand", "kind": "dynamic", "vertices": hand.tolist(), "target": targets.tolist()}
    )
    (folder / "handles.json").write_text(json.dumps({"handles": groups}))


def step_alone(folder: Path) -> tuple[int, float]:
    """Vertices, and the median of the seconds of a step of a drag without a browser."""
    session = Session(folder / "body.ply", handles=folder / "handles.json")
    (group,) = (group for group in session.state.groups if group.kind == "moving")
    seconds = []
    for k in range(120):
        angle, begin = 2 * pi * k / 120, perf_counter()
        session.drag(group.number, Motion(np.eye(3), 0.05 * np.array([cos(angle) - 1, sin(angle), 0])))
        seconds.append(perf_counter() - begin)
    return session.mesh.n, float(np.median(seconds[20:]))


def drag(page: Page, x: float, y: float) -> tuple[float, float, float]:
    """Go around a circle and let go: steps a second, and where the mouse is then."""
    page.mouse.move(x, y)
    page.mouse.down()
    begin = perf_counter()
    while (now := perf_counter() - begin) < SECONDS:
        at = x + RADIUS * (cos(pi * now) - 1), y - RADIUS * sin(pi * now)
        page.mouse.move(*at)
        sleep(1 / 100)
    page.mouse.up()
    page.wait_for_selector("#stage[data-state=settled]", timeout=PATIENCE)
    return float(page.locator("#stage").get_attribute("data-rate") or 0), *at


def in_browser(browser: Browser, folder: Path) -> tuple[float, list[float]]:
    """Seconds until the mesh is there, and steps a second of drags."""
    command = [sys.executable, "-m", "sshade", "edit", "body.ply", "handles.json", "--no-browser"]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True) as running:
        try:
            assert running.stdout is not None
            address, begin = running.stdout.readline().strip(), perf_counter()
            page = browser.new_page(viewport={"width": 1280, "height": 900})
            page.goto(address, timeout=PATIENCE)
            page.wait_for_selector("#stage[data-state=settled]", timeout=PATIENCE)
            loaded = perf_counter() - begin
            page.get_by_role("button", name="drag", exact=True).click()
            sleep(5)  # the mesh is bound meanwhile
            stage = page.locator("#stage")
            box, place = stage.bounding_box(), stage.get_attribute("data-gizmo")
            assert box is not None and place is not None
            x, y = (float(number) for number in place.split(","))
            x, y, rates = x + box["x"], y + box["y"], []
            for _ in range(DRAGS):
                rate, x, y = drag(page, x, y)
                rates.append(rate)
                sleep(1)
            page.close()
        finally:
            running.terminate()
    return loaded, rates


def main() -> int:
    """Measure, and fill in the page's table."""
    lines = [
        "| vertices | seconds until it is there | a step of a drag without a browser (ms) | steps a second |",
        "| ---: | ---: | ---: | ---: |",
    ]
    with sync_playwright() as running:
        browser = running.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        for root, level in BODIES.items():
            with TemporaryDirectory() as folder:
                write_task(root, level, Path(folder))
                n, step = step_alone(Path(folder))
                loaded, rates = in_browser(browser, Path(folder))
            rate = f"{np.median(rates):.1f} ({min(rates):.1f} to {max(rates):.1f})"
            lines.append(f"| {n:,} | {loaded:.1f} | {1000 * step:.1f} | {rate} |")
            say(lines[-1])
        version = browser.version
        browser.close()
    note = f"{DRAGS} drags of {SECONDS:.0f} s each; median, least and most. "
    facts = environment(jobs=1)
    note += f"Machine: {facts['machine']}; Chromium {version}, which draws by the processor. "
    note += f"Code: version {SOURCES[:8]}, commit {facts['commit'][:8]}."
    block = "\n".join([*lines, "", note])
    text = PAGE.read_text(encoding="utf-8")
    head, mark, rest = text.partition("<!-- rates -->\n")
    _, end, rest = rest.partition("\n<!-- end -->")
    if not (mark and end):  # all that follows would be lost
        raise ValueError("the page has no block rates")
    PAGE.write_text(head + mark + block + end + rest, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
