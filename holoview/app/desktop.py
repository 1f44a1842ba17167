"""File drops on a GLFW window, and the text clipboard that it shares with other programs."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from imgui_bundle import imgui

from holoview.app.context import AppContext


def connect_desktop(context: AppContext, glfw: Any, window: Any) -> None:
    """Opens files that are dropped on a GLFW window, and connects ImGui's text clipboard with the system's."""
    glfw.set_drop_callback(window, partial(_take_drop, context))
    platform = imgui.get_platform_io()
    platform.platform_set_clipboard_text_fn = lambda context, text: glfw.set_clipboard_string(window, text)
    platform.platform_get_clipboard_text_fn = lambda context: _decode(glfw.get_clipboard_string(window))


def _take_drop(context: AppContext, window: Any, paths: Sequence[str]) -> None:
    context.attempt(context.loader.open, list(paths))


def _decode(text: bytes | None) -> str:
    return "" if text is None else text.decode("utf-8", "replace")
