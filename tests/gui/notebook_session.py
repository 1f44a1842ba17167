"""What a notebook's kernel does with the viewer, in a process of its own as there: run by test_notebook.py."""

from __future__ import annotations

import asyncio
import io
from typing import Any

import numpy as np
import pytest
from PIL import Image

import holoview
from holoview.viewer.app import notebook

SYSTEM = holoview.load("holochrome-8").edit({"shape": [32, 48]})


def main() -> None:
    """Frames are sent, an edit by code is seen, a second viewer replaces the first one."""
    sent, session = asyncio.run(_play())
    message, buffers = sent[-1]
    assert message["type"] == "framebufferdata" and session.system.gap_m == pytest.approx(3e-3)
    pixels = np.asarray(Image.open(io.BytesIO(buffers[0])))
    assert pixels.shape[:2] == (400, 640) and pixels.std() > 10, "something is seen"


async def _play() -> tuple[list[Any], Any]:
    viewer = holoview.show(SYSTEM, size=(640, 400))
    canvas, sent = viewer.app.window.canvas, list[Any]()
    canvas.send = lambda message, buffers: sent.append((message, buffers))
    _resize(canvas, 640, 400)
    await _frames(canvas, sent, 5)
    viewer.session.change("Gap", {"gap": "3 mm"})
    await _frames(canvas, sent, len(sent) + 3)
    again = holoview.show(viewer.session.system, size=(320, 200))
    assert notebook.open_viewers == [again], "one at a time"
    again.close()
    assert notebook.open_viewers == []
    return sent, viewer.session


def _resize(canvas: Any, width: int, height: int) -> None:
    event = {"type": "resize", "width": width, "height": height, "pwidth": width, "pheight": height, "ratio": 1.0}
    canvas._rfb_handle_msg(canvas, event, [])


async def _frames(canvas: Any, sent: list[Any], count: int) -> None:
    """Plays the browser, which shows every frame at once, until so many were sent."""
    canvas._has_visible_views = True
    for _ in range(3000):
        if len(sent) >= count:
            return
        for message, _buffers in sent[-1:]:
            canvas._frame_feedback = {"index": message["index"], "timestamp": message["timestamp"], "localtime": 0.0}
        await asyncio.sleep(0.02)
    raise AssertionError(f"{len(sent)} of {count} frames were sent")


if __name__ == "__main__":
    main()
