"""A score of the displayed image follows the image, its target, and which score is wanted."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

from holoview.holograms.metrics.perceptual import flip, ms_ssim
from holoview.light.colour import D65_WHITE, xyz_to_linear_srgb
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.measurements import ImageScore, LiveScore, image_psnr_db
from tests.patience import wait_until


def _wait(session: EditingSession, live: LiveScore) -> None:
    wait_until(lambda: not live.is_busy, session.poll)


def test_it_is_that_of_the_newest_image_and_none_before(session: EditingSession) -> None:
    changes: list[None] = []
    live = LiveScore("psnr", session, lambda: changes.append(None))
    xyz = np.full((4, 6, 1), 0.5) * D65_WHITE
    targets = [np.full((4, 6, 3), level, np.float32) for level in (0.6, 0.51)]
    for target, decibels in zip(targets, (20.0, 40.0), strict=True):  # −20 log10 of the error
        assert live.get(xyz, target, image_psnr_db) is None
        _wait(session, live)
        assert live.get(xyz, target, image_psnr_db) == pytest.approx(
            decibels, abs=1e-3
        )  # rounding of the levels in float32
    assert len(changes) == 2
    live.close()


def test_another_shape_has_none(session: EditingSession) -> None:
    live = LiveScore("psnr", session)
    assert live.get(np.zeros((4, 6, 3)), np.zeros((8, 6, 3)), image_psnr_db) is None and not live.is_busy
    live.close()


def test_another_score_of_the_same_image_is_measured_anew(session: EditingSession) -> None:
    live, rng = LiveScore("scores", session), np.random.default_rng(0)
    xyz, target = rng.random((24, 32, 3)), rng.random((24, 32, 3))
    found = []
    for measure in (ImageScore("ms_ssim", 60.0), ImageScore("flip", 60.0), ImageScore("flip", 20.0)):
        assert live.get(xyz, target, measure) is None
        _wait(session, live)
        found.append(live.get(xyz, target, replace(measure)))
    assert found[0] == ms_ssim(xyz_to_linear_srgb(xyz), target).mean
    assert found[1:] == [flip(xyz_to_linear_srgb(xyz), target, density).mean for density in (60.0, 20.0)]
    live.close()


def test_a_score_that_is_not_installed_is_said_once_and_another_one_can_be_chosen(
    session: EditingSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    live, wanted = LiveScore("scores", session), ImageScore("flip", 60.0)
    for level in (0.2, 0.3, 0.4):
        assert live.get(np.full((24, 24, 3), level), np.ones((24, 24, 3)), wanted) is None
        _wait(session, live)
    (message,) = session.messages.all
    assert "flip_evaluator isn't installed" in message.text and "holoview[perceptual]" in message.text
    xyz, target = np.full((24, 24, 3), 0.5), np.ones((24, 24, 3))
    live.get(xyz, target, ImageScore("ms_ssim", 60.0))
    _wait(session, live)
    assert live.get(xyz, target, ImageScore("ms_ssim", 60.0)) is not None
    live.close()
