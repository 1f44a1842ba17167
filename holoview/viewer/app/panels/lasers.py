"""The panel of the lasers: a spectrum with draggable peaks and the cone fundamentals, and a table."""

from __future__ import annotations

from functools import partial

import numpy as np
from imgui_bundle import imgui, implot
from numpy.typing import NDArray

from holoview.light.colour import cone_fundamentals
from holoview.light.model import preset
from holoview.light.model.system import System
from holoview.viewer.app.context import AppContext
from holoview.viewer.app.panel import Panel
from holoview.viewer.app.theme import EYE_RANGE_M, curve_colour, laser_colour
from holoview.viewer.app.user_input import digit_pressed
from holoview.viewer.app.widgets import (
    coloured,
    command_button,
    fine_drag,
    fine_slider_int,
    room_for_labels,
    same_line_for,
    show_tooltip,
    tooltip,
)

_PLOT_RANGE_NM = (390.0, 720.0)
_EYE_RANGE_NM = (EYE_RANGE_M[0] * 1e9, EYE_RANGE_M[1] * 1e9)
_CONES = (
    ("L", imgui.ImVec4(1.0, 0.45, 0.40, 0.75)),
    ("M", imgui.ImVec4(0.40, 0.85, 0.45, 0.75)),
    ("S", imgui.ImVec4(0.50, 0.60, 1.0, 0.75)),
)
_MAX_LASERS = 32
_SETS = "Lasers of…"
_LEAST_ROWS = 4  # of the table, which else fills the panel
_NAME_HEIGHT = 1.08  # of the cones' names in the plot, above the curves, whose maximum is 1


_BLACK, _WHITE = 0xFF000000, 0xFFFFFFFF  # a number on a laser's colour
_BRIGHT = 0.45  # luma above which black is read better


