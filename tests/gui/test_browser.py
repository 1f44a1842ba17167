"""`holoview view --serve` in Chromium: the page, its size, its dialogs, and a connection that drops."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from holoview.gpu.device import Device
from holoview.session.editing_session import EditingSession
from holoview.session.session_store import SessionStore
from tests.gui.conftest import small_bench
from tests.gui.served import SECONDS, serving

playwright = pytest.importorskip("playwright.sync_api", reason="playwright drives the browser")
_CHROMIUM = shutil.which("chromium")
pytestmark = [pytest.mark.gpu, pytest.mark.skipif(_CHROMIUM is None, reason="needs Chromium")]
_QUIET = ("--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update")
_SIZES = """() => {
    const canvas = document.getElementById('canvas'), image = canvas.querySelector('img')
    const page = canvas.getBoundingClientRect()
    return image && [page.x, page.y, page.width, page.height, image.naturalWidth, image.naturalHeight]
}"""


@pytest.fixture(scope="module")
def launch() -> Iterator[Callable[..., Any]]:
    """Starts Debian's browser without a window: launch(option, …)."""
    with playwright.sync_playwright() as driver:
        started: list[Any] = []

        def made(*options: str) -> Any:
            started.append(driver.chromium.launch(executable_path=_CHROMIUM, args=[*_QUIET, *options]))
            return started[-1]

        yield made
        for browser in started:
            browser.close()


@pytest.fixture(scope="module")
def chromium(launch: Callable[..., Any]) -> Any:
    """A browser that several tests share."""
    return launch()


@pytest.fixture
def open_page(chromium: Any) -> Iterator[Callable[..., Any]]:
    """Opens pages: open_page(url, width, height). No page may have thrown an error."""
    contexts, errors = [], []

    def made(url: str, width: int, height: int) -> Any:
        contexts.append(chromium.new_context(viewport={"width": width, "height": height}))
        page = contexts[-1].new_page()
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(url)
        return page

    yield made
    for context in contexts:
        context.close()
    assert errors == []


def _wait(condition: Callable[[], bool]) -> None:
    until = time.monotonic() + SECONDS
    while not condition():
        assert time.monotonic() < until, "it didn't come about in time"
        time.sleep(0.1)


def _wait_for_sizes(page: Any, width: int, height: int, ratio: float = 1.0) -> None:
    """Until the canvas fills the page and its image has a pixel for each of the screen's."""
    expected = pytest.approx([0, 0, width, height, width * ratio, height * ratio], abs=1)
    _wait(lambda: page.evaluate(_SIZES) == expected)


def _pixels(page: Any, file: Path) -> np.ndarray:
    page.screenshot(path=file)
    return np.asarray(Image.open(file).convert("RGB")).astype(int)


def test_without_the_token_there_is_no_page(device: Device, tmp_path: Path, open_page: Callable[..., Any]) -> None:
    with serving(tmp_path) as (host, _):
        page = open_page(f"http://{host}/?token=wrong", 400, 300)
        assert "needs the token" in page.content() and page.query_selector("#canvas") is None


def test_the_image_fills_the_page_and_follows_its_size(
    device: Device, tmp_path: Path, open_page: Callable[..., Any]
) -> None:
    with serving(tmp_path, "--new") as (host, token):
        page = open_page(f"http://{host}/?token={token}", 1000, 640)
        _wait_for_sizes(page, 1000, 640)
        page.set_viewport_size({"width": 720, "height": 500})
        _wait_for_sizes(page, 720, 500)


def test_a_fine_screen_gets_all_its_pixels(device: Device, tmp_path: Path, launch: Callable[..., Any]) -> None:
    browser = launch("--force-device-scale-factor=1.5", "--window-size=900,600")
    with serving(tmp_path, "--new") as (host, token):
        page = browser.new_context(no_viewport=True).new_page()
        page.goto(f"http://{host}/?token={token}")
        width, height = page.evaluate("[window.innerWidth, window.innerHeight]")
        _wait_for_sizes(page, width, height, 1.5)


def test_a_dropped_connection_is_told_and_opened_again(
    device: Device, tmp_path: Path, open_page: Callable[..., Any]
) -> None:
    with serving(tmp_path, "--new") as (host, token):
        page = open_page(f"http://{host}/?token={token}", 800, 500)
        _wait_for_sizes(page, 800, 500)
        page.evaluate("window.websocket.close()")
        page.get_by_text("Disconnected").wait_for()
        page.get_by_role("button", name="reconnect").click()
        page.get_by_text("Connected").wait_for()
        page.set_viewport_size({"width": 640, "height": 480})
        _wait_for_sizes(page, 640, 480)


def test_two_pages_show_the_same_viewer(device: Device, tmp_path: Path, open_page: Callable[..., Any]) -> None:
    with serving(tmp_path, "--new") as (host, token):
        first, second = (open_page(f"http://{host}/?token={token}", 800, 500) for _ in range(2))
        for page in (first, second):
            _wait(lambda page=page: bool(page.evaluate(_SIZES)))  # type: ignore[misc]
            _wait(lambda page=page: _pixels(page, tmp_path / "a.png").std() > 20)  # type: ignore[misc]


def test_the_offer_to_recover_lies_inside_the_page_and_works(
    device: Device, tmp_path: Path, open_page: Callable[..., Any]
) -> None:
    store = SessionStore(tmp_path / "holoview")
    lost = EditingSession(small_bench())
    autosave = store.start_autosave(lost)
    lost.change("Gap", {"gap": 4e-3})
    assert autosave.flush()
    (autosave.folder / "lock.json").write_text(json.dumps({"pid": 999999999, "since": 0}))
    lost.close()
    with serving(tmp_path) as (host, token):
        page = open_page(f"http://{host}/?token={token}", 900, 600)
        _wait_for_sizes(page, 900, 600)
        shown: list[np.ndarray] = []

        def has_dialog() -> bool:
            """Its black window, 560 pixels wide, around the middle of the page."""
            shown.append(_pixels(page, tmp_path / "a.png").max(axis=2))
            middle = shown[-1][:, 450 - 270 : 450 + 270] < 40
            return bool((middle.mean(axis=1) > 0.8).sum() > 30)

        _wait(has_dialog)
        page.set_viewport_size({"width": 640, "height": 420})
        _wait_for_sizes(page, 640, 420)
        rows = np.flatnonzero((_pixels(page, tmp_path / "a.png").max(axis=2)[:, 50:590] < 40).mean(axis=1) > 0.8)
        assert rows.size > 30 and rows[0] > 0 and rows[-1] < 419
        assert (rows[0] + rows[-1]) / 2 == pytest.approx(210, abs=25)
