"""A whole task in a browser: pick, fix, drag, undo, save, a killed program, recover, export."""

from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from sshade import Mesh
from sshade.cli.main import main
from sshade.edit.session import Session
from sshade.files.meshes import read_arrays
from tests.browser import opened
from tests.full import few
from tests.shapes import beside, shifted
from tests.sshade.cli.test_edit import get, running
from tests.sshade.edit.acting import asked, drag, gizmo, mark, release, where
from tests.sshade.edit.lent import lent, unpacked
from tests.sshade.edit.sessions import BODY, added, begun, upright

#: Window sizes of a laptop and of a telephone, in pixels.
SIZES = [(1280, 800), (390, 844)]


@pytest.fixture
def session(here) -> Session:
    """Return a session with a body and two small balls in front of it, which get no handles."""
    balls = beside(*(shifted(Mesh(0.1 * BODY.V, BODY.F), [2, side, 0.3]) for side in (-0.5, 0.5)))
    return begun(upright(beside(BODY, balls)))


@contextmanager
def shown(browser, address: str, size: tuple[int, int]):
    """Open the page; wait for the converged shape."""
    with opened(browser, address, width=size[0], height=size[1]) as page:
        page.on("dialog", lambda dialog: dialog.accept())
        page.wait_for_selector("#stage[data-state=converged]")
        yield page


def press(page, name: str, answer: str) -> None:
    """Press a button, wait for an answer and for the converged shape."""
    asked(page, answer, page.get_by_role("button", name=name, exact=True).click)
    page.wait_for_selector("#stage[data-state=converged]")


def in_sight(page, locator) -> bool:
    """Return whether an element lies in the window and nothing covers its middle."""
    locator.scroll_into_view_if_needed()
    return locator.evaluate(
        "it => { const b = it.getBoundingClientRect(); const at = [b.x + b.width / 2, b.y + b.height / 2];"
        "const top = document.elementFromPoint(...at);"
        "return b.x >= 0 && b.right <= innerWidth && b.bottom <= innerHeight + 0.5"
        " && document.documentElement.scrollHeight <= innerHeight && (it === top || it.contains(top)); }"
    )


@pytest.mark.parametrize("size", few(SIZES, SIZES[0]))
def test_a_creature_is_posed_survives_a_killed_program_and_is_saved(browser, session, size):
    V = session.mesh.V
    editor = "body.ply", "--no-browser"
    with running(*editor) as (process, address), shown(browser, address, size) as page:
        mark(page, session, where(page, V, V))
        assert "Components without handles: 2." in page.locator("#carried").inner_text()
        drag(page, gizmo(page), (50, 30))
        release(page)
        assert "Other parts move too?" in page.locator("#hint").inner_text()
        assert "Largest stretch 1." in page.locator("#quality").inner_text()
        moved = unpacked(get(f"{address}whole"))
        page.locator("#gizmo-bar label", has_text="Turn").click()
        drag(page, gizmo(page) + [3, 0], (37, 5))
        release(page)
        posed = unpacked(get(f"{address}whole"))
        pivots = [facts["groups"][1]["pivot"] for facts in (moved, posed)]
        assert np.allclose(*pivots, atol=1e-6)  # a turn is about the middle of the group
        press(page, "Undo", "undo")
        straight = unpacked(get(f"{address}whole"))["positions"]
        assert np.abs(straight - posed["positions"]).max() > 0.05
        press(page, "Redo", "redo")
        assert np.array_equal(unpacked(get(f"{address}whole"))["positions"], posed["positions"])
        process.kill()
        page.wait_for_selector("body.ended", timeout=20_000)
        assert "offers work that was not saved" in page.locator("#message").inner_text()
    with running(*editor) as (process, address), shown(browser, address, size) as page:
        page.wait_for_selector("#recovery:has-text('2 groups')")
        press(page, "Recover", "recover")
        page.wait_for_selector("#groups li:nth-child(2)")
        assert page.locator("#recovery").is_hidden()
        again = unpacked(get(f"{address}whole"))
        for name in "labels", "positions":
            assert np.array_equal(again[name], posed[name])
        assert again["groups"] == posed["groups"]
        for name in "Save handles", "Save mesh", "Undo", "End", "Reset view", "Fix", "Delete":
            assert in_sight(page, page.get_by_role("button", name=name, exact=True)), name
        press(page, "Save mesh", "save")
        press(page, "Save handles", "save")
        page.wait_for_selector("#saved:has-text('body_handles')")
        run = page.locator("#command").inner_text().split()
        page.get_by_role("button", name="End").click()
        assert process.wait(20) == 0
    assert list(Path().glob("*.npz")) == []
    assert main([*run[1:-1], "again.ply"]) == 0
    final = read_arrays("body_deformed.ply")[0]
    assert np.abs(read_arrays("again.ply")[0] - final).max() < 1e-9


def test_all_controls_have_names_and_messages_are_announced(browser, session):
    added(session, np.arange(9), "moved")
    with lent(session) as server, shown(browser, server.address, SIZES[0]) as page:
        for summary in page.locator("summary").all():
            summary.click()
        unnamed = page.evaluate(
            "[...document.querySelectorAll('button, input, select, summary')].filter((it) => !["
            "it.textContent, it.getAttribute('aria-label'), it.closest('label')?.textContent"
            "].some((text) => text?.trim()))"
            ".map((it) => it.outerHTML)"
        )
        assert unnamed == []
        for place in "#hint", "#busy", "#loose", "#carried", "#saved":
            assert page.locator(place).get_attribute("role") == "status"
        for place in "#message", "#trouble":
            assert page.locator(place).get_attribute("role") == "alert"
        page.get_by_role("button", name="Delete").focus()
        with page.expect_response("**/remove"):
            page.keyboard.press("Enter")
        assert session.state.groups == ()
