"""The tools of the page in a browser: numbers, steps, local axes, pivots, the view, and other files."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sshade.edit.session import Session
from tests.browser import changed, opened, pixels, portion
from tests.sshade.edit.lent import lent
from tests.sshade.edit.sessions import BODY, ready, upright
from tests.sshade.edit.test_page import asked, drag, release


@pytest.fixture
def session(here) -> Session:
    """Return a session with a fixed lower end and a movable upper end."""
    return ready(upright(BODY))[0]


@pytest.fixture
def page(browser, session):
    with lent(session) as server, opened(browser, server.address) as page:
        page.wait_for_selector("#stage[data-state=converged]")
        page.get_by_role("button", name="choose group 2").click()
        page.wait_for_selector("#gizmo-bar:visible")
        yield page
        assert page.said == []


def group(session: Session):
    return session.state.groups[1]


def gizmo(page) -> np.ndarray:
    """Return the pixel at the middle of the arrows."""
    place = page.locator("#stage").get_attribute("data-gizmo")
    return np.array([float(x) for x in place.split(",")])


def apply(page, **numbers: float) -> None:
    for label, value in numbers.items():
        page.get_by_label(label.replace("_", " "), exact=True).fill(str(value))
    asked(page, "settle", page.get_by_role("button", name="apply").click)
    page.wait_for_selector("#stage[data-state=converged]")


def motion(session: Session, before: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rotation of the group since `before` and the move of its middle."""
    after = group(session).target
    turn, _ = Rotation.align_vectors(after - after.mean(axis=0), before - before.mean(axis=0))
    return turn.as_rotvec(degrees=True), after.mean(axis=0) - before.mean(axis=0)


def test_numbers_move_and_turn_a_group_along_the_axes_of_its_arrows(page, session):
    before = group(session).target
    apply(page, move_x=0.2, move_z=-0.1)
    turn, move = motion(session, before)
    assert np.allclose(move, [0.2, 0, -0.1], atol=1e-6) and np.allclose(turn, 0)
    before = group(session).target
    apply(page, turn_y=30)
    turn, move = motion(session, before)
    assert np.allclose(turn, [0, 30, 0], atol=1e-4) and np.allclose(move, 0, atol=1e-6)
    with page.expect_response("**/frame"):
        page.locator("#gizmo-bar").get_by_text("Local axes").click()
    page.wait_for_timeout(100)
    axes, before = session.frame(2), group(session).target
    assert np.abs(axes - np.eye(3)).max() > 0.3
    apply(page, move_z=0.1, turn_z=20)
    turn, move = motion(session, before)
    assert np.allclose(move, 0.1 * axes[:, 2], atol=1e-6) and np.allclose(turn, 20 * axes[:, 2], atol=1e-4)


def test_a_drag_snaps_and_turns_about_a_moved_pivot(page, session):
    page.locator("#gizmo-bar").get_by_text("Snap").click()
    page.get_by_label("length of a step").fill("0.125")
    before = group(session).target
    drag(page, gizmo(page), (63, -31))
    release(page)
    turn, move = motion(session, before)
    steps = move / 0.125
    assert np.allclose(steps, steps.round(), atol=1e-5) and steps.any() and np.allclose(turn, 0)

    page.locator("#gizmo-bar").get_by_text("Move pivot").click()
    at, before = gizmo(page), session.state
    page.mouse.move(*at)
    page.mouse.down()
    page.mouse.move(*(at + [60, 0]), steps=5)
    page.mouse.up()
    page.wait_for_timeout(200)
    assert session.state is before and np.linalg.norm(gizmo(page) - at) > 20
    page.locator("#gizmo-bar").get_by_text("Move pivot").click()
    start = group(session).target
    apply(page, turn_y=90)
    turn, move = motion(session, start)
    assert np.allclose(turn, [0, 90, 0], atol=1e-3) and np.linalg.norm(move) > 0.1
    # The pivot moves with its group: three more quarters bring the group back.
    for _ in range(3):
        apply(page, turn_y=90)
    assert np.abs(group(session).target - start).max() < 1e-5 * session.mesh.diagonal


def test_the_rest_shape_edges_roll_and_up_axis_change_the_view_alone(page, session):
    stage = page.locator("#stage")

    def shown() -> np.ndarray:
        page.wait_for_timeout(250)
        return pixels(stage)[60:]  # without the buttons at the top

    page.get_by_role("button", name="choose group 2").click()  # without arrows
    resting = shown()
    page.get_by_role("button", name="choose group 2").click()
    apply(page, move_x=0.6)
    page.get_by_role("button", name="choose group 2").click()
    posed, state = shown(), session.state
    assert changed(resting, posed) > 0.01
    toggle = page.get_by_role("button", name="Rest shape")
    toggle.click()
    assert changed(resting, shown()) < 0.002 and toggle.get_attribute("aria-pressed") == "true"
    toggle.click()
    assert changed(posed, shown()) < 0.002
    page.get_by_role("button", name="Reset view").click()
    page.get_by_text("Options").click()
    opened = shown()
    page.get_by_label("edges", exact=True).check()
    assert changed(opened, shown()) > 0.01
    page.get_by_label("edges", exact=True).uncheck()
    assert changed(opened, shown()) < 0.002
    for name, back in ("left", "right"), ("right", "left"):
        page.get_by_role("button", name=f"roll the view to the {name}").click()
        assert changed(opened, shown()) > 0.01
        page.get_by_role("button", name=f"roll the view to the {back}").click()
        assert changed(opened, shown()) < 0.005
    page.get_by_label("up axis").select_option("z")
    body = lambda image: np.argwhere((image[60:-60, 100:720] < 235).any(axis=2))  # noqa: E731
    extent = np.ptp(body(opened), axis=0)
    lying = np.ptp(body(shown()), axis=0)
    assert extent[0] > 1.2 * extent[1] and lying[0] < lying[1], (extent, lying)  # the long axis is y
    page.get_by_label("up axis").select_option("y")
    assert changed(opened, shown()) < 0.002 and session.state is state


def test_buttons_limit_and_pick_by_distance(page, session):
    page.get_by_label("distance of the limit").fill("1")
    asked(page, "limit", page.get_by_role("button", name="limit to").click)
    page.wait_for_selector("#groups li:nth-child(3)")
    assert session.state.groups[2].name == "beyond group 2"
    asked(page, "pick", page.get_by_role("button", name="pick", exact=True).click)
    before = len(session.state.selection)
    page.get_by_label("distance along the edges").fill("0.4")
    asked(page, "reach", page.get_by_role("button", name="pick within").click)
    assert before < len(session.state.selection) < session.mesh.n
    page.get_by_role("button", name="linked").click()
    page.wait_for_selector(f"#picked:text-is('{session.mesh.n}')")


def test_colours_of_the_file_are_shown(browser, here):
    rows = [" ".join(map(str, ["v", *v, 0.9, 0.1, 0.1])) for v in upright(BODY).V.tolist()]
    Path("red.obj").write_text("\n".join(rows + [f"f {a} {b} {c}" for a, b, c in (BODY.F + 1).tolist()]))
    with lent(Session(Path("red.obj"))) as server, opened(browser, server.address) as page:
        page.wait_for_selector("#stage[data-state=converged]")
        page.wait_for_timeout(300)
        stage = page.locator("#stage")
        assert portion(pixels(stage), 0, least=100) > 0.05
        page.get_by_text("Options").click()
        page.get_by_label("colours and textures").uncheck()
        page.wait_for_timeout(300)
        assert portion(pixels(stage), 0, least=100) < 0.001
