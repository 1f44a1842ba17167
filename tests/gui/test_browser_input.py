"""Input in Chromium reaches the viewer: quickly, in its order, and whatever else the browser does with it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from holoview.light.gpu.device import Device
from tests.chromium import Browser, needs_chromium, pixels, started_browser
from tests.gui.conftest import Gui
from tests.gui.served import Served, serving
from tests.gui.test_browser import wait_for_sizes
from tests.patience import wait_until

pytestmark = [pytest.mark.gpu, pytest.mark.long, needs_chromium]
SIZE = (900, 700)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """A browser; nothing may go wrong in its pages."""
    with started_browser() as opened:
        yield opened
        assert opened.close_pages() == []


@pytest.fixture(scope="module")
def served(device: Device, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A viewer that is served."""
    with serving(tmp_path_factory.mktemp("served"), "--new") as served:
        yield served


@pytest.fixture(scope="module")
def opened(served: Served, browser: Browser) -> Any:
    """Its page, which shows an image; nobody has clicked on it before the first test."""
    page = browser.open(served.url, *SIZE)
    wait_for_sizes(page, *SIZE)
    wait_until(lambda: pixels(page, served.folder)[100:400, 300:600].std() > 15)
    return page


@pytest.fixture
def page(opened: Any, served: Served) -> Any:
    """The page, with the looks of other tests undone."""
    for _ in served.looks():
        opened.keyboard.press("Alt+z")
    wait_until(lambda: served.looks() == [])
    return opened


def test_keys_and_wheel_work_before_the_first_click(page: Any, served: Served) -> None:
    page.keyboard.press("e")
    page.mouse.move(450, 250)
    page.keyboard.down("Control")
    for _ in range(5):
        page.mouse.wheel(0, -100)
    page.keyboard.up("Control")
    page.keyboard.press("g")
    wait_until(lambda: served.looks() == ["Exposure", "Focal plane", "Page"])


def test_what_follows_a_click_at_once_isnt_lost(page: Any, served: Served) -> None:
    page.evaluate("document.activeElement.blur()")  # as after a click elsewhere in the browser
    page.mouse.click(450, 250)
    for key in ("g", "e", "c"):
        page.keyboard.press(key)
    wait_until(lambda: served.looks() == ["Page", "Exposure", "Channel"])


def test_keys_that_the_browser_uses_itself_are_the_viewers(page: Any, served: Served) -> None:
    url = page.url
    page.keyboard.press("Control+p")
    page.keyboard.type("wipe")
    page.keyboard.press("Enter")
    wait_until(lambda: served.looks() == ["Compare"])
    page.keyboard.press("Control+s")
    page.keyboard.type("mine")
    page.keyboard.press("Control+a")
    page.keyboard.type(str(served.folder / "saved"))
    page.keyboard.press("Enter")
    wait_until((served.folder / "saved.safetensors").is_file)
    assert page.url == url


def test_a_composed_text_is_taken_once(page: Any, served: Served) -> None:
    """As an input method or a dead key sends it: every stage of the composition, then the text."""
    page.keyboard.press("Control+p")
    keyboard = page.context.new_cdp_session(page)
    for stage in ("w", "wi", "wip"):
        keyboard.send("Input.imeSetComposition", {"text": stage, "selectionStart": 3, "selectionEnd": 3})
    keyboard.send("Input.insertText", {"text": "wip"})
    page.keyboard.type("e")
    page.keyboard.press("Enter")
    wait_until(lambda: served.looks() == ["Compare"])


def test_a_key_that_is_released_elsewhere_is_released(page: Any, served: Served) -> None:
    page.keyboard.down("Control")
    page.evaluate("document.activeElement.blur()")
    page.keyboard.up("Control")
    page.mouse.click(450, 250)
    page.keyboard.press("g")
    wait_until(lambda: served.looks() == ["Page"])


def test_a_drag_moves_the_image_by_as_many_pixels(
    page: Any, served: Served, make_gui: Callable[..., Gui], tmp_path: Path
) -> None:
    twin = make_gui(size=SIZE)
    twin.draw_until_idle()
    left, top, right, bottom = twin.context.item_rects["image"]
    inside = np.s_[round(top) + 60 : round(bottom) - 60, round(left) + 60 : round(right) - 60]
    page.mouse.move((left + right) / 2, (top + bottom) / 2)
    for _ in range(8):
        page.mouse.wheel(0, -100)  # until the image is larger than the panel
    page.mouse.move(5, SIZE[1] - 5)
    before = _settled(page, tmp_path)
    page.mouse.move((left + right) / 2, (top + bottom) / 2)
    page.mouse.down()
    page.mouse.move((left + right) / 2 + 31, (top + bottom) / 2 - 17, steps=5)
    page.mouse.up()
    page.mouse.move(5, SIZE[1] - 5)
    after = _settled(page, tmp_path)
    assert not np.array_equal(after[inside], before[inside])
    assert np.array_equal(np.roll(before, (-17, 31), axis=(0, 1))[inside], after[inside])


def _settled(page: Any, folder: Path) -> np.ndarray:
    """The page when nothing changes any more; the last frame comes without loss, a while after the one before."""
    shown = [pixels(page, folder)]

    def is_same() -> bool:
        page.wait_for_timeout(1500)
        shown.append(pixels(page, folder))
        return np.array_equal(shown[-1], shown[-2])

    wait_until(is_same)
    return shown[-1]