class LasersPanel(Panel):
    """Edits wavelengths and amplitudes of the lasers; amplitudes are called powers in the window."""

    title = "Lasers"
    dock = "Right"

    def __init__(self) -> None:
        nm = np.linspace(*_PLOT_RANGE_NM, 166)
        cones = cone_fundamentals(nm * 1e-9)
        self._nm = nm
        self._cones = [np.ascontiguousarray(cones[:, i]) for i in range(3)]
        self._frame = 0
        self._held_scale: float | None = None

    def set_up(self, context: AppContext) -> None:
        add, session = partial(context.commands.add, "Lasers"), context.session
        white = {"amplitudes": "white"}
        balance = partial(session.change, "Balance to white", white)
        add("Balance to white", balance, help="Powers that make an even image white.")
        gap = "Another laser, in the middle of the widest gap; powers are balanced to white again."
        add("Add a laser", lambda: _add(context), help=gap, is_enabled=lambda: not session.system.is_field)
        everything = partial(context.edit_view, "All lasers", solo=None, muted=frozenset())
        add("All lasers", everything, "0", "Ends solo and mute.")
        digits = [str(number) for number in range(1, 10)]
        by_digit = partial(_solo_by_digit, context)
        add(
            "Solo a laser",
            by_digit,
            " ".join(digits),
            "By its number; again: all. While several holograms are open, Alt+1 … Alt+9.",
            is_enabled=lambda: not session.snapshots,
            shares_keys=True,
        )
        alone = " ".join(f"Alt+{digit}" for digit in digits)
        add("Solo a laser beside holograms", by_digit, alone, "By its number; again: all.")

    def draw(self, context: AppContext) -> None:
        system = context.session.system
        self._frame = min(self._frame, system.frames - 1)
        self._draw_plot(context, system)
        self._draw_buttons(context, system)
        self._draw_table(context, system)

    # --- spectrum ---------------------------------------------------------------------------------------------------

    def _draw_plot(self, context: AppContext, system: System) -> None:
        em = imgui.get_font_size()
        height = min(max(imgui.get_content_region_avail().y * 0.42, 5 * em), 14.7 * em)
        flags = (
            implot.Flags_.no_menus | implot.Flags_.no_mouse_text | implot.Flags_.no_box_select | implot.Flags_.no_legend
        )
        if not implot.begin_plot("##spectrum", imgui.ImVec2(-1, height), flags):
            return
        context.record_item_rect("spectrum")
        implot.setup_axes("wavelength (nm)", "", 0, implot.AxisFlags_.no_tick_labels)
        implot.setup_axes_limits(*_PLOT_RANGE_NM, 0.0, 1.18)
        implot.setup_axis_limits_constraints(implot.ImAxis_.x1, 200, 2000)
        for (name, bright), curve in zip(_CONES, self._cones, strict=True):
            colour = curve_colour(bright)
            implot.plot_line(f"##{name}", self._nm, curve, spec=implot.Spec(line_color=colour))
            implot.push_style_color(implot.Col_.inlay_text, colour)
            implot.plot_text(name, float(self._nm[np.argmax(curve)]), _NAME_HEIGHT)
            implot.pop_style_color()
        powers = system.amplitudes[self._frame]
        scale = self._held_scale or float(powers.max()) or 1.0
        is_held = False
        for index, wavelength_m in enumerate(system.wavelengths_m):
            is_held |= self._draw_laser(
                context, system, index, float(wavelength_m) * 1e9, float(powers[index]) / scale, scale
            )
        if self._held_scale is not None and not is_held:
            context.session.end_gesture()
        self._held_scale = scale if is_held else None
        low = implot.plot_to_pixels(_PLOT_RANGE_NM[0], 0.0)
        context.item_rects["spectrum origin"] = (low.x, low.y, low.x, low.y)
        implot.end_plot()

    def _draw_laser(
        self, context: AppContext, system: System, index: int, nm: float, height: float, scale: float
    ) -> bool:
        """Draws a laser as a stem with a peak that can be dragged; returns whether it is being dragged."""
        is_lit = context.session.view_settings.shows_laser(index)
        colour = laser_colour(nm * 1e-9, 1.0 if is_lit else 0.35)
        stem = implot.Spec(line_color=colour, line_weight=3.0 if is_lit else 1.0)
        implot.plot_line(f"##stem{index}", np.array([nm, nm]), np.array([0.0, height]), spec=stem)
        moved, x, y, _, hovered, held = implot.drag_point(
            index, nm, height, colour, 6.0, 0, out_clicked=False, out_hovered=False, out_held=False
        )
        implot.push_style_color(implot.Col_.inlay_text, imgui.get_style_color_vec4(imgui.Col_.text))
        implot.plot_text(str(index + 1), nm, height, imgui.ImVec2(0.8 * imgui.get_font_size(), 0))
        implot.pop_style_color()
        pixel = implot.plot_to_pixels(nm, height)
        context.item_rects[f"laser {index}"] = (pixel.x - 6, pixel.y - 6, pixel.x + 6, pixel.y + 6)
        if hovered and not held:
            show_tooltip(f"laser {index + 1}: {nm:.4g} nm, power {height * scale:.4g}\ndrag: wavelength and power")
        if moved:
            power = min(max(y, 0.0), 1.1) * scale
            _edit_laser(
                context, system, index, nm=round(x, 2), power=power, frame=self._frame, merge_key=("laser", index)
            )
        return bool(held)

    # --- sets and table ---------------------------------------------------------------------------------------------

    def _draw_buttons(self, context: AppContext, system: System) -> None:
        for command, label in (("Add a laser", "Add"), ("Balance to white", "White"), ("All lasers", "All on")):
            if label != "Add":
                same_line_for(label)
            command_button(context, command, label)
        same_line_for(_SETS, has_arrow=True)
        imgui.set_next_item_width(-1)
        if imgui.begin_combo("##set", _SETS):
            for name in preset.names():
                if imgui.selectable(name, False)[0]:
                    _take_lasers(context, name)
            imgui.end_combo()
        tooltip("Takes the wavelengths and powers of a preset.")
        if system.frames > 1:
            with room_for_labels("frame"):
                _, frame = fine_slider_int("frame", self._frame + 1, 1, system.frames)
            self._frame = frame - 1
            tooltip("The frame of the time sequence whose powers are shown.")

    def _draw_table(self, context: AppContext, system: System) -> None:
        flags = imgui.TableFlags_.row_bg | imgui.TableFlags_.scroll_y | imgui.TableFlags_.sizing_stretch_prop
        height = max(imgui.get_content_region_avail().y, _LEAST_ROWS * imgui.get_frame_height_with_spacing())
        if not imgui.begin_table("lasers", 4, flags, imgui.ImVec2(0, height)):
            return
        imgui.table_setup_scroll_freeze(0, 1)
        fixed, stretched = imgui.TableColumnFlags_.width_fixed, imgui.TableColumnFlags_.width_stretch
        for name, kind in (("", fixed), ("nm", stretched), ("power", stretched), ("solo mute", fixed)):
            imgui.table_setup_column(name, kind, 1.0 if kind == stretched else 0.0)
        imgui.table_headers_row()
        for index in range(len(system.wavelengths_m)):
            imgui.table_next_row()
            imgui.push_id(index)
            self._draw_row(context, system, index)
            imgui.pop_id()
        imgui.end_table()

    def _draw_row(self, context: AppContext, system: System, index: int) -> None:
        nm, view = float(system.wavelengths_m[index]) * 1e9, context.session.view_settings
        imgui.table_next_column()
        colour, side = laser_colour(nm * 1e-9), 1.2 * imgui.get_font_size()
        imgui.color_button("##colour", colour, imgui.ColorEditFlags_.no_tooltip, imgui.ImVec2(side, side))
        low, number = imgui.get_item_rect_min(), str(index + 1)
        ink = _BLACK if 0.30 * colour.x + 0.59 * colour.y + 0.11 * colour.z > _BRIGHT else _WHITE
        size = imgui.calc_text_size(number)
        place = imgui.ImVec2(low.x + (side - size.x) / 2, low.y + (side - size.y) / 2)
        imgui.get_window_draw_list().add_text(place, ink, number)
        imgui.table_next_column()
        imgui.set_next_item_width(-1)
        changed, value = fine_drag("##nm", nm, 0.25, *_EYE_RANGE_NM, "%.5g")
        context.record_item_rect(f"nm {index}")
        tooltip("Wavelength in nm: drag, or double click to enter it.")
        if changed:
            _edit_laser(context, system, index, nm=round(value, 3), frame=self._frame, merge_key=("nm", index))
        imgui.table_next_column()
        imgui.set_next_item_width(-1)
        power = float(system.amplitudes[self._frame, index])
        changed, value = fine_drag("##power", power, max(power, 0.1) * 0.01, 0.0, 1e6, "%.4g")
        tooltip("Relative power: drag, or double click to enter it.")
        if changed:
            _edit_laser(context, system, index, power=max(value, 0.0), frame=self._frame, merge_key=("power", index))
        imgui.table_next_column()
        self._draw_switches(context, system, index, view.solo == index, index in view.muted)

    def _draw_switches(self, context: AppContext, system: System, index: int, is_solo: bool, is_muted: bool) -> None:
        if _toggle("S", is_solo, "Shows this laser alone."):
            _solo(context, index)
        imgui.same_line(spacing=2)
        if _toggle("M", is_muted, "Leaves this laser out of the image."):
            muted = context.session.view_settings.muted ^ {index}
            context.edit_view("Mute", muted=muted)
        imgui.same_line(spacing=2)
        imgui.begin_disabled(len(system.wavelengths_m) == 1 or system.is_field)
        if imgui.small_button("×"):
            _remove(context, system, index)
        context.record_item_rect(f"remove {index}")
        tooltip("Takes this laser off the bench.")
        imgui.end_disabled()


