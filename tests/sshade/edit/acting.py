"""What a user does on the page of the editor in a browser; node plays more of it (tests/record)."""

import re

import numpy as np

from tests.sshade.edit.lent import unpacked


def where(page, V: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return pixels (k, 2) of points in the first view of a mesh, which style.css and view.js define."""
    box = page.locator("#canvas").bounding_box()
    centre, scale = 0.5 * (V.min(axis=0) + V.max(axis=0)), np.linalg.norm(np.ptp(V, axis=0))
    P = (np.atleast_2d(points) - centre) / scale
    towards = np.array([0.5, 0.25, 1]) / np.linalg.norm([0.5, 0.25, 1])
    right = np.cross([0, 1, 0], towards)
    right /= np.linalg.norm(right)
    up, tall = np.cross(towards, right), np.tan(np.radians(15))
    distance = 0.5 / np.sin(np.arctan(tall * min(1, box["width"] / box["height"])))
    per = box["height"] / (2 * tall * (distance - P @ towards))
    x, y = box["x"] + box["width"] / 2 + per * (P @ right), box["y"] + box["height"] / 2 - per * (P @ up)
    return np.stack([x, y], axis=1)


def tool(page, name: str) -> None:
    page.locator("#tools label", has_text=name).click()


def stroke(page, *points, steps: int = 4) -> None:
    """Drag the mouse through the points, release it, and wait until the page shows the selection."""
    page.mouse.move(*points[0])
    page.mouse.down()
    for point in points[1:]:
        page.mouse.move(*point, steps=steps)
    asked(page, "select", page.mouse.up)


def corners(xy: np.ndarray) -> tuple:
    """Return two opposite corners of a rectangle with a margin around some pixels."""
    return tuple(xy.min(axis=0) - 3), tuple(xy.max(axis=0) + 3)


def asked(page, name: str, action) -> None:
    """Act, and wait until the page shows what a command answers."""
    with page.expect_response(re.compile(rf"/{name}(\?|$)")) as answer:
        action()
    if answer.value.ok:
        version = unpacked(answer.value.body())["version"]
        shows = "least => document.getElementById('stage').dataset.version >= least"
        page.wait_for_function(shows, arg=version)


def drag(page, start, by, *, steps: int = 8):
    """Drag from a pixel by some pixels, so that the page sends a step near the end; the button stays down."""
    x, y = start
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 10, y, steps=2)
    page.wait_for_selector("#stage[data-state=dragging]")
    page.mouse.move(x + 0.9 * by[0], y + 0.9 * by[1], steps=steps)
    with page.expect_response(re.compile("/drag$")) as answer:
        page.mouse.move(x + by[0], y + by[1])
    return answer.value


def gizmo(page) -> np.ndarray:
    """Return the pixel at the middle of the arrows."""
    place = page.locator("#stage").get_attribute("data-gizmo")
    return np.array([float(x) for x in place.split(",")])


def release(page) -> None:
    """Release the button and wait for the converged shape."""
    asked(page, "settle", page.mouse.up)
    page.wait_for_selector("#stage[data-state=converged]")


def mark(page, session, shown: np.ndarray) -> None:
    """Fix the lower end and make the upper end movable, by rectangles."""
    V = session.mesh.V
    height = (V[:, 1] - V[:, 1].min()) / np.ptp(V[:, 1])
    page.locator("#through").check()
    tool(page, "Rectangle")
    for keep, button in (height < 0.12, "Fix"), (height > 0.88, "Move"):
        stroke(page, *corners(shown[keep]))
        asked(page, "mark", page.get_by_role("button", name=button, exact=True).click)
    page.wait_for_selector("#groups .moved[aria-pressed=true]")
