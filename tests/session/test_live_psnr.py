"""The PSNR of the displayed image follows the image and its target."""

from __future__ import annotations

import time

import numpy as np
import pytest

from holoview.colour import D65_WHITE
from holoview.session.editing_session import EditingSession
from holoview.session.live_psnr import LivePsnr


def _wait(session: EditingSession, live: LivePsnr) -> None:
    until = time.monotonic() + 20
    while live.is_busy and time.monotonic() < until:
        time.sleep(0.01)
    session.poll()


def test_it_is_that_of_the_newest_image_and_none_before(session: EditingSession) -> None:
    changes: list[None] = []
    live = LivePsnr(session, lambda: changes.append(None))
    xyz = np.full((4, 6, 1), 0.5) * D65_WHITE
    targets = [np.full((4, 6, 3), level, np.float32) for level in (0.6, 0.51)]
    for target, decibels in zip(targets, (20.0, 40.0), strict=True):  # −20 log10 of the error
        assert live.get(xyz, target) is None
        _wait(session, live)
        assert live.get(xyz, target) == pytest.approx(decibels, abs=1e-3)  # rounding of the levels in float32
    assert len(changes) == 2
    live.close()


def test_another_shape_has_none(session: EditingSession) -> None:
    live = LivePsnr(session)
    assert live.get(np.zeros((4, 6, 3)), np.zeros((8, 6, 3))) is None and not live.is_busy
    live.close()
