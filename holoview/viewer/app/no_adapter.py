"""The page that is shown when no WebGPU adapter is usable: the reason and what to do. It is drawn with OpenGL."""

from __future__ import annotations

import os
import sys

from imgui_bundle import hello_imgui, imgui

from holoview.util.errors import UserError
from holoview.viewer.app import theme

_SIZE = (640, 360)
REMEDIES = {
    "linux": (
        "NVIDIA: install the driver of your distribution (nvidia-driver); it brings Vulkan.",
        "AMD, Intel: apt install mesa-vulkan-drivers, or your distribution's package of Mesa's Vulkan drivers.",
        "No GPU: the same package has lavapipe, which computes on the processor.",
        "In a container: pass the GPU through, e.g. docker run --gpus all, with NVIDIA_DRIVER_CAPABILITIES=all.",
    ),
    "win32": ("Update the driver of your graphics card: it brings Direct3D 12 and Vulkan.",),
    "darwin": ("Metal comes with macOS: a Mac of 2012 or later with a present macOS has it.",),
}
"""Advice by platform."""


def show_no_adapter_page(error: UserError) -> bool:
    """Shows the page until it is closed; returns False if no window can be opened either."""
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return False
    params = hello_imgui.RunnerParams()
    params.app_window_params.window_title = "holoview"
    params.app_window_params.window_geometry.size = _SIZE
    params.ini_disable = True
    params.callbacks.load_additional_fonts = theme.load_fonts
    params.callbacks.default_icon_font = hello_imgui.DefaultIconFont.no_icons
    params.callbacks.setup_imgui_style = lambda: theme.apply(theme.THEMES[0])
    params.callbacks.show_gui = lambda: draw_page(error)
    try:
        hello_imgui.run(params)
    except RuntimeError:  # no OpenGL either
        return False
    return True


def draw_page(error: UserError) -> None:
    """Draws the content of the page in the present ImGui window."""
    imgui.push_text_wrap_pos(0.0)
    imgui.text_colored(theme.signal_colour("warning"), "No graphics adapter can be used")
    imgui.text(f"{error.where}: {error.found}.")
    if error.expected:
        imgui.text(f"The viewer needs {error.expected}.")
    imgui.separator_text("What to do")
    for remedy in REMEDIES.get(sys.platform, REMEDIES["linux"]):
        imgui.bullet()
        imgui.text_wrapped(remedy)
    imgui.bullet()
    imgui.text_wrapped("Everything but the viewer works without one: holoview render, optimise and demo use torch.")
    imgui.spacing()
    if imgui.button("Copy this"):
        imgui.set_clipboard_text(str(error))
    imgui.same_line()
    if imgui.button("Close"):
        hello_imgui.get_runner_params().app_shall_exit = True
    imgui.pop_text_wrap_pos()
