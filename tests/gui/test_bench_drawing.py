"""The panel that draws the bench: a click opens the part's panel, a drag changes the gap in one step of undo."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from imgui_bundle import hello_imgui, imgui

from holoview.light.model.bench_drawing import draw_bench
from holoview.viewer.app.panels.drawing import DrawingPanel
from holoview.viewer.app.panels.element import ElementPanel
from holoview.viewer.app.panels.eye import EyePanel
from holoview.viewer.app.panels.image import ImagePanel
from holoview.viewer.app.panels.lasers import LasersPanel
from tests.gui.conftest import Gui, small_bench

pytestmark = pytest.mark.gpu

_PANELS = (DrawingPanel, ElementPanel, ImagePanel, LasersPanel, EyePanel)


@pytest.fixture
def gui(make_gui: Callable[..., Gui]) -> Gui:
    opened = make_gui(small_bench(), (1500, 700), panels=_PANELS)
    opened.context.commands.run("Draw the bench")
    opened.draw_until_idle()
    return opened


def place(gui: Gui, key: str) -> tuple[float, float]:
    """Where the first label of a key is on the screen."""
    drawing = draw_bench(gui.session.system)
    label = next(label for label in drawing.labels if label.key == key)
    return gui.item_position("bench drawing", label.x / drawing.width, label.y / drawing.height)


def is_open(title: str) -> bool:
    return bool(hello_imgui.get_runner_params().docking_params.dockable_window_of_name(title).is_visible)


def test_a_click_on_a_part_opens_its_panel(gui: Gui) -> None:
    for key, title in (("modulators.0", "Element"), ("wavelengths", "Lasers")):
        window = hello_imgui.get_runner_params().docking_params.dockable_window_of_name(title)
        window.is_visible = False
        gui.draw_until_idle()
        gui.click(place(gui, key))
        gui.draw_until_idle()
        assert is_open(title), key


def test_dragging_the_gap_changes_it_in_one_step_of_undo(gui: Gui) -> None:
    before = gui.session.system.gap_m
    assert before is not None
    x, y = place(gui, "gap")
    gui.drag((x, y), (x + 60, y))
    gui.draw_until_idle()
    # 300 pixels are a factor of ten; a drag begins after the pixels that tell it from a click, and is rounded to pixels
    assert gui.session.system.gap_m == pytest.approx(before * 10**0.2, rel=0.1)
    gui.session.undo()
    assert gui.session.system.gap_m == before


def test_it_is_painted(gui: Gui) -> None:
    left, upper, right, lower = (round(side) for side in gui.context.item_rects["bench drawing"])
    seen = gui.draw_frames()[upper : min(lower, 700), left : min(right, 1500), :3]
    assert np.mean(np.all(seen == 255, axis=-1)) > 0.3  # its ground is white
    for colour in ((0xCF, 0xE8, 0xD5), (0x27, 0x36, 0x4B), (0x8F, 0xB7, 0xDD)):  # light, a modulator, a lens
        assert np.any(np.all(np.abs(seen.astype(int) - colour) <= 3, axis=-1)), colour


@pytest.mark.parametrize("theme", ("Dark", "Light"))
def test_in_a_small_window_it_opens_at_a_length_and_scrolls_sideways_only(
    make_gui: Callable[..., Gui], theme: str
) -> None:
    gui = make_gui(small_bench(), (1024, 700))
    gui.context.set_theme(theme)
    gui.context.commands.run("Draw the bench")
    gui.draw_until_idle()
    gui.draw_frames(3)
    (strip,) = imgui.internal.find_window_by_name("Drawing").dc.child_windows
    assert strip.scroll_max.x > 0 and strip.scroll_max.y == 0
    drawing = draw_bench(gui.session.system)
    left, _, right, _ = next(box for key, box in drawing.areas if key == "gap")
    low, _ = gui.item_position("bench drawing", left / drawing.width, 0)
    high, _ = gui.item_position("bench drawing", right / drawing.width, 0)
    assert strip.pos.x <= low and high <= strip.pos.x + strip.size.x + 1  # whole pixels
