"""Open pages in a browser, if the machine has one, and compare pictures of them."""

import io
import os
import shutil
from contextlib import contextmanager

import numpy as np
import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")

#: WebGL runs in software, because a machine without a screen has no other. Drawing the rest of the page
#: without WebGL halves the time. Root needs the flag --no-sandbox as well.
FLAGS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-gpu-compositing"]

#: Text in each message of the browser about a slow driver.
SLOW = "GL Driver Message (OpenGL, Performance"


@pytest.fixture(scope="session")
def browser():
    """Chromium without a window."""
    playwright = pytest.importorskip("playwright.sync_api")
    path = next(filter(None, map(shutil.which, NAMES)), None)
    with playwright.sync_playwright() as running:
        if path is None and not os.path.exists(running.chromium.executable_path):
            pytest.skip(f"there is no browser: none of {', '.join(NAMES)}, nor playwright's own")
        flags = FLAGS + (["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else [])
        opened = running.chromium.launch(executable_path=path, args=flags)
        yield opened
        opened.close()


@contextmanager
def opened(browser, address: str, *, width: int = 1280, height: int = 900, **settings):
    """Open a page. Its list `said` has the printed messages, its list `asked` the requested addresses.

    Messages of the browser itself about slow drivers are left out.
    """
    page = browser.new_page(viewport={"width": width, "height": height}, **settings)
    page.said, page.asked = [], []

    def said(text: str) -> None:
        if SLOW not in text:
            page.said.append(text)

    page.on("console", lambda message: said(message.text))
    page.on("pageerror", lambda error: said(str(error)))
    page.on("request", lambda asked: page.asked.append(asked.url))
    page.goto(address)
    yield page
    page.close()


def pixels(locator) -> np.ndarray:
    """Return the (height, width, 3) colours of an element on the screen."""
    from PIL import Image

    return np.asarray(Image.open(io.BytesIO(locator.screenshot())).convert("RGB")).astype(int)


def portion(image: np.ndarray, channel: int, *, least: int = 60) -> float:
    """Return the fraction of the pixels in which a channel is above `least` and twice the others."""
    own, others = image[..., channel], np.delete(image, channel, axis=-1)
    return float(((own > least) & (own[..., None] > 2 * others).all(axis=-1)).mean())


def changed(before: np.ndarray, after: np.ndarray) -> float:
    """Return the fraction of the pixels that changed visibly."""
    return float((np.abs(before - after).max(axis=2) > 30).mean())
