"""The tools of the page in a browser: groups, keys, guidance, results, the view, and other files."""

import numpy as np
import pytest

from sshade.edit.session import Session
from sshade.files.meshes import read_arrays
from tests.browser import changed, opened, pixels
from tests.sshade.edit.lent import lent
from tests.sshade.edit.sessions import BODY, ready, upright
from tests.sshade.edit.test_page import asked, drag, release, tool, where


@pytest.fixture
def session(here) -> Session:
    """Return a session with a fixed lower end and a moved upper end."""
    return ready(upright(BODY))[0]


@pytest.fixture
def page(browser, session):
    with lent(session) as server, opened(browser, server.address, width=900, height=640) as page:
        page.wait_for_selector("#stage[data-state=converged]")
        yield page
        assert all("400" in text for text in page.said)  # the browser logs refused requests


def gizmo(page) -> np.ndarray:
    """Return the pixel at the middle of the arrows."""
    place = page.locator("#stage").get_attribute("data-gizmo")
    return np.array([float(x) for x in place.split(",")])


def selected(page) -> str:
    return page.locator("#groups [aria-pressed=true] span").inner_text()


def test_the_last_group_is_selected_and_a_row_a_name_or_a_region_selects_another(page, session):
    assert selected(page) == "group 2" and page.locator("#gizmo-bar").is_visible()
    page.locator("#groups button", has_text="group 1").click(position={"x": 200, "y": 10})
    assert selected(page) == "group 1" and page.locator("#gizmo-bar").is_hidden()
    page.locator("#groups").get_by_text("group 2").click()
    assert selected(page) == "group 2"
    V = session.mesh.V
    low, high = (where(page, V, V[group.vertices].mean(axis=0))[0] for group in session.state.groups)
    page.mouse.click(*low)
    assert selected(page) == "group 1" and page.locator("#group-name").input_value() == "group 1"
    page.mouse.click(*high)
    assert selected(page) == "group 2" and len(session.state.selection) == 0
    page.mouse.move(*low)
    page.mouse.down()
    page.mouse.move(*(low + [40, 0]), steps=4)  # this turns the view
    page.mouse.up()
    assert selected(page) == "group 2"
    page.reload()
    page.wait_for_selector("#groups [aria-pressed=true]")
    assert selected(page) == "group 2"


def test_the_guide_follows_the_work_and_tells_the_result_of_a_drag(page, session):
    step, hint = page.locator("#guide [aria-current=step]"), page.locator("#hint")
    assert step.inner_text() == "Drag the arrows or rings"
    tool(page, "Brush")
    assert step.inner_text() == "Pick vertices"
    page.get_by_text("More ways to pick").click()
    asked(page, "select", page.get_by_role("button", name="invert").click)
    assert step.inner_text() == "Fix them or make them move"
    asked(page, "select", page.get_by_role("button", name="invert").click)
    tool(page, "View")
    state = session.state
    page.mouse.click(*gizmo(page))
    page.wait_for_timeout(300)
    assert session.state is state  # a click on the arrows moves nothing
    drag(page, gizmo(page), (60, -30))
    release(page)
    V, group = session.mesh.V, session.state.groups[1]
    was, now = (where(page, V, points.mean(axis=0))[0] for points in (V[group.vertices], group.target))
    assert np.abs(now - was - [60, -30]).max() < 8  # the group is where the mouse went
    page.wait_for_selector("#hint:has-text('Done in')")
    after = pixels(page.locator("#canvas"))
    for _ in range(2):
        page.keyboard.press("b")
        page.wait_for_timeout(300)
        before, after = after, pixels(page.locator("#canvas"))
        assert changed(before, after) > 0.005  # the shape before, and the shape after again
    asked(page, "undo", page.get_by_role("button", name="Undo").click)
    assert hint.inner_text() == "Drag the arrows to move group 2."


#: Sends the typed form; whether the page then says that it computes, and does not save.
SENT = """() => {
  document.getElementById("typed").requestSubmit();
  return !document.getElementById("busy").hidden && document.querySelector("#save-mesh button").disabled;
}"""


def test_a_typed_distance_or_angle_moves_the_group_and_save_waits_for_the_shape(page, session):
    rest = session.mesh.V[session.state.groups[1].vertices]
    page.get_by_label("along or about y").fill("0,25")
    asked(page, "release", lambda: page.keyboard.press("Enter"))
    page.wait_for_selector("#stage[data-state=converged]")
    target = session.state.groups[1].target
    assert np.allclose(target, rest + [0, 0.25, 0], atol=1e-6)
    page.locator("#gizmo-bar").get_by_text("Turn").click()
    page.get_by_label("along or about z").fill("90")
    assert page.evaluate(SENT)
    page.wait_for_selector("#save-mesh button:enabled")
    assert "Largest stretch" in page.locator("#quality").inner_text()
    x, y, z = (target - target.mean(axis=0)).T
    turned = np.stack([-y, x, z], axis=1) + target.mean(axis=0)
    assert np.allclose(session.state.groups[1].target, turned, atol=1e-6)


def test_keys_delete_save_and_list_the_keys_and_a_mistake_is_told(page, session):
    page.keyboard.press("?")
    assert "Ctrl+S" in page.locator("#keys").inner_text()
    page.keyboard.press("Escape")
    page.locator("#keys").wait_for(state="hidden")
    asked(page, "save", lambda: page.keyboard.press("Control+s"))
    page.wait_for_selector("#saved:has-text('body_handles.json')")
    assert "body_deformed.ply" in page.locator("#saved").inner_text()
    assert np.array_equal(read_arrays("body_deformed.ply")[1], session.mesh.F)
    page.get_by_label("file for the handles").fill("../stolen.json")
    asked(page, "save", page.get_by_role("button", name="Save handles").click)
    page.wait_for_selector("#message:has-text('without a folder')")
    page.locator("#message button").click()
    page.locator("#group-name").press("Delete")  # edits the name
    assert len(session.state.groups) == 2
    page.locator("#groups button", has_text="group 1").focus()
    asked(page, "remove", lambda: page.keyboard.press("Delete"))
    assert [group.name for group in session.state.groups] == ["group 1"]
    asked(page, "remove", lambda: page.keyboard.press("Delete"))
    assert session.state.groups == ()


def test_a_group_is_named_limited_picked_and_told_if_nothing_is_fixed(page, session):
    name = page.locator("#group-name")
    name.fill("paw")
    asked(page, "alter", lambda: name.press("Enter"))
    assert selected(page) == "paw" and session.state.groups[1].name == "paw"
    page.get_by_label("distance of the limit").fill("1")
    asked(page, "limit", page.get_by_role("button", name="Fix everything farther than").click)
    page.wait_for_selector("#groups li:nth-child(3)")
    assert session.state.groups[2].name == "beyond paw"
    page.locator("#groups button", has_text="moved").click()
    page.locator("#group summary").click()
    asked(page, "pick", page.get_by_role("button", name="pick", exact=True).click)
    assert np.array_equal(session.state.selection, session.state.groups[1].vertices)
    loose = page.locator("#loose")
    for name in "beyond paw", "group 1":
        assert loose.is_hidden()
        page.locator("#groups button", has_text=name).click()
        asked(page, "alter", page.locator("#group").get_by_text("Moved").click)
    assert "Nothing is fixed" in loose.inner_text()
