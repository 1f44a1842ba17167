"""An off-axis recording in the viewer: its order on its spectrum, dragged, and the field that follows."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from holoview.holograms.fields.demodulation import off_axis_field
from holoview.holograms.files.request import Order, ReadRequest
from holoview.viewer.app.panels.image import ImagePanel
from holoview.viewer.app.panels.recording import RecordingPanel
from tests.gui.conftest import Gui, small_bench

pytestmark = pytest.mark.gpu

SHAPE, CARRIER = (120, 160), (0.15, 0.2)
REQUEST = ReadRequest(
    pitch_m=(8e-6, 8e-6), wavelengths_m=(532e-9,), distance_m=2e-3, recording="off-axis", conjugated=False
)


@pytest.fixture
def gui(make_gui: Callable[..., Gui], tmp_path: Path) -> Gui:
    """A viewer of the recording of a lens, whose fringes are those of a tilted reference."""
    opened = make_gui(small_bench(), (700, 900), panels=(RecordingPanel, ImagePanel))
    y, x = np.meshgrid(*(np.arange(n) - (n - 1) / 2 for n in SHAPE), indexing="ij")
    lens = np.exp(-1j * math.pi * (x**2 + y**2) * (8e-6) ** 2 / (532e-9 * 40e-3))
    light = np.abs(lens + np.exp(-2j * math.pi * (CARRIER[0] * y + CARRIER[1] * x))) ** 2
    Image.fromarray(np.rint(60 * light).astype(np.uint8)).save(tmp_path / "fringes.png")
    opened.context.loader.open(tmp_path / "fringes.png", REQUEST)
    assert opened.session.wait_until_idle(60)
    opened.draw_until_idle()
    return opened


def order_of(gui: Gui) -> Order:
    recorded = gui.session.document.recorded
    assert recorded is not None
    return recorded.recording.orders[0]


def place_of(gui: Gui, frequency: tuple[float, float]) -> tuple[float, float]:
    """The place on the screen of a frequency (y, x), cycles a pixel."""
    return gui.item_position("recording", 0.5 + frequency[1], 0.5 + frequency[0])


def test_the_panel_opens_with_a_recording_and_shows_its_order(gui: Gui) -> None:
    assert "recording" in gui.context.item_rects
    assert order_of(gui).carrier == pytest.approx(CARRIER, abs=0.005)


def test_a_drag_moves_the_order_and_the_image_follows_in_one_step_of_undo(gui: Gui) -> None:
    session, found = gui.session, order_of(gui)
    recorded, before, steps = session.document.recorded, session.drive, session.history_position
    assert recorded is not None
    gui.drag(place_of(gui, found.carrier), place_of(gui, (found.carrier[0] + 0.05, found.carrier[1] - 0.05)))
    gui.draw_until_idle()
    moved = order_of(gui)
    item = gui.context.item_rects["recording"]
    pixel = 1 / (item[2] - item[0])  # cycles a pixel of the recording, for a pixel of the screen
    assert moved.carrier == pytest.approx((found.carrier[0] + 0.05, found.carrier[1] - 0.05), abs=2 * pixel)
    assert moved.radius == found.radius
    expected = off_axis_field(recorded.recording, [moved]).field.values
    np.testing.assert_array_equal(session.drive, expected)
    assert session.history_position == steps + 1
    session.undo()
    assert session.drive is before and order_of(gui) is found


def test_a_drag_is_one_step_of_undo_where_fields_are_slower_than_the_hand(gui: Gui) -> None:
    steps, (y, x) = gui.session.history_position, order_of(gui).carrier
    gui.move(place_of(gui, (y, x)))
    gui.draw_frames(2)
    gui.press_button()
    for shift in (0.02, 0.04):
        gui.move(place_of(gui, (y + shift, x)))
        gui.draw_until_idle()
    gui.move(place_of(gui, (y + 0.06, x)))
    gui.release_button()  # while the last field is computed, or after it
    gui.draw_until_idle()
    assert order_of(gui).carrier[0] > y + 0.05
    assert gui.session.history_position == steps + 1


def test_the_edge_of_the_circle_changes_its_radius(gui: Gui) -> None:
    found = order_of(gui)
    edge = (found.carrier[0], found.carrier[1] + found.radius)
    gui.drag(place_of(gui, edge), place_of(gui, (edge[0], edge[1] + 0.03)))
    gui.draw_until_idle()
    moved = order_of(gui)
    assert moved.carrier == found.carrier and moved.radius == pytest.approx(found.radius + 0.03, abs=0.01)
    gui.click(gui.item_position("other side of the recording"))
    gui.draw_until_idle()
    assert order_of(gui).carrier == pytest.approx((-found.carrier[0], -found.carrier[1]))
    gui.click(gui.item_position("find the order"))
    gui.draw_until_idle()
    assert order_of(gui).radius == pytest.approx(found.radius)


def test_phase_steps_are_recognised_and_another_kind_can_be_chosen(gui: Gui, tmp_path: Path) -> None:
    session = gui.session
    y, x = np.meshgrid(*(np.arange(n) - (n - 1) / 2 for n in SHAPE), indexing="ij")
    wave = np.exp(1j * math.pi * (x**2 + y**2) * (8e-6) ** 2 / (532e-9 * 40e-3))
    names = [tmp_path / f"step{n}.png" for n in range(4)]
    for n, name in enumerate(names):
        Image.fromarray(np.rint(25 * np.abs(wave + 2 * 1j**n) ** 2).astype(np.uint8)).save(name)
    gui.context.loader.open(names, replace(REQUEST, recording=None))
    assert session.wait_until_idle(60)
    gui.draw_until_idle()
    recorded, drive = session.document.recorded, session.drive
    assert recorded is not None and recorded.recording.kind == "phase-shifting"
    gui.click(gui.item_position("other side of the recording"))
    gui.draw_until_idle()
    np.testing.assert_allclose(session.drive, np.conj(drive), atol=1e-6 * np.abs(drive).max())
    gui.context.recording_editor.find(kind="in-line")
    gui.draw_until_idle()
    assert session.document.recorded is not None and session.document.recorded.recording.kind == "in-line"
    assert session.system.drive_shape == session.drive.shape == (4, 1, *SHAPE)
    session.undo()
    assert session.drive.shape == (1, 1, *SHAPE)
    session.undo()
    assert session.document.recorded is recorded


def test_a_field_without_a_recording_takes_the_circle_away(gui: Gui) -> None:
    gui.session.edit("Another field", drive=np.ones_like(gui.session.drive))
    gui.draw_until_idle()
    assert gui.session.document.recorded is None and gui.context.recording_editor.chosen is None


def test_the_numbers_of_the_circle_are_typed(gui: Gui) -> None:
    left, top, right, bottom = gui.context.item_rects["numbers of the order"]
    before = order_of(gui)
    gui.click((left + 0.1 * (right - left), (top + bottom) / 2))
    gui.press_chord("Ctrl+A")
    gui.type_text("0.21")
    gui.press_chord("Enter")
    assert gui.session.wait_until_idle(60)
    gui.draw_until_idle()
    assert order_of(gui).carrier == pytest.approx((before.carrier[0], 0.21), abs=1e-4), "four digits are shown"
    assert order_of(gui).origin == "given"
