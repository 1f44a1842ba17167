"""A field in the viewer: its pages, the values under the pointer, the other side, and panels without sense for it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from holoview.engine.torch_executor import stage_field
from holoview.render.tone_mapping import field_picture
from holoview.wavefield.reading import ReadRequest
from tests.gui.conftest import Gui
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.gpu

REQUEST = ReadRequest(pitch_m=(8e-6, 8e-6), wavelengths_m=(620e-9, 530e-9), distance_m=2e-3)


def _open(gui: Gui, folder: Path) -> None:
    values = np.exp(2j * np.pi * np.random.default_rng(0).random((2, 64, 96))).astype(np.complex64)
    np.save(folder / "field.npy", values)
    gui.context.loader.open(folder / "field.npy", REQUEST)
    assert gui.session.wait_until_idle(PATIENCE_S)
    gui.draw_until_idle()


def test_the_field_itself_is_seen_with_its_values(gui: Gui, tmp_path: Path) -> None:
    _open(gui, tmp_path)
    gui.session.edit_view("Look", page="field", stage="plane", quantity="phase", solo=1, zoom=1.0)
    gui.draw_until_idle()
    session = gui.session
    field = stage_field(session.system, session.drive, "plane", 2e-3, laser=1)
    seen = gui.context.page_images.seen_field
    assert seen is not None
    np.testing.assert_array_equal(seen.values, field.values)
    expected = field_picture(field.values, "phase").srgb8.astype(int)
    shown = gui.context.displayed_pixels()
    assert shown is not None
    rows, columns = (n // 2 for n in shown.shape[:2])
    inside = shown[rows - 16 : rows + 16, columns - 16 : columns + 16].astype(int)
    offsets = [np.abs(inside - expected[y : y + 32, x : x + 32]).max() for y in range(14, 19) for x in range(30, 35)]
    assert min(offsets) <= 2  # the picture is drawn as it is, through XYZ in f32 and sRGB back


def test_a_field_is_looked_at_from_its_other_side_and_has_nothing_to_optimise(gui: Gui, tmp_path: Path) -> None:
    _open(gui, tmp_path)
    gui.click(gui.item_position("other side"))
    gui.draw_until_idle()
    assert gui.session.view_settings.plane_m == -2e-3
    for page in ("phase", "spectrum", "planes", "field"):
        gui.session.edit_view("Page", page=page)
        gui.draw_until_idle()
    assert not [message for message in gui.session.messages.all if message.kind == "error"]
