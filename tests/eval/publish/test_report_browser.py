"""The report draws and reacts in a browser, at the width of a phone and at the width of a desktop."""

import numpy as np
import pytest

from tests.browser import changed, opened, pixels


@pytest.fixture(params=[400, pytest.param(1280, marks=pytest.mark.full)])
def page(request, browser, tiny_report):
    size = {"width": request.param, "height": 800, "has_touch": request.param == 400}
    with opened(browser, tiny_report.as_uri(), **size) as page:
        page.wait_for_selector("#turn-stage[data-shape]")
        yield page


def stage(page) -> np.ndarray:
    """Return the pixels of the 3D view on the screen, without its frame."""
    return pixels(page.locator("#turn-stage"))[4:-4, 4:-4]


def drag(page, dx: int) -> None:
    """Drag the mouse by `dx` pixels from the middle of the 3D view."""
    box = page.locator("#turn-canvas").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + dx, y, steps=4)
    page.mouse.up()
    page.wait_for_timeout(50)


def test_it_opens_without_errors_and_fits_the_window(page):
    width = page.viewport_size["width"]
    assert page.said == []
    assert [url for url in page.asked if not url.startswith(("file:", "data:", "blob:"))] == []
    assert page.evaluate("document.documentElement.scrollWidth") == width
    for table in page.locator("section.experiment > .scroll table").all():
        assert table.is_visible() and table.bounding_box()["height"] > 40
    broken = "[...document.images].filter((image) => !image.complete || !image.naturalWidth).length"
    assert page.evaluate(broken) == 0
    assert page.locator(".case").count() == 2


def test_the_view_draws_and_turns(page):
    page.locator("#turn").scroll_into_view_if_needed()
    first = stage(page)
    assert 0.02 < ((first < 235).any(axis=2)).mean() < 0.9
    drag(page, 90)
    turned = stage(page)
    assert changed(first, turned) > 0.02
    page.locator("#turn-home").click()
    assert changed(first, stage(page)) < 0.005
    assert page.said == []


def test_the_view_switches_shapes_errors_handles_and_cases(page):
    page.locator("#turn").scroll_into_view_if_needed()
    assert page.locator("#turn-stage").get_attribute("data-shape") == "stretching"
    coloured = stage(page)
    page.get_by_label("colours").uncheck()
    plain = stage(page)
    assert changed(coloured, plain) > 0.02
    assert np.ptp(plain, axis=2).max() > 100  # the handles keep their colours
    page.get_by_label("handles").uncheck()
    assert np.ptp(stage(page), axis=2).max() < 60
    page.locator("#turn-shapes").get_by_text("rest", exact=True).click()
    assert page.locator("#turn-stage").get_attribute("data-shape") == "rest"
    assert changed(plain, stage(page)) > 0.02  # the rest shape is smaller
    page.locator("#turn-case").select_option("1")
    page.wait_for_selector("#turn-stage[data-case=tiny-case-1]")
    assert page.locator("#turn-stage").get_attribute("data-shape") == "rest"
    page.locator("a.turn").first.click()
    page.wait_for_selector("#turn-stage[data-case=tiny-case-0]")
    assert page.said == []
