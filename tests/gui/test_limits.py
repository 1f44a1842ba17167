"""The status bar says where the model isn't true of the bench."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from holoview.holograms.fields.reading import ReadRequest
from tests.gui.conftest import Gui, small_bench
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.gpu


def test_the_status_bar_shows_limits_that_are_exceeded(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui()
    gui.draw_until_idle()
    assert gui.context.limit_notes.notes() == () and "limits" not in gui.context.item_rects
    gui.context.change("Sampling", "upsample", 1)
    gui.draw_frames(2)
    assert [note.split(":")[0] for note in gui.context.limit_notes.notes()] == ["samples a pixel"]
    assert "limits" in gui.context.item_rects
    gui.session.undo()
    gui.draw_frames(2)
    assert gui.context.limit_notes.notes() == ()


def test_a_bench_that_leaves_nothing_keeps_the_picture_and_says_why(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui()
    gui.draw_until_idle()
    before = gui.context.side_renderers.now.full_scene
    gui.context.change("Pitch", "pitch", "0.1 um")
    gui.draw_until_idle()
    assert "straight on" in gui.last_message()
    assert any(note.startswith("band left: ") for note in gui.context.limit_notes.notes())
    assert gui.context.side_renderers.now.full_scene is before
    gui.session.undo()
    gui.draw_until_idle()
    assert gui.context.limit_notes.notes() == ()


def test_an_optimisation_that_switches_the_only_laser_shown_off_leaves_the_window_alive(
    make_gui: Callable[..., Gui],
) -> None:
    gui = make_gui()
    gui.draw_until_idle()
    gui.session.edit_view("Solo", solo=0)
    document = gui.session.document
    dark = document.system.edit({"amplitudes": [0.0, 1.0, 1.0]})
    gui.session.set_preview(document, dataclasses.replace(document, system=dark))
    gui.draw_frames(3)
    assert "none is left on" in gui.context.limit_notes.notes()[0] and "limits" in gui.context.item_rects
    gui.session.set_preview(None)
    gui.draw_until_idle()
    assert gui.app.window.error is None and gui.context.limit_notes.notes() == ()


def test_limits_are_found_out_once_for_each_bench(
    make_gui: Callable[..., Gui], monkeypatch: pytest.MonkeyPatch
) -> None:
    gui = make_gui(small_bench(upsample=1))
    notes = gui.context.limit_notes.notes()
    monkeypatch.setattr("holoview.viewer.document.measurements.make_plan", lambda *_: pytest.fail("planned again"))
    gui.draw_frames(3)
    assert gui.context.limit_notes.notes() is notes


def test_the_light_of_a_field_that_leaves_the_picture_is_told(make_gui: Callable[..., Gui], tmp_path: Path) -> None:
    gui = make_gui()
    x = np.arange(64) - 31.5
    beam = np.exp(-(x[:, None] ** 2 + x**2) / 12**2 + 0.3j * np.pi * x)  # tilted: 0.15 turns a sample
    np.save(tmp_path / "tilted.npy", beam.astype(np.complex64))
    request = ReadRequest((4e-6, 4e-6), (532e-9,), 8e-3, propagation="asm")
    gui.context.loader.open(tmp_path / "tilted.npy", request)
    assert gui.session.wait_until_idle(PATIENCE_S)
    gui.draw_until_idle()
    gui.draw_frames(2)
    assert [note for note in gui.context.limit_notes.known if note.startswith("light in the picture: ")]
    gui.session.edit_view("Plane", plane_m=0.0)
    gui.draw_until_idle()
    gui.draw_frames(2)
    assert not [note for note in gui.context.limit_notes.known if note.startswith("light in the picture: ")]
