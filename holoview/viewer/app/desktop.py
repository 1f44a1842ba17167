"""Dropped files, and text and pictures of the clipboard, which the desktop gives a window."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from imgui_bundle import imgui
from numpy.typing import NDArray
from PIL import Image, ImageGrab

from holoview.util.errors import UserError
from holoview.viewer.app import theme
from holoview.viewer.app.context import AppContext
from holoview.viewer.document.exports import png_bytes


def connect_desktop(context: AppContext, glfw: Any, window: Any) -> None:
    """Opens files that are dropped on a GLFW window, and connects ImGui's text clipboard with the system's."""
    glfw.set_drop_callback(window, partial(_take_drop, context))
    platform = imgui.get_platform_io()
    platform.platform_set_clipboard_text_fn = lambda context, text: glfw.set_clipboard_string(window, text)
    platform.platform_get_clipboard_text_fn = lambda context: _decode(glfw.get_clipboard_string(window))


_USUAL_DPI, _SHARE, _MOST_DPI = 96.0, 0.9, 400.0  # projectors tell sizes that no screen has


def fit_text_size(context: AppContext, glfw: Any, window: Any) -> None:
    """Makes text larger on a dense screen of which the desktop tells no scale, unless the user has chosen its size."""
    monitor = glfw.get_primary_monitor()
    is_told = sys.platform != "linux" or tuple(glfw.get_window_content_scale(window)) != (1.0, 1.0)
    if is_told or not monitor or (context.store is not None and context.store.preferences.get("text_size", 0.0)):
        return
    context.text_size = text_size_for(
        glfw.get_video_mode(monitor).size.width, glfw.get_monitor_physical_size(monitor)[0]
    )
    theme.apply(context.theme, context.text_size)


def text_size_for(width_px: int, width_mm: int) -> float:
    """The size of text of `theme.TEXT_SIZES` on a screen of this width, somewhat smaller than on a usual screen.

    >>> text_size_for(1920, 527), text_size_for(3840, 597), text_size_for(3840, 344), text_size_for(1920, 0)
    (1.0, 1.5, 2.0, 1.0)
    """
    dpi = 25.4 * width_px / width_mm if width_mm else 0.0
    fitting = [size for size in theme.TEXT_SIZES if 1.0 <= size <= _SHARE * dpi / _USUAL_DPI]
    return max(fitting, default=1.0) if dpi <= _MOST_DPI else 1.0


def _take_drop(context: AppContext, window: Any, paths: Sequence[str]) -> None:
    context.attempt(context.loader.open, list(paths))


def _decode(text: bytes | None) -> str:
    return "" if text is None else text.decode("utf-8", "replace")


# --- Copies and pastes pictures with the system's clipboard; ImGui's own clipboard holds text only ---


_TIMEOUT_S = 5.0
_REMEDY = "install wl-clipboard (Wayland) or xclip (X11)"


def copy_picture(pixels: NDArray[np.uint8]) -> None:
    """Puts 8-bit sRGB pixels (y, x, 3) on the clipboard. Raises UserError without a usable clipboard."""
    png = png_bytes(pixels)
    if sys.platform in ("win32", "darwin"):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "picture.png"
            path.write_bytes(png)
            _run(_copy_file_command(path), b"")
    else:
        _run(_linux_copy_command(), png)


def paste_picture() -> NDArray[np.uint8] | None:
    """The clipboard's picture (y, x, 4) in 8-bit sRGB; None if it holds none. Raises UserError if it can't be read."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            content = ImageGrab.grabclipboard()
    except (NotImplementedError, OSError, ChildProcessError) as error:
        raise UserError("clipboard", f"can't be read: {error}", remedy=_REMEDY) from error
    return np.asarray(content.convert("RGBA")) if isinstance(content, Image.Image) else None


def _linux_copy_command() -> list[str]:
    if os.environ.get("WAYLAND_DISPLAY") and shutil.which("wl-copy"):
        return ["wl-copy", "--type", "image/png"]
    if os.environ.get("DISPLAY") and shutil.which("xclip"):
        return ["xclip", "-selection", "clipboard", "-t", "image/png", "-i"]
    raise UserError("clipboard", "there is none that takes pictures", remedy=f"{_REMEDY}, or save the view as PNG")


def _copy_file_command(path: Path) -> list[str]:
    if sys.platform == "darwin":
        return ["osascript", "-e", f'set the clipboard to (read (POSIX file "{path}") as «class PNGf»)']
    load = f"[System.Drawing.Image]::FromFile('{path}')"
    script = f"Add-Type -AssemblyName System.Windows.Forms,System.Drawing; [Windows.Forms.Clipboard]::SetImage({load})"
    return ["powershell", "-NoProfile", "-STA", "-Command", script]


def _run(command: list[str], data: bytes) -> None:
    """Runs a command. Its output is discarded, since xclip keeps the pipe open while it serves the selection."""
    try:
        done = subprocess.run(
            command, input=data, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=_TIMEOUT_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise UserError("clipboard", f"{command[0]} failed: {error}", remedy="save the view as PNG") from error
    if done.returncode != 0:
        raise UserError("clipboard", f"{command[0]} failed with {done.returncode}", remedy="save the view as PNG")
