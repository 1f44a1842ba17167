"""`holoview view --serve` for real: a process, its token, a websocket that plays the browser."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect

from holoview.light.gpu.device import Device
from tests.gui.served import browser_cookie, next_frame, serving
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.gpu
_SIZE = {"width": 640, "height": 400, "pwidth": 640, "pheight": 400, "ratio": 1.0}


@pytest.fixture
def address(device: Device, tmp_path: Path) -> Iterator[tuple[str, str]]:
    """A viewer that is served: its HOST:PORT and its token. It ends in good order when it is interrupted."""
    with serving(tmp_path) as served:
        yield served.address, served.token
    assert not list(tmp_path.rglob("lock.json")), "the session was closed in good order"


def _key(browser: ClientConnection, kind: str, key: str) -> None:
    browser.send(json.dumps({"type": kind, "key": key, "modifiers": [], "timestamp": 0.0}))


def test_a_browser_with_the_token_sees_the_viewer_and_drives_it(address: tuple[str, str]) -> None:
    host, token = address
    with pytest.raises(InvalidStatus, match="403"), connect(f"ws://{host}/", open_timeout=PATIENCE_S):
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
