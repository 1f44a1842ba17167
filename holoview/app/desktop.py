"""What a window on a screen shares with other programs: dropped files, and the clipboard's text."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from imgui_bundle import imgui

from holoview.app.app import App


def connect_desktop(app: App, glfw: Any, window: Any) -> None:
    """Takes files that are dropped on a GLFW window; copying and pasting text goes to other programs and back."""
    glfw.set_drop_callback(window, partial(_take_drop, app))
    platform = imgui.get_platform_io()
    platform.platform_set_clipboard_text_fn = lambda context, text: glfw.set_clipboard_string(window, text)
    platform.platform_get_clipboard_text_fn = lambda context: _text(glfw.get_clipboard_string(window))


def _take_drop(app: App, window: Any, paths: Sequence[str]) -> None:
    app.attempt(app.loader.open, list(paths) if len(paths) > 1 else paths[0])


def _text(found: bytes | None) -> str:
    return "" if found is None else found.decode("utf-8", "replace")
