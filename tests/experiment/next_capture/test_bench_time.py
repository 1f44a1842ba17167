"""How long captures take, learned from the clock."""

from __future__ import annotations

import pytest

from holoview.experiment.next_capture.capture_choice import BenchTime


def test_it_learns_the_stage_and_the_readout() -> None:
    time = BenchTime(settle_s=0.1)
    for exposure_s in (0.01, 0.02, 0.05):
        time.note(0.0, exposure_s, 0.1 + exposure_s + 0.03)
    time.note(4e-3, 0.01, 2.0 + 0.1 + 0.01 + 0.03)
    assert time.readout_s == pytest.approx(0.03, rel=1e-9)
    assert time.speed == pytest.approx(2e-3, rel=1e-9)
    assert time.expect(-1e-3, 0.2) == pytest.approx(0.5 + 0.1 + 0.2 + 0.03, rel=1e-9)


def test_one_exposure_that_had_to_be_searched_misleads_nobody() -> None:
    time = BenchTime(settle_s=0.1)
    for seconds in (0.15, 0.15, 0.9):
        time.note(0.0, 0.02, seconds)
    assert time.expect(0.0, 0.02) == pytest.approx(0.15, rel=1e-9)
