"""A scrub of the focal plane: a full frame is shown at once where it is fast, else after a quick one and a pause."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from holoview.holograms.view import random_drive
from holoview.light.gpu.device import Device
from holoview.viewer.app.script import measure_frame_rate
from holoview.viewer.render import progressive_renderer
from holoview.viewer.render.progressive_renderer import ProgressiveRenderer
from holoview.viewer.render.scene import Scene
from tests.gui.conftest import MakeRenderer, small_bench

pytestmark = pytest.mark.gpu


def _rendered(make_renderer: MakeRenderer) -> tuple[ProgressiveRenderer, Scene]:
    """A renderer that has measured how long a full frame takes."""
    system = small_bench(shape=[16, 24])
    scene = Scene(system, random_drive(system), 9e-3)
    renderer = make_renderer()
    renderer.request(scene)
    while renderer.is_busy:
        renderer.compute_slice()
    return renderer, scene


def test_a_fast_full_frame_follows_an_edit_without_a_pause(
    make_renderer: MakeRenderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    renderer, scene = _rendered(make_renderer)
    monkeypatch.setattr(progressive_renderer, "QUICK_FRAME_ABOVE_S", float("inf"))
    monkeypatch.setattr(progressive_renderer, "IDLE_BEFORE_FULL_S", float("inf"))
    for plane_m in (9.5e-3, 1e-2):
        renderer.request(replace(scene, plane_m=plane_m))
        assert renderer.is_busy and renderer.wait_s == 0
        while renderer.is_busy:
            renderer.compute_slice()
        assert renderer.is_fresh and renderer.picture is not None and not renderer.picture.is_quick


def test_a_slow_full_frame_waits_for_a_pause_after_the_quick_one(
    make_renderer: MakeRenderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    renderer, scene = _rendered(make_renderer)
    monkeypatch.setattr(progressive_renderer, "QUICK_FRAME_ABOVE_S", 0.0)
    monkeypatch.setattr(progressive_renderer, "IDLE_BEFORE_FULL_S", 1000.0)
    renderer.request(replace(scene, plane_m=1e-2))
    before = renderer.picture
    while renderer.wait_s == 0:
        renderer.compute_slice()
    assert renderer.picture is not before and renderer.picture is not None and renderer.picture.is_quick
    assert renderer.is_busy and renderer.wait_s > 900


def test_edits_that_come_with_every_slice_are_shown_all_the_same(
    make_renderer: MakeRenderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a drag makes them: a quick frame that was begun is shown, and then that of the newest edit."""
    renderer, scene = _rendered(make_renderer)
    monkeypatch.setattr(progressive_renderer, "QUICK_FRAME_ABOVE_S", 0.0)
    monkeypatch.setattr(progressive_renderer, "SLICE_S", 0.0)  # a submission each
    monkeypatch.setattr(progressive_renderer, "IDLE_BEFORE_FULL_S", 1000.0)
    shown, last, edits = 0, renderer.picture, 60
    for number in range(edits):
        renderer.request(replace(scene, plane_m=9e-3 + 1e-5 * (number + 1)))
        renderer.compute_slice()
        assert not renderer.follows or renderer.picture is not last
        shown, last = shown + (renderer.picture is not last), renderer.picture
    assert 3 <= shown < edits, "a quick frame takes some slices"
    while not renderer.follows:
        renderer.compute_slice()
    newest = replace(scene, plane_m=9e-3 + 1e-5 * edits)
    renderer.request(newest)
    assert renderer.follows, "the newest edit is what is shown: there was nothing to request"


def test_after_edits_of_an_amplitude_the_picture_at_rest_is_that_of_a_new_renderer(
    device: Device, make_renderer: MakeRenderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    renderer, scene = _rendered(make_renderer)
    monkeypatch.setattr(device, "info", replace(device.info, kind="CPU"))
    monkeypatch.setattr(progressive_renderer, "QUICK_FRAME_ABOVE_S", float("inf"))
    monkeypatch.setattr(progressive_renderer, "IDLE_BEFORE_FULL_S", 1000.0)
    amplitudes = scene.system.amplitudes.copy()
    for factor in (0.5, 0.7):
        amplitudes[0, 0] *= factor
        edited = replace(scene, system=scene.system.edit({"amplitudes": amplitudes}))
        renderer.request(edited)
        while renderer.wait_s == 0:
            renderer.compute_slice()
        assert renderer.is_busy and renderer.follows and renderer.progress == 1.0
        shown = renderer.shown_xyz()
    monkeypatch.setattr(progressive_renderer, "IDLE_BEFORE_FULL_S", 0.0)
    while renderer.is_busy:
        renderer.compute_slice()
    fresh = make_renderer()
    fresh.request(edited)
    while fresh.is_busy:
        fresh.compute_slice()
    expected = fresh.xyz()
    assert expected is not None and shown is not None
    assert np.array_equal(renderer.xyz(), expected)
    assert np.allclose(shown, expected, rtol=2 * (len(amplitudes[0]) + 1) * 2.0**-24, atol=0.0)


def test_the_frame_rate_is_that_of_the_images_drawn(device: Device) -> None:
    found = measure_frame_rate(small_bench(shape=[16, 24]), device, (320, 200), rounds=2, limit_s=60.0)
    assert found["rounds"] == 2 and found["size"] == [48, 32] and found["wavelengths"] == 3
    assert found["scrub_images_per_s"] > 0
    assert min(found["window_ms"], found["scrub_ms"], found["full_ms"]) > 0
