"""Figures follow the newest image; what is dark or outside is told instead of measured."""

from __future__ import annotations

from collections.abc import Callable
from queue import Queue
from threading import Event
from typing import Any

import numpy as np
import pytest

from holoview.light.colour import D65_WHITE
from holoview.util.mailbox import LatestTask
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.measurements import ImageMeasurements, LiveMeasurement, measure_image
from tests.patience import PATIENCE_S, wait_until


def _speckle(session: EditingSession, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).exponential(size=session.document.image_shape)


def test_all_figures_of_an_image_at_once(session: EditingSession) -> None:
    session.edit_view("Draw", region=(8, 8, 32, 32), profile=(0.0, 0.0, 10.0, 0.0))
    luminance = _speckle(session)
    lasers = np.stack([_speckle(session, seed) for seed in range(3)])
    figures = measure_image(session.document, luminance[..., None] * D65_WHITE, np.ones((48, 64, 3)), lasers)
    assert figures.region is not None and figures.region.contrast == pytest.approx(1.0, abs=0.2)
    assert figures.profile is not None and figures.profile.values[:, 0] == pytest.approx(luminance[0, :11])
    assert figures.profile.distance_m[-1] == pytest.approx(10 * 4e-6), "samples are half of an 8 µm pixel"
    assert figures.curve is not None and len(figures.curve.measured) == 3
    assert figures.histogram is not None and figures.problem == ""


def test_a_dark_region_is_told(session: EditingSession) -> None:
    figures = measure_image(session.document, np.zeros((48, 64, 3)))
    assert figures.region is None and "light" in figures.problem


def test_only_the_newest_image_is_measured(session: EditingSession, monkeypatch: pytest.MonkeyPatch) -> None:
    begun, goes_on = Event(), Event()

    def slow(*args: Any) -> ImageMeasurements:
        begun.set()
        assert goes_on.wait(PATIENCE_S)
        return measure_image(*args)

    monkeypatch.setattr("holoview.viewer.document.measurements.measure_image", slow)
    means: list[float] = []
    live = LiveMeasurement(session, lambda: means.append(live.measurements.region.mean))  # type: ignore[union-attr]
    live.request(session.document, np.ones((48, 64, 3)))
    assert begun.wait(PATIENCE_S)
    for mean in range(2, 30):
        live.request(session.document, np.ones((48, 64, 3)) * mean)
    goes_on.set()
    wait_until(lambda: not live.is_busy, session.poll)
    assert means == [1, 29]
    live.close()


def test_it_is_busy_until_the_owner_has_the_result(session: EditingSession) -> None:
    """Whoever waits for the end finds the result there."""
    taken: list[int] = []
    delivered: Queue[Callable[[], None]] = Queue()
    task: LatestTask[int] = LatestTask("test", delivered.put, session.messages.post_error)
    assert not task.is_busy
    task.submit(lambda: 7, taken.append)
    hand_over = delivered.get(timeout=PATIENCE_S)
    assert task.is_busy and taken == []
    hand_over()
    assert taken == [7] and not task.is_busy
    task.close()


def test_a_failure_is_told_and_the_next_request_is_served(session: EditingSession) -> None:
    taken: list[int] = []
    newest: LatestTask[int] = LatestTask("test", session.call_on_owner, session.messages.post_error)
    failed = Event()

    def fail() -> int:
        failed.set()
        raise RuntimeError("oops")

    newest.submit(fail, taken.append)
    assert failed.wait(PATIENCE_S)
    newest.submit(lambda: 7, taken.append)
    wait_until(lambda: taken, session.poll)
    newest.close()
    assert taken == [7] and "oops" in session.messages.all[0].text
