"""Input that comes faster than frames is answered to its end, without anything else having to happen."""

from __future__ import annotations

from typing import Any

import pytest

pytestmark = pytest.mark.gpu

TEXT = "compare_side_by_side 0123456789"


def test_fast_typing_is_taken_to_its_end_though_nothing_else_happens(gui: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    gui.key("Ctrl+P")
    gui.frames(5)
    for letter in TEXT:
        gui._submit("key_down", key=letter, modifiers=())
        gui._submit("char", data=letter, is_composing=False, input_type="insertText")
        gui._submit("key_up", key=letter, modifiers=())
    asked = [True]
    monkeypatch.setattr(gui.canvas, "request_draw", lambda *_: asked.append(True))
    frames = 0
    while asked and frames < 500:  # as a loop on demand does it: a frame only where one was asked for
        asked.clear()
        gui.frames()
        frames += 1
    assert gui.app.help.query == TEXT
