"""A target of another aspect in the window: said what is cut off; a frame that is dragged, and typed numbers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from imgui_bundle import imgui
from PIL import Image

from holoview.holograms.targets.framing import Framing
from tests.gui.conftest import Gui
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.gpu


@pytest.fixture
def gui(make_gui: Callable[..., Gui], tmp_path: Path) -> Gui:
    """A portrait, 100 × 200, on 96 × 64 pixels: two thirds of its height are cut off."""
    gui = make_gui(size=(1100, 1400))
    y = np.linspace(0, 255, 200)[:, None, None]
    picture = np.broadcast_to(y, (200, 100, 3)).astype(np.uint8)
    Image.fromarray(picture).save(tmp_path / "portrait.png")
    gui.context.loader.open(tmp_path / "portrait.png")
    assert gui.session.wait_until_idle(PATIENCE_S)
    gui.context.show_panel("Optimise")
    gui.draw_frames(4)
    gui.draw_until_idle()
    return gui


def _framing(gui: Gui) -> Framing:
    return gui.session.target_spec.placement.framing


def test_opening_says_what_is_cut_off(gui: Gui) -> None:
    texts = [message.text for message in gui.session.messages.all]
    assert any("cut off: 33 % above, 33 % below" in text for text in texts), texts
    assert "what is cut off" in gui.context.item_rects, "the panel says it too"


def test_the_frame_is_dragged_and_resized(gui: Gui) -> None:
    before = gui.session.target_at()
    gui.drag(gui.item_position("framed picture", 0.5, 0.5), gui.item_position("framed picture", 0.5, 0.75))
    framing = _framing(gui)
    assert framing.kind == "crop" and framing.share == 1 and framing.centre[1] == pytest.approx(0.75, abs=0.03)
    gui.draw_until_idle()
    after = gui.session.target_at()
    assert after.mean() > before.mean() + 0.1, "the picture is brighter below"
    gui.wheel(gui.item_position("framed picture", 0.5, 0.7), 2.0)
    assert _framing(gui).share == pytest.approx(0.81, abs=0.02)
    share, (left, top, right, bottom) = _framing(gui).share, gui.context.item_rects["framed picture"]
    middle = left + (right - left) * _framing(gui).centre[0], top + (bottom - top) * _framing(gui).centre[1]
    edge = middle[0] - share * (right - left) / 2, middle[1]
    gui.drag(edge, ((edge[0] + middle[0]) / 2, edge[1]))
    assert _framing(gui).share == pytest.approx(share / 2, rel=0.15)
    gui.press_chord("Ctrl+Z")
    assert _framing(gui).share == pytest.approx(share), "a drag is a step of undo"


def test_fit_shows_all_and_numbers_are_typed(gui: Gui) -> None:
    gui.session.edit("Framing", target_spec=gui.session.target_spec.with_framing(Framing("fit")))
    gui.draw_until_idle()
    target = gui.session.target_at()
    assert not target[:, : target.shape[1] // 4].any() and target[-1].max() > 0.9
    crop = gui.session.target_spec.with_framing(Framing("crop"))
    gui.session.edit("Framing", target_spec=crop)
    gui.draw_frames(3)
    gui.hold_keys(("Control",))
    gui.click(gui.item_position("framing size", 0.3))
    gui.release_keys(("Control",))
    gui.press_chord("Ctrl+A")
    gui.type_text("0.4")
    gui.press_chord("Enter")
    assert _framing(gui).share == pytest.approx(0.4)


def test_the_wheel_over_the_frame_leaves_the_panel_where_it_is(
    gui: Gui, make_gui: Callable[..., Gui], tmp_path: Path
) -> None:
    gui.app.close()
    small = make_gui(size=(1024, 700))
    small.context.loader.open(tmp_path / "portrait.png")
    assert small.session.wait_until_idle(PATIENCE_S)
    small.context.show_panel("Optimise")
    small.draw_frames(4)
    small.draw_until_idle()
    panel = imgui.internal.find_window_by_name("Optimise")
    imgui.internal.set_scroll_y(panel, panel.scroll_max.y)
    small.draw_frames(3)
    before = panel.scroll.y
    assert before > 0, "the panel has more than its room"
    small.wheel(small.item_position("framed picture", 0.5, 0.5), 2.0)
    assert _framing(small).share == pytest.approx(0.81, abs=0.02) and panel.scroll.y == before
