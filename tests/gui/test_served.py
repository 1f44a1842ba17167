"""`holoview view --serve` for real: a process, its token, a websocket that plays the browser."""

from __future__ import annotations

import io
import json
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect

from holoview.gpu.device import Device
from tests.gui.served import SECONDS, serving

pytestmark = pytest.mark.gpu
_SECONDS = SECONDS
_SIZE = {"width": 640, "height": 400, "pwidth": 640, "pheight": 400, "ratio": 1.0}


@pytest.fixture
def address(device: Device, tmp_path: Path) -> Iterator[tuple[str, str]]:
    """A viewer that is served: its HOST:PORT and its token. It ends in good order when it is interrupted."""
    with serving(tmp_path) as served:
        yield served.address, served.token
    assert not list(tmp_path.rglob("lock.json")), "the session was closed in good order"


def browser_cookie(address: str, token: str) -> str:
    """The cookie that the page sets for whoever has the token."""

    class Stay(urllib.request.HTTPRedirectHandler):
        def redirect_request(self, *_: Any) -> None:
            return None

    opener = urllib.request.build_opener(Stay)
    with pytest.raises(urllib.error.HTTPError) as answer:
        opener.open(f"http://{address}/?token={token}", timeout=_SECONDS)
    assert answer.value.code == 303
    cookie = str(answer.value.headers["set-cookie"]).split(";")[0]
    answer.value.close()
    return cookie


def next_frame(browser: ClientConnection, timeout_s: float = _SECONDS) -> np.ndarray:
    """The next picture; the browser says that it has shown it. Raises TimeoutError where none comes in time."""
    while True:
        message = json.loads(browser.recv(timeout=timeout_s))
        if message.get("type") != "framebufferdata":
            continue
        data = browser.recv(timeout=_SECONDS)
        assert isinstance(data, bytes)
        shown = {"index": message["index"], "timestamp": message["timestamp"], "localtime": 0.0}
        browser.send(json.dumps({"type": "_framefeedback", **shown}))
        return np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).astype(int)


def _key(browser: ClientConnection, kind: str, key: str) -> None:
    browser.send(json.dumps({"type": kind, "key": key, "modifiers": [], "timestamp": 0.0}))


def test_a_browser_with_the_token_sees_the_viewer_and_drives_it(address: tuple[str, str]) -> None:
    host, token = address
    with pytest.raises(InvalidStatus, match="403"), connect(f"ws://{host}/", open_timeout=_SECONDS):
        pass
    with connect(f"ws://{host}/", additional_headers={"Cookie": browser_cookie(host, token)}, max_size=None) as browser:
        browser.send(json.dumps({"type": "resize", "timestamp": 0.0, **_SIZE}))
        picture = next_frame(browser)
        for _ in range(40):
            if picture.shape[:2] == (400, 640) and picture.std() > 20:
                break
            picture = next_frame(browser)
        assert picture.shape[:2] == (400, 640) and picture.std() > 20, "something is seen"
        _key(browser, "key_down", "F1")
        _key(browser, "key_up", "F1")
        changes = [np.abs(next_frame(browser) - picture).mean() for _ in range(6)]
        assert max(changes) > 5, "the sheet of keys covers the image"
