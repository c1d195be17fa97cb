"""A browser for tests, where there is one, and what of its pictures they look at."""

import io
import os
import shutil
from contextlib import contextmanager

import numpy as np
import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")

#: WebGL in software, as a machine without a screen has no other; the page around it without WebGL takes half
#: the time. The sandbox is not for root.
FLAGS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-gpu-compositing"]

#: In each line about a driver that is slower than it could be.
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
    """Open a page, which lists what it printed as `said`, and the addresses that it asked for as `asked`.

    What the browser itself prints about slow drivers is left out.
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
    """(height, width, 3) colours of an element as it is on the screen."""
    from PIL import Image

    return np.asarray(Image.open(io.BytesIO(locator.screenshot())).convert("RGB")).astype(int)


def changed(before: np.ndarray, after: np.ndarray) -> float:
    """Share of the pixels that changed visibly."""
    return float((np.abs(before - after).max(axis=2) > 30).mean())
