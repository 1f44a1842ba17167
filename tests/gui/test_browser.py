"""`holoview view --serve` in Chromium: the page, its size, its dialogs, and connections that drop or end."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from holoview.light.gpu.device import Device
from holoview.viewer.document.session_store import SessionStore
from tests.chromium import Browser, needs_chromium, pixels, started_browser
from tests.gui.conftest import leave_crashed_session
from tests.gui.served import Served, serving
from tests.patience import PATIENCE_S, wait_until

pytestmark = [pytest.mark.gpu, needs_chromium]
_SIZES = """() => {
    const canvas = document.getElementById('canvas'), image = canvas.querySelector('img')
    const page = canvas.getBoundingClientRect()
    return image && [page.x, page.y, page.width, page.height, image.naturalWidth, image.naturalHeight]
}"""


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """A browser that all tests share."""
    with started_browser() as browser:
        yield browser


@pytest.fixture
def browser(chromium: Browser) -> Iterator[Browser]:
    """The browser; nothing may go wrong in its pages."""
    yield chromium
    assert chromium.close_pages() == []


@contextmanager
def serving_to(browser: Browser, folder: Path, *options: str) -> Iterator[Served]:
    """A viewer whose pages are closed before it is: one that outlives it asks in vain for a connection, and says so."""
    with serving(folder, *options) as served:
        yield served
        assert browser.close_pages() == []


def wait_for_sizes(page: Any, width: int, height: int, ratio: float = 1.0) -> None:
    """Until the canvas fills the page and its image has a pixel for each of the screen's."""
    expected = pytest.approx([0, 0, width, height, width * ratio, height * ratio], abs=1)
    wait_until(lambda: page.evaluate(_SIZES) == expected)


@pytest.mark.explores
def test_without_the_token_there_is_no_page(device: Device, tmp_path: Path, browser: Browser) -> None:
    with serving_to(browser, tmp_path) as served:
        page = browser.open(f"http://{served.address}/?token=wrong", 400, 300)
        assert "needs the token" in page.content() and page.query_selector("#canvas") is None
        assert [problem for problem in browser.close_pages() if "403" not in problem] == []


@pytest.mark.long
def test_the_image_fills_the_page_and_follows_its_size(device: Device, tmp_path: Path, browser: Browser) -> None:
    with serving_to(browser, tmp_path, "--new") as served:
        page = browser.open(served.url, 1000, 640)
        wait_for_sizes(page, 1000, 640)
        page.set_viewport_size({"width": 720, "height": 500})
        wait_for_sizes(page, 720, 500)


@pytest.mark.explores
def test_a_fine_screen_gets_all_its_pixels(device: Device, tmp_path: Path, browser: Browser) -> None:
    options = ("--force-device-scale-factor=1.5", "--window-size=900,600")
    with serving_to(browser, tmp_path, "--new") as served, browser.another(*options) as fine:
        page = fine.open(served.url)
        width, height = page.evaluate("[window.innerWidth, window.innerHeight]")
        wait_for_sizes(page, width, height, 1.5)


@pytest.mark.explores
def test_a_dropped_connection_is_told_and_opened_again(device: Device, tmp_path: Path, browser: Browser) -> None:
    with serving_to(browser, tmp_path, "--new") as served:
        page = browser.open(served.url, 800, 500)
        wait_for_sizes(page, 800, 500)
        page.evaluate("window.websocket.close(4000)")
        page.get_by_text("No connection to the viewer").wait_for()
        page.set_viewport_size({"width": 640, "height": 480})
        wait_for_sizes(page, 640, 480)
        page.get_by_text("No connection to the viewer").wait_for(state="hidden")


@pytest.mark.explores
def test_the_page_that_is_used_last_decides(device: Device, tmp_path: Path, browser: Browser) -> None:
    with serving_to(browser, tmp_path, "--new") as served:
        first = browser.open(served.url, 800, 500)
        wait_for_sizes(first, 800, 500)
        second = browser.open(served.url, 700, 440)
        second.get_by_text("Another page uses this viewer").wait_for()
        wait_until(lambda: pixels(second, tmp_path).std() > 20)
        second.mouse.click(690, 5)  # beside the menus
        wait_for_sizes(second, 700, 440)
        first.get_by_text("Another page uses this viewer").wait_for()
        second.keyboard.press("e")
        wait_until(lambda: served.looks() == ["Exposure"])
        second.close()
        wait_for_sizes(first, 800, 500)
        first.keyboard.press("g")
        wait_until(lambda: served.looks() == ["Exposure", "Page"])


