"""Debian's Chromium without a window, driven by playwright, for the tests of pages."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.patience import PATIENCE_S

CHROMIUM = shutil.which("chromium")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
_PICTURES = """images => images.map(image => {
    const place = image.getBoundingClientRect()
    return [place.left, place.right, image.naturalWidth]
})"""
_QUIET = ("--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update")


class Browser:
    """A browser whose pages report what goes wrong in them.

    problems: errors that pages threw or wrote to their console, and requests that failed.
    """

    def __init__(self, driver: Any, options: tuple[str, ...] = ()) -> None:
        self._driver = driver
        self._chromium = driver.chromium.launch(executable_path=CHROMIUM, args=[*_QUIET, *options])
        self._contexts: list[Any] = []
        self.problems: list[str] = []

    @contextmanager
    def another(self, *options: str) -> Iterator[Browser]:
        """A second browser, with some options of its command line."""
        browser = Browser(self._driver, options)
        yield browser
        assert browser.close_pages() == []
        browser.close()

    def open(self, url: str, width: int = 0, height: int = 0) -> Any:
        """Opens a page, with a window and cookies of its own, of the given size or of the browser's."""
        size = {"viewport": {"width": width, "height": height}} if width else {"no_viewport": True}
        self._contexts.append(self._chromium.new_context(**size))
        page = self._contexts[-1].new_page()
        page.set_default_timeout(PATIENCE_S * 1000)
        page.on("pageerror", lambda error: self.problems.append(str(error)))
        page.on("console", lambda line: self.problems.append(line.text) if line.type == "error" else None)
        page.on("requestfailed", self._on_failed_request)
        page.goto(url)
        return page

    def close_pages(self) -> list[str]:
        """Closes all pages; returns the problems since the last time."""
        while self._contexts:
            self._contexts.pop().close()
        problems = list(self.problems)
        self.problems.clear()
        return problems

    def _on_failed_request(self, request: Any) -> None:
        """Frames of the viewer are blobs in the page; one that is still read when the next one comes is given up."""
        if not (request.url.startswith("blob:") and "ERR_ABORTED" in str(request.failure)):
            self.problems.append(f"{request.url}: {request.failure}")

    def close(self) -> None:
        """Ends it."""
        self._chromium.close()


@contextmanager
def started_browser() -> Iterator[Browser]:
    """Starts the browser."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright drives the browser")
    with playwright.sync_playwright() as driver:
        browser = Browser(driver)
        yield browser
        browser.close()


def pixels(page: Any, folder: Path) -> np.ndarray:
    """What a page shows, 8-bit (y, x, 3), as signed integers."""
    file = folder / "page.png"
    page.screenshot(path=file)
    return np.asarray(Image.open(file).convert("RGB")).astype(int)


def check_document(file: Path, widths: tuple[int, ...] = (1400, 400)) -> None:
    """Opens an HTML file: it loads nothing else, all its pictures are visible, nothing is wider than the page."""
    with started_browser() as browser:
        for width in widths:
            page = browser.open(file.as_uri(), width, 900)
            loaded = page.evaluate("performance.getEntriesByType('resource').map(entry => entry.name)")
            assert [name[:200] for name in loaded if not name.startswith("data:")] == []
            for left, right, natural_width in page.eval_on_selector_all("img", _PICTURES):
                assert natural_width > 0 and 0 <= left < right <= width
            assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert browser.close_pages() == []
