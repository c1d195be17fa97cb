"""A figure in a browser, in a frame as a notebook shows it: it draws, reacts, and needs no network."""

import numpy as np

from sshade import DeformationResult, DeformationTask
from tests.browser import changed, opened, pixels
from tests.shapes import bumpy, end_handles

REST = bumpy(3)
TASK = DeformationTask("bend", REST, end_handles(REST.V, shift=(0.3, 0, 0.2)))
RESULT = DeformationResult(REST.V * [1, 1, 1.3], 0, None).of(TASK)


def test_a_result_draws_switches_and_turns_without_a_network(browser, tmp_path):
    path = tmp_path / "notebook.html"
    path.write_text(f"<div>{RESULT._repr_html_()}</div>", encoding="utf-8")
    with opened(browser, path.as_uri(), width=800, height=600) as page:
        frame = page.frame_locator("iframe")
        view = frame.locator("#turn-stage[data-shape]")
        view.wait_for(timeout=20_000)
        first = pixels(view)
        assert 0.02 < (first[4:-4, 4:-4] < 235).any(axis=2).mean() < 0.9
        assert frame.locator("#turn-label").inner_text() == "change of edge length (%)"
        frame.locator("#turn-shapes").get_by_text("rest", exact=True).click()
        assert changed(first, rest := pixels(view)) > 0.02
        page.keyboard.press("b")  # the other shape
        assert changed(first, pixels(view)) < 0.001
        frame.get_by_label("beside").select_option("rest")
        middle = pixels(view).shape[1] // 2
        both = [
            (half[4:-4, 4:-4] < 235).any(axis=2).mean()
            for half in np.split(pixels(view)[:, : 2 * middle], 2, 1)
        ]
        assert min(both) > 0.02
        frame.get_by_label("beside").select_option("nothing")
        page.keyboard.press("b")
        page.keyboard.press("w")
        assert changed(rest, pixels(view)) > 0.02  # edges
        page.keyboard.press("w")
        frame.get_by_label("handles").uncheck()
        assert np.ptp(pixels(view)[4:-4, 4:-4], axis=2).max() < 60 < np.ptp(rest[4:-4, 4:-4], axis=2).max()
        box = view.bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + 90, y, steps=4)
        page.mouse.up()
        assert changed(rest, pixels(view)) > 0.02
        assert page.said == []
        assert [url for url in page.asked if not url.startswith(("file:", "data:", "blob:"))] == []