@pytest.mark.explores
def test_a_page_that_is_closed_leaves_the_viewer_as_it_is(device: Device, tmp_path: Path, browser: Browser) -> None:
    with serving_to(browser, tmp_path, "--new") as served:
        page = browser.open(served.url, 800, 500)
        wait_for_sizes(page, 800, 500)
        page.keyboard.press("e")
        wait_until(lambda: served.looks() == ["Exposure"])
        page.close()
        again = browser.open(served.url, 640, 400)
        wait_for_sizes(again, 640, 400)
        again.keyboard.press("g")
        wait_until(lambda: served.looks() == ["Exposure", "Page"])


@pytest.mark.explores
def test_a_viewer_that_is_closed_says_so_on_the_page(device: Device, tmp_path: Path, browser: Browser) -> None:
    with serving_to(browser, tmp_path, "--new") as served:
        page = browser.open(served.url, 800, 500)
        wait_for_sizes(page, 800, 500)
        page.keyboard.press("Control+q")
        page.get_by_text("The viewer was closed").wait_for()
        assert served.process.wait(PATIENCE_S) == 0


@pytest.mark.explores
def test_a_viewer_that_died_is_missed(device: Device, tmp_path: Path, browser: Browser) -> None:
    with serving_to(browser, tmp_path, "--new") as served:
        page = browser.open(served.url, 800, 500)
        wait_for_sizes(page, 800, 500)
        served.process.send_signal(signal.SIGKILL)
        page.get_by_text("No connection to the viewer").wait_for()
        served.process.wait(PATIENCE_S)
        assert all("WebSocket" in problem for problem in browser.close_pages())


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="needs signals")
def test_a_viewer_that_crashes_is_back_with_its_work(device: Device, tmp_path: Path, browser: Browser) -> None:
    with serving_to(browser, tmp_path, "--new") as served:
        page = browser.open(served.url, 800, 500)
        wait_for_sizes(page, 800, 500)
        page.keyboard.press("e")
        wait_until(lambda: served.looks() == ["Exposure"])
        viewers = [p for p in psutil.Process(served.process.pid).children() if "spawn_main" in " ".join(p.cmdline())]
        viewers[0].send_signal(signal.SIGABRT)
        page.get_by_text("No connection to the viewer").wait_for()
        page.close()
        again = browser.open(served.next_url(), 700, 440)
        wait_for_sizes(again, 700, 440)
        again.keyboard.press("g")
        wait_until(lambda: served.looks()[:2] == ["Exposure", "Page"])
        # Of the first page, and of the second while the viewer starts: some are told late.
        assert all("WebSocket" in problem for problem in browser.close_pages())
    assert served.looks() == ["Exposure", "Page"]


@pytest.mark.explores
def test_the_offer_to_recover_lies_inside_the_page(device: Device, tmp_path: Path, browser: Browser) -> None:
    leave_crashed_session(SessionStore(tmp_path / "holoview"))
    with serving_to(browser, tmp_path) as served:
        page = browser.open(served.url, 900, 600)
        wait_for_sizes(page, 900, 600)

        def has_dialog() -> bool:
            """Its black window, 560 pixels wide, around the middle of the page."""
            middle = pixels(page, tmp_path).max(axis=2)[:, 450 - 270 : 450 + 270] < 40
            return bool((middle.mean(axis=1) > 0.8).sum() > 30)

        wait_until(has_dialog)
        page.set_viewport_size({"width": 640, "height": 420})
        wait_for_sizes(page, 640, 420)
        rows = np.flatnonzero((pixels(page, tmp_path).max(axis=2)[:, 50:590] < 40).mean(axis=1) > 0.8)
        assert rows.size > 30 and rows[0] > 0 and rows[-1] < 419
        assert (rows[0] + rows[-1]) / 2 == pytest.approx(210, abs=25)


@pytest.mark.explores
def test_a_page_too_many_says_so_and_gets_the_place_that_becomes_free(
    device: Device, tmp_path: Path, browser: Browser
) -> None:
    with serving_to(browser, tmp_path, "--new", "--clients", "1") as served:
        first = browser.open(served.url, 800, 500)
        wait_for_sizes(first, 800, 500)
        second = browser.open(served.url, 640, 400)
        second.get_by_text("There is no place: another page is connected already").wait_for()
        first.close()
        wait_for_sizes(second, 640, 400)


@pytest.mark.explores
def test_a_page_that_nobody_uses_goes_on_at_a_click(device: Device, tmp_path: Path, browser: Browser) -> None:
    with serving_to(browser, tmp_path, "--new", "--idle", "0.05") as served:
        page = browser.open(served.url, 640, 400)
        wait_for_sizes(page, 640, 400)
        page.get_by_text("This page was disconnected: not used for 0.05 minutes").wait_for()
        page.set_viewport_size({"width": 720, "height": 500})
        page.mouse.click(300, 200)
        wait_for_sizes(page, 720, 500)
