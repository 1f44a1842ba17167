"""A page in Chromium with its software WebGPU device, for the tests of pages."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.chromium import Browser, started_browser

WEBGPU = ("--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader")
_PIXELS = """async () => {
    const image = await window.holoview.pixels()
    let text = ""
    const part = i => String.fromCharCode(...image.srgb8.subarray(i, i + 32768))
    for (let i = 0; i < image.srgb8.length; i += 32768) text += part(i)
    return [image.height, image.width, btoa(text)]
}"""


@contextmanager
def webgpu_browser() -> Iterator[Browser]:
    """Chromium with WebGPU on the processor."""
    with started_browser() as plain, plain.another(*WEBGPU) as browser:
        yield browser


def open_page(browser: Browser, file: Path, hash_: str = "", width: int = 1200, height: int = 900) -> Any:
    """Opens a page and waits for its first image."""
    page = browser.open(file.as_uri() + hash_, width, height)
    page.evaluate("() => window.holoview.ready")
    return page


def set_state(page: Any, **changes: Any) -> None:
    """Changes the page's state and waits for its image."""
    page.evaluate("changes => window.holoview.set(changes)", changes)


def claims_of(page: Any) -> str:
    """What the page says of its file's claims, once it has computed them again, which follows the first image."""
    page.wait_for_function("() => document.getElementById('claims').textContent.includes('computed here')")
    return str(page.inner_text("#claims"))


def drag_right(page: Any, what: Any, by_px: int) -> None:
    """Drags the middle of something on a page to the right."""
    what.scroll_into_view_if_needed()
    box = what.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + by_px, y, steps=2)
    page.mouse.up()


def page_pixels(page: Any) -> NDArray[np.uint8]:
    """The page's image at full samples, (y, x, 3)."""
    height, width, text = page.evaluate(_PIXELS)
    return np.frombuffer(base64.b64decode(text), np.uint8).reshape(height, width, 3)