def _toggle(label: str, is_on: bool, doc: str) -> bool:
    with coloured(imgui.Col_.button, imgui.get_style_color_vec4(imgui.Col_.button_active) if is_on else None):
        pressed = imgui.small_button(label)
    tooltip(doc)
    return pressed


def _solo_by_digit(context: AppContext) -> None:
    _solo(context, digit_pressed() - 1)


def _solo(context: AppContext, index: int) -> None:
    if index < len(context.session.system.wavelengths_m):
        context.edit_view("Solo", solo=None if context.session.view_settings.solo == index else index)


def _edit_laser(
    context: AppContext,
    system: System,
    index: int,
    *,
    nm: float | None = None,
    power: float | None = None,
    frame: int = 0,
    merge_key: tuple[str, int],
) -> None:
    wavelengths, amplitudes = system.wavelengths_m.copy(), system.amplitudes.copy()
    if nm is not None:
        wavelengths[index] = round(min(max(nm, _EYE_RANGE_NM[0]), _EYE_RANGE_NM[1]) * 1e-9, 14)
    if power is not None:
        amplitudes[frame, index] = power
    changes = {"wavelengths": wavelengths, "amplitudes": amplitudes}
    context.attempt(context.session.change, f"Laser {index + 1}", changes, merge_key=merge_key)


def _add(context: AppContext) -> None:
    wavelengths = np.sort(context.session.system.wavelengths_m)
    if len(wavelengths) >= _MAX_LASERS:
        context.session.messages.post(f"{_MAX_LASERS} lasers are the most that the viewer adds", "warning")
        return
    ends = np.array([450e-9, *wavelengths, 650e-9])
    widest = int(np.argmax(np.diff(ends)))
    new = round(float(ends[widest] + ends[widest + 1]) / 2, 10)
    _replace(context, "Add a laser", np.append(context.session.system.wavelengths_m, new))


def _remove(context: AppContext, system: System, index: int) -> None:
    context.edit_view("All lasers", solo=None, muted=frozenset())
    amplitudes = np.delete(system.amplitudes, index, axis=1)
    changes = {"wavelengths": np.delete(system.wavelengths_m, index), "amplitudes": amplitudes, "source.tilts": None}
    context.attempt(context.session.change, "Remove a laser", changes)


def _replace(context: AppContext, label: str, wavelengths: NDArray[np.float64]) -> None:
    changes = {"wavelengths": np.sort(wavelengths), "amplitudes": "white", "source.tilts": None}
    context.attempt(context.session.change, label, changes)


def _take_lasers(context: AppContext, name: str) -> None:
    other = preset.load(name)
    changes = {"wavelengths": other.wavelengths_m, "amplitudes": other.amplitudes, "source.tilts": None}
    context.attempt(context.session.change, f"Lasers of {name}", changes)
