"""Fonts and colours of the viewer, and display colours of laser wavelengths."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache

import numpy as np
from imgui_bundle import hello_imgui, imgui

from holoview.light.colour import gamut_map, observer_weights, srgb_encode, xyz_to_linear_srgb
from holoview.viewer.app.fonts import advice, fonts_of_scripts

THEMES = ("Dark", "Light")
FONT_PIXELS = 15.0
_BASES = {"Dark": hello_imgui.ImGuiTheme_.darcula_darker, "Light": hello_imgui.ImGuiTheme_.light_rounded}
TEXT_SIZES = (0.85, 1.0, 1.25, 1.5, 2.0)
"""Sizes of text that can be chosen, as multiples of the usual one."""
_TAB_PX = 80.0  # to which tabs shrink where they have no room, in text of the usual size
_SIGNALS = {
    "Dark": {"accent": (0.30, 0.62, 0.95), "warning": (0.95, 0.70, 0.25), "error": (1.0, 0.45, 0.40)},
    "Light": {"accent": (0.04, 0.36, 0.68), "warning": (0.54, 0.35, 0.0), "error": (0.70, 0.15, 0.12)},
}
_ON_LIGHT = 0.55  # of the parts of a colour of curves, in the light theme
DIALOG = imgui.WindowFlags_.always_auto_resize | imgui.WindowFlags_.no_saved_settings | imgui.WindowFlags_.no_docking
CARD = DIALOG | imgui.WindowFlags_.no_collapse | imgui.WindowFlags_.no_move
"""Flags of a dialog, which takes the size of its content, and of a card, which also stays in its place."""


def load_fonts() -> None:
    """Loads Roboto, Inconsolata for arrows and subscripts that Roboto lacks, and fonts of this machine for names.

    Names of files may be in any script. Glyphs are made when they are first drawn, so that large fonts cost nothing.
    """
    hello_imgui.load_font("fonts/Roboto/Roboto-Regular.ttf", FONT_PIXELS)
    rest = hello_imgui.FontLoadingParams()
    rest.merge_to_last_font = True
    hello_imgui.load_font("fonts/Inconsolata-Medium.ttf", FONT_PIXELS, rest)
    own = hello_imgui.FontLoadingParams()
    own.merge_to_last_font, own.inside_assets = True, False
    for path in fonts_of_scripts():
        hello_imgui.load_font(str(path), FONT_PIXELS, own)


def font_advice(names: Iterable[str]) -> str:
    """What to do about signs of names that no loaded font has, in a sentence; "" where all are drawn."""
    font, signs = imgui.get_io().fonts.fonts[0], set("".join(names))
    return advice("".join(sign for sign in signs if not (sign.isascii() or font.is_glyph_in_font(ord(sign)))))


def signal_colour(name: str) -> imgui.ImVec4:
    """The colour "accent", "warning" or "error" on the present ground, where text in it has a contrast above 4.5."""
    ground = imgui.get_style().color_(imgui.Col_.window_bg)
    return imgui.ImVec4(*_SIGNALS["Light" if ground.x > 0.5 else "Dark"][name], 1.0)


def curve_colour(colour: imgui.ImVec4) -> imgui.ImVec4:
    """A colour of curves and their names that suits a dark ground; on the light one darker, so that it is read."""
    if imgui.get_style().color_(imgui.Col_.window_bg).x < 0.5:
        return colour
    return imgui.ImVec4(_ON_LIGHT * colour.x, _ON_LIGHT * colour.y, _ON_LIGHT * colour.z, 1.0)


def apply(name: str, text_size: float = 1.0) -> None:
    """Applies a theme of THEMES. text_size: of text, and what has its size, as a multiple of the usual one."""
    hello_imgui.apply_theme(_BASES[name])
    style = imgui.get_style()
    style.font_scale_main = text_size
    style.frame_rounding = style.grab_rounding = style.tab_rounding = 3.0
    style.window_rounding = style.popup_rounding = 4.0
    style.window_padding, style.frame_padding = imgui.ImVec2(8, 6), imgui.ImVec2(6, 3)
    style.item_spacing = imgui.ImVec2(6, 5)
    style.tab_min_width_shrink = _TAB_PX if text_size <= 1.0 else float(np.finfo(np.float32).max)  # else they scroll
    style.tab_close_button_min_width_unselected = float(np.finfo(np.float32).max)  # a click on a tab never closes it
    ground = imgui.ImVec4(0.11, 0.115, 0.125, 1.0) if name == "Dark" else imgui.ImVec4(0.97, 0.97, 0.97, 1.0)
    style.set_color_(imgui.Col_.popup_bg, ground)
    style.set_color_(imgui.Col_.window_bg, ground)
    bar = imgui.ImVec4(0.07, 0.09, 0.13, 1.0) if name == "Dark" else imgui.ImVec4(0.86, 0.88, 0.92, 1.0)
    for colour in (imgui.Col_.title_bg, imgui.Col_.title_bg_active):
        style.set_color_(colour, bar)
    style.frame_border_size = style.popup_border_size = style.window_border_size = 1.0
    if name == "Dark":
        style.set_color_(imgui.Col_.frame_bg, imgui.ImVec4(0.165, 0.175, 0.195, 1.0))
        style.set_color_(imgui.Col_.border, imgui.ImVec4(0.30, 0.31, 0.34, 1.0))
    else:
        style.set_color_(imgui.Col_.frame_bg, imgui.ImVec4(1.0, 1.0, 1.0, 1.0))
        style.set_color_(imgui.Col_.border, imgui.ImVec4(0.53, 0.54, 0.56, 1.0))
    grab = ((0.24, 0.34, 0.50), (0.26, 0.42, 0.66)) if name == "Dark" else ((0.66, 0.78, 0.93), (0.52, 0.70, 0.93))
    for colour, value in zip((imgui.Col_.slider_grab, imgui.Col_.slider_grab_active), grab, strict=True):
        style.set_color_(colour, imgui.ImVec4(*value, 1.0))  # the value is written across it
    style.set_color_(imgui.Col_.nav_cursor, signal_colour("accent"))
    ink, pale = ((0.92, 0.93, 0.94), (0.66, 0.68, 0.70)) if name == "Dark" else ((0.08, 0.08, 0.09), (0.36, 0.37, 0.39))
    style.set_color_(imgui.Col_.text, imgui.ImVec4(*ink, 1.0))
    style.set_color_(imgui.Col_.text_disabled, imgui.ImVec4(*pale, 1.0))


# --- Display colours of laser wavelengths, for drawing ---


_MIN_COMPONENT = 0.25  # keeps deep red and violet visible
EYE_RANGE_M = (390e-9, 830e-9)
"""The wavelengths of the cone fundamentals."""


@cache
def laser_colour(wavelength_m: float, opacity: float = 1.0) -> imgui.ImVec4:
    """A colour of about the hue of a wavelength, mapped into the sRGB gamut; grey outside the visible range."""
    if not EYE_RANGE_M[0] <= wavelength_m <= EYE_RANGE_M[1]:
        return imgui.ImVec4(0.6, 0.6, 0.6, opacity)
    linear = xyz_to_linear_srgb(observer_weights("eye", [wavelength_m])[0])
    bright = gamut_map(linear / max(float(np.max(linear)), 1e-9))
    red, green, blue = (max(float(srgb_encode(x)), _MIN_COMPONENT) for x in bright)
    return imgui.ImVec4(red, green, blue, opacity)
