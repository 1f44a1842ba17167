"""A field in the viewer: its pages, the values under the pointer, the other side, and panels without sense for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from holoview.holograms.fields.reading import ReadRequest
from holoview.light.engine.torch_executor import stage_field
from holoview.viewer.app.panels.image import ImagePanel
from holoview.viewer.app.panels.view_settings import ViewPanel
from holoview.viewer.render.tone_mapping import field_picture
from holoview.viewer.render.view_settings import NOW
from tests.gui.conftest import Gui, small_bench
from tests.patience import PATIENCE_S, wait_until

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


def test_what_a_field_is_a_sample_of_stands_beside_its_scale(make_gui: Callable[..., Gui]) -> None:
    effects = {"second_line": {"share": 0.25, "offset": "4 nm"}}
    gui = make_gui(small_bench(effects=effects), (700, 900), panels=(ViewPanel, ImagePanel))
    gui.session.edit_view("Look", page="field", stage="slm2", quantity="phase", solo=1)
    gui.draw_until_idle()
    seen = gui.context.page_images.seen_field
    assert seen is not None and seen.scale.startswith("slm2, 530 nm: ")
    assert seen.scale.endswith("one sample of 2 spectral lines, which add in intensity; it has 75 % of the light")


def test_a_field_is_looked_at_from_its_other_side_and_has_nothing_to_optimise(gui: Gui, tmp_path: Path) -> None:
    _open(gui, tmp_path)
    gui.click(gui.item_position("other side"))
    gui.draw_until_idle()
    assert gui.session.view_settings.plane_m == -2e-3
    for page in ("phase", "spectrum", "planes", "field"):
        gui.session.edit_view("Page", page=page)
        gui.draw_until_idle()
    assert not [message for message in gui.session.messages.all if message.kind == "error"]


@pytest.mark.long
def test_the_frames_of_a_field_are_stepped_through_and_played_by_the_pointer(
    make_gui: Callable[..., Gui], tmp_path: Path
) -> None:
    gui = make_gui(small_bench(), (700, 900), panels=(ViewPanel, ImagePanel))
    values = np.zeros((3, 1, 64, 96), np.complex64)
    for frame in range(3):  # a bright bar that moves
        values[frame, 0, :, 10 + 30 * frame : 20 + 30 * frame] = 1 + frame
    np.save(tmp_path / "film.npy", values)
    gui.context.loader.open(tmp_path / "film.npy", replace(REQUEST, wavelengths_m=(530e-9,), distance_m=0.0))
    assert gui.session.wait_until_idle(PATIENCE_S)
    gui.draw_until_idle()

    def lit() -> NDArray[np.float32]:
        """Light of the columns of the three bars, after the full image is there."""
        gui.draw_until_idle()
        xyz = gui.context.side_renderers.xyz(NOW)
        assert xyz is not None
        return np.array([xyz[:, 10 + 30 * bar : 20 + 30 * bar, 1].mean() for bar in range(3)])

    mean = lit()
    assert mean / mean[0] == pytest.approx([1, 4, 9], rel=1e-3)
    gui.click(gui.item_position("frame alone"))
    first = lit()
    assert first[0] == pytest.approx(3 * mean[0], rel=1e-3) and first[1:].max() <= 1e-4 * first[0]
    gui.click(gui.item_position("frame", 0.66, 0.5))  # its label is a part of the slider
    last = lit()
    assert gui.session.view_settings.frame == 2 and last[2] == pytest.approx(3 * mean[2], rel=1e-3)
    steps = gui.session.history_position
    gui.click(gui.item_position("play frames"))
    seen: set[int] = set()

    def show_one() -> None:
        gui.draw_frames(1)
        seen.add(gui.session.view_settings.frame)

    wait_until(lambda: len(seen) == 3, show_one, 0.01)
    gui.click(gui.item_position("play frames"))
    gui.draw_frames(2)
    stopped = gui.session.view_settings.frame
    gui.draw_until_idle()
    assert gui.session.view_settings.frame == stopped and gui.session.history_position <= steps + 1
    gui.click(gui.item_position("frame alone"))
    assert lit() == pytest.approx(mean, rel=1e-3)
