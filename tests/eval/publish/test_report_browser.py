"""The report fits the window of a phone and of a desktop, and its 3D view changes cases."""

import pytest

from tests.browser import changed, opened, pixels


@pytest.fixture(params=[400, pytest.param(1280, marks=pytest.mark.full)])
def page(request, browser, tiny_report):
    with opened(browser, tiny_report.as_uri(), width=request.param, height=800) as page:
        page.wait_for_selector("#turn-stage[data-shape]")
        yield page


def test_it_opens_without_errors_and_fits_the_window(page):
    width = page.viewport_size["width"]
    assert [url for url in page.asked if not url.startswith(("file:", "data:", "blob:"))] == []
    assert page.evaluate("document.documentElement.scrollWidth") == width
    headline = "const table = document.querySelector('.scroll'); table.scrollWidth <= table.clientWidth"
    assert page.evaluate(headline)
    broken = "[...document.images].filter((image) => !image.complete || !image.naturalWidth).length"
    assert page.evaluate(broken) == 0


def test_the_view_draws_and_changes_cases(page):
    page.locator("#turn").scroll_into_view_if_needed()
    assert page.locator("#turn-stage").get_attribute("data-shape") == "learned"
    first = pixels(page.locator("#turn-stage"))[4:-4, 4:-4]
    page.locator("#turn-case").select_option("1")
    page.wait_for_selector("#turn-stage[data-case=tiny-case-1]")
    page.locator("#turn-shapes").get_by_text("stretching", exact=True).click()
    assert changed(first, pixels(page.locator("#turn-stage"))[4:-4, 4:-4]) > 0.01
    assert page.said == []
