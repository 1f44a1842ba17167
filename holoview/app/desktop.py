"""What a window on a screen shares with other programs: dropped files, and the clipboard's text."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from imgui_bundle import imgui

from holoview.app.context import AppContext


def connect_desktop(context: AppContext, glfw: Any, window: Any) -> None:
    """Takes files that are dropped on a GLFW window; copying and pasting text goes to other programs and back."""
    glfw.set_drop_callback(window, partial(_take_drop, context))
    platform = imgui.get_platform_io()
    platform.platform_set_clipboard_text_fn = lambda context, text: glfw.set_clipboard_string(window, text)
    platform.platform_get_clipboard_text_fn = lambda context: _text(glfw.get_clipboard_string(window))


def _take_drop(context: AppContext, window: Any, paths: Sequence[str]) -> None:
    context.attempt(context.loader.open, list(paths))


def _text(found: bytes | None) -> str:
    return "" if found is None else found.decode("utf-8", "replace")
