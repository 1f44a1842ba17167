"""Input that comes faster than frames is answered to its end, without anything else having to happen."""

from __future__ import annotations

import pytest

from holoview.viewer.app.panels.files import FilesPanel
from holoview.viewer.app.panels.focus import FocusPanel
from tests.gui.conftest import Gui

pytestmark = pytest.mark.gpu

TEXT = "compare_side_by_side 0123456789"


def test_fast_typing_is_taken_to_its_end_though_nothing_else_happens(gui: Gui, monkeypatch: pytest.MonkeyPatch) -> None:
    gui.press_chord("Ctrl+P")
    gui.draw_frames(5)
    for letter in TEXT:
        gui.submit_event("key_down", key=letter, modifiers=())
        gui.submit_event("char", data=letter, is_composing=False, input_type="insertText")
        gui.submit_event("key_up", key=letter, modifiers=())
    _draw_on_demand(gui, monkeypatch)
    assert gui.context.help_overlay.query == TEXT


def test_a_drag_within_one_frame_is_the_whole_drag(gui: Gui, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where frames take longer than a hand moves."""
    (x, y), (x1, y1) = gui.item_position("image", 0.3, 0.3), gui.item_position("image", 0.7, 0.7)
    gui.move((x, y))
    gui.submit_event("key_down", key="Shift", modifiers=())
    gui.submit_event("pointer_down", x=x, y=y, button=1, buttons=(1,), modifiers=(), ntouches=0, touches={})
    gui.submit_event("pointer_move", x=x1, y=y1, button=0, buttons=(1,), modifiers=(), ntouches=0, touches={})
    gui.submit_event("pointer_up", x=x1, y=y1, button=1, buttons=(), modifiers=(), ntouches=0, touches={})
    gui.submit_event("key_up", key="Shift", modifiers=())
    _draw_on_demand(gui, monkeypatch)
    assert gui.session.view_settings.region is not None
    assert min(gui.session.view_settings.region[2:]) > 10


@pytest.mark.parametrize("seen_early", [False, True])
def test_a_chord_let_go_before_a_frame_keeps_its_modifier(
    gui: Gui, monkeypatch: pytest.MonkeyPatch, seen_early: bool
) -> None:
    """However the keys of a quick Ctrl+S, and of the S after it, fall on frames: one saves, the other compares."""
    gui.submit_event("key_down", key="Control", modifiers=("Control",))
    if seen_early:
        gui.draw_frames()
    for kind, key in (("key_down", "s"), ("key_up", "Control"), ("key_up", "s")):
        gui.submit_event(kind, key=key, modifiers=())
    _draw_on_demand(gui, monkeypatch)
    assert gui.app.panel(FilesPanel).dialog.is_open
    assert gui.session.view_settings.compare == "off"


def test_what_a_script_does_is_done_when_it_goes_on_however_slow_the_machine_is(
    gui: Gui, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where no time is left for frames that nobody sees, input would wait for frames to come."""
    monkeypatch.setattr("holoview.viewer.app.window._UNSEEN_S", -1.0)
    gui.click(gui.item_position("gap", 0.2))
    gui.press_chord("Space")
    assert gui.app.panel(FocusPanel).is_playing and not gui.app.window.has_pending_input
    gui.press_chord("Space")
    assert not gui.app.panel(FocusPanel).is_playing and not gui.app.window.has_pending_input


def test_a_letter_before_a_modifier_is_without_it(gui: Gui, monkeypatch: pytest.MonkeyPatch) -> None:
    for kind, key in (("key_down", "s"), ("key_down", "Control"), ("key_up", "s"), ("key_up", "Control")):
        gui.submit_event(kind, key=key, modifiers=())
    _draw_on_demand(gui, monkeypatch)
    assert not gui.app.panel(FilesPanel).dialog.is_open
    assert gui.session.view_settings.compare == "side-by-side"


def _draw_on_demand(gui: Gui, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a loop on demand does it: a frame only where one was asked for."""
    asked = [True]
    monkeypatch.setattr(gui.canvas, "request_draw", lambda *_: asked.append(True))
    frames = 0
    while asked and frames < 500:
        asked.clear()
        gui.draw_frames()
        frames += 1
