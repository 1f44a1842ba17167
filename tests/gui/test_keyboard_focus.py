"""Every panel and its widgets are reached by keys alone, with a frame to be seen; other keys stay commands."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from imgui_bundle import hello_imgui, imgui

from holoview.evidence.sweep.in_viewer import sweep_document
from holoview.viewer.app import theme
from tests.gui.conftest import Gui

pytestmark = pytest.mark.gpu


def press(gui: Gui, *chords: str) -> None:
    for chord in chords:
        gui.press_chord(chord)
        gui.process_frames(6)


def open_titles(gui: Gui) -> list[str]:
    docking = hello_imgui.get_runner_params().docking_params
    titles = [guarded.panel.title for guarded in gui.app.panels]
    return [title for title in titles if docking.dockable_window_of_name(title).is_visible]


@pytest.mark.explores
def test_f6_reaches_every_open_panel_and_tab_its_widgets(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(None, (1280, 800))
    gui.session.sweeper = sweep_document
    for guarded in gui.app.panels:
        gui.context.show_panel(guarded.panel.title)
    gui.draw_until_idle()
    titles, without = open_titles(gui), set()
    assert len(titles) > 10
    for title in titles:
        press(gui, "F6")
        assert gui.app.keyboard_focus.panel == title
        if not imgui.get_io().nav_visible:
            press(gui, "Down")
        if not imgui.get_io().nav_visible:
            without.add(title)
    # pictures and lists of sentences have nothing to operate; what they do by the pointer, commands and panels do too
    assert without <= {"Image", "Drawing", "Point", "Sections", "Recording", "Rig diagnosis", "Camera"}
    press(gui, "F6")
    assert gui.app.keyboard_focus.panel == titles[0]
    press(gui, "Shift+F6")
    assert gui.app.keyboard_focus.panel == titles[-1]


def test_widgets_are_operated_and_escape_gives_the_keys_back(gui: Gui) -> None:
    view = gui.session.view_settings
    press(gui, "F6", "F6", "F6")
    assert gui.app.keyboard_focus.panel == "Effects"
    press(gui, "Down", "Space")
    assert len(gui.session.system.effects) == 1  # the box of the first effect
    assert gui.session.view_settings.plane_m == view.plane_m  # arrows and Space were the panel's
    press(gui, "E")
    assert gui.session.view_settings.exposure_stops > view.exposure_stops  # letters stay commands
    press(gui, "Escape")
    assert not gui.app.keyboard_focus.is_on
    press(gui, "Right")
    assert gui.session.view_settings.plane_m != view.plane_m


def test_a_click_ends_it_and_the_image_leaves_the_arrows_to_commands(gui: Gui) -> None:
    press(gui, "F6")
    assert gui.app.keyboard_focus.panel == "Image" and gui.app.keyboard_focus.is_on
    before = gui.session.view_settings.plane_m
    press(gui, "Right")
    assert gui.session.view_settings.plane_m != before
    press(gui, "F6")
    assert gui.app.keyboard_focus.is_on_widget
    gui.click(gui.item_position("image"))
    gui.process_frames(3)
    assert not gui.app.keyboard_focus.is_on


def test_the_frame_is_seen_in_both_themes(gui: Gui) -> None:
    """WCAG 2.2, 1.4.11: a contrast of 3 to the ground and to the fields that it stands around."""
    for name in theme.THEMES:
        theme.apply(name)
        style = imgui.get_style()
        frame = _luminance(style.color_(imgui.Col_.nav_cursor))
        for ground in (imgui.Col_.window_bg, imgui.Col_.frame_bg):
            pair = sorted((frame, _luminance(style.color_(ground))))
            assert (pair[1] + 0.05) / (pair[0] + 0.05) >= 3, (name, ground)


def _luminance(colour: imgui.ImVec4) -> float:
    parts = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in list(colour)[:3]]
    return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2]


def test_the_sheet_of_keys_takes_escape_before_the_focus_of_a_panel(gui: Gui) -> None:
    press(gui, "F6", "F6", "?", "Escape")
    assert not gui.context.help_overlay.page and gui.app.keyboard_focus.is_on
    press(gui, "Escape")
    assert not gui.app.keyboard_focus.is_on
