"""The tools of the page in a browser, and actions for other tests; node plays more of them (tests/record)."""

import re

import igl
import numpy as np
import pytest

from sshade.edit.session import Session
from tests.browser import opened
from tests.shapes import bumpy
from tests.sshade.edit.lent import lent, unpacked
from tests.sshade.edit.sessions import begun, upright

BODY = bumpy(4)


@pytest.fixture
def session(here) -> Session:
    return begun(upright(BODY))


@pytest.fixture
def page(browser, session):
    with lent(session) as server, opened(browser, server.address, width=900, height=640) as page:
        page.wait_for_selector("#stage[data-state=converged]")
        yield page
        assert all(url.startswith((server.address, "data:")) for url in page.asked)


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


def test_every_tool_picks_what_it_goes_over_and_is_in_sight(page, session):
    V = session.mesh.V
    shown = where(page, V, V)
    # A vertex of a star-shaped body is in sight if its normal points to the camera.
    towards = np.array([0.5, 0.25, 1]) / np.linalg.norm([0.5, 0.25, 1])
    normals = igl.per_vertex_normals(V, np.array(session.mesh.F))
    facing = normals @ towards
    middle = shown.mean(axis=0)
    near = np.linalg.norm(shown - middle, axis=1)

    def found() -> np.ndarray:
        return np.isin(np.arange(len(V)), session.state.selection)

    tool(page, "Click")
    front = np.flatnonzero(facing > 0.8)
    wanted = front[np.argmin(near[front])]
    stroke(page, shown[wanted] + 0.3)
    assert session.state.selection.tolist() == [wanted]

    tool(page, "Rectangle")
    radius = 60
    stroke(page, middle - radius, middle + radius)
    inside = (np.abs(shown - middle) < radius).all(axis=1)
    picked = found()
    assert not picked[~inside].any() and picked[inside & (facing > 0.4)].all()
    assert not picked[facing < -0.4].any() and picked.sum() > 20

    page.locator("#through").check()
    stroke(page, middle - radius, middle + radius)
    picked = found()
    assert picked.sum() == inside.sum() and np.array_equal(picked, inside)

    tool(page, "Lasso")
    across, down = np.array([radius, 0]), np.array([0, radius])
    stroke(page, middle - across, middle - down, middle + across, middle + down, middle - across, steps=20)
    picked = found()
    edge = np.abs(shown - middle).sum(axis=1) - radius
    assert picked[edge < -3].all() and not picked[edge > 3].any() and picked.sum() < inside.sum()

    tool(page, "Brush")
    page.locator("#radius").fill("20")
    page.keyboard.down("Shift")
    before = picked
    stroke(page, middle - 2 * down, middle + 2 * down, steps=30)
    page.keyboard.up("Shift")
    picked = found()
    stretch = np.clip(shown[:, 1] - middle[1], -2 * radius, 2 * radius)
    away = np.linalg.norm(shown - middle - np.stack([0 * stretch, stretch], axis=1), axis=1)
    assert picked[before].all() and picked[away < 19].all() and not picked[(away > 21) & ~before].any()

    page.keyboard.down("Control")
    stroke(page, middle - 2 * down, middle + 2 * down, steps=30)
    page.keyboard.up("Control")
    assert not np.isin(np.flatnonzero(away < 19), session.state.selection).any()
    page.wait_for_selector(f"#picked:text-is('{len(session.state.selection):,}')")  # a busy page is late
    assert page.said == []
