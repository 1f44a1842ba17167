"""The panel of the eye: its pupil in the eyebox, its focus in dioptres, and which wavelength it sees in which plane.

Its widgets: a map of the eyebox with the pupil, its recorded path, a graph of its focus by wavelength.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
from imgui_bundle import imgui, implot

from holoview.light.model.eye import AUTO, PUPIL, PUPIL_PLACE, VERGENCE, Eye, Prescription
from holoview.light.model.fields import fields_by_key
from holoview.viewer.app import plots, theme
from holoview.viewer.app.context import AppContext
from holoview.viewer.app.panel import Panel
from holoview.viewer.app.parameter_widgets import WidgetEdit, draw_fields, number_field
from holoview.viewer.app.theme import laser_colour
from holoview.viewer.app.widgets import (
    button,
    most_across,
    pale,
    room_for_labels,
    share_of_width,
    tooltip,
    wrapped_text,
)
from holoview.viewer.document.focus_edits import (
    PUPIL_RANGE_M,
    dioptres_of,
    eye_of,
    eyebox_half_m,
    focus_at,
    focus_range_m,
    move_pupil,
    plane_of,
    pupil_diameter_m,
    resize_pupil,
    seen_planes_m,
    toggle_chromatic,
    toggle_eye,
)
from holoview.viewer.render.view_settings import ACHROMATIC, NOW

_RECORD, _PLAY, _FORGET = "Record the pupil", "Play the path", "Forget the path"
_FILES = {"Open…": "Open…", "Save…": "Save pupil path…", "Animate…": "Save path animation…"}
"""Commands of the buttons for files."""
_HELP = {
    _RECORD: "Keeps where the pupil is, its diameter and its focus, while you change them; again: ends the recording.",
    _PLAY: "Moves the pupil along its path; again: stops it there.",
    _FORGET: "Removes the path of the pupil.",
    "Open…": "A path as it is saved here: a table of times and places (CSV).",
    "Save pupil path…": "Times, places, diameters and accommodations, as a table (CSV).",
    "Save path animation…": "What the eye sees along the path, as an animated PNG, a GIF or an MP4.",
}


def add_path_commands(context: AppContext) -> None:
    """Adds the commands of the path to the menu of the eye."""
    motion = context.pupil_motion
    actions = {
        _RECORD: lambda: motion.stop() if motion.state == "recording" else motion.record(),
        _PLAY: lambda: motion.stop() if motion.state == "playing" else motion.play(),
        _FORGET: lambda: _forget(context),
    }
    for name, action in actions.items():
        context.commands.add("Eye", name, action, help=_HELP[name])


def draw_path_controls(context: AppContext) -> None:
    """Draws the buttons of the path, and what there is of it."""
    imgui.separator_text("path of the pupil")
    motion, has_path = context.pupil_motion, context.session.view_settings.pupil_path is not None
    is_recording, is_playing = motion.state == "recording", motion.state == "playing"
    buttons = (
        (_RECORD, "Stop##record" if is_recording else "Record", is_recording, True),
        (_PLAY, "Stop##play" if is_playing else "Play", is_playing, has_path),
        (_FORGET, "Forget", False, has_path),
        *((command, f"{label}##path", False, has_path or label == "Open…") for label, command in _FILES.items()),
    )
    across = most_across([label for _, label, _, _ in buttons], 3)
    width = share_of_width(across)
    for number, (command, label, is_on, is_enabled) in enumerate(buttons):
        if number % across:
            imgui.same_line()
        if button(context, label, _HELP[command], width=width, name=command, is_on=is_on, is_enabled=is_enabled):
            context.attempt(context.commands.run, command)
    wrapped_text(_status(context), pale())


def _status(context: AppContext) -> str:
    motion, path = context.pupil_motion, context.session.view_settings.pupil_path
    if motion.state == "recording":
        return f"recording, {motion.elapsed_s:.1f} s: drag the pupil"
    if path is None:
        return "none yet: record, and drag the pupil"
    if motion.state == "playing":
        return f"playing, {min(motion.elapsed_s, path.duration_s):.1f} of {path.duration_s:.1f} s"
    return f"{path.duration_s:.1f} s, {len(path.times_s)} points"


def _forget(context: AppContext) -> None:
    context.pupil_motion.stop()
    context.session.edit_view("Forget the path", pupil_path=None)


# A small map of the eyebox with the pupil as a circle, which a drag moves and the wheel resizes, and with its path.


_SIZE_EM = 10.0  # of the map, in heights of the font
_MARGIN = 1.5  # half the side of the map over half the side of the eyebox at the longest wavelength
_PER_NOTCH = 1.08  # of the wheel, on the diameter
_GROUND = imgui.IM_COL32(18, 18, 20, 255)
_PUPIL = imgui.IM_COL32(255, 255, 255, 255)
_INSIDE = imgui.IM_COL32(255, 255, 255, 28)
_PATH, _RECORDED_PATH = imgui.IM_COL32(255, 200, 70, 230), imgui.IM_COL32(255, 90, 80, 255)
_OUTLINE = imgui.IM_COL32(0, 0, 0, 160)
_MOST_SEGMENTS = 400  # of a path, which are more than can be told apart
_END_RADIUS_PX = 3.0


def draw_pupil_map(context: AppContext) -> None:
    """Draws the eyebox of each wavelength and the pupil, and moves it."""
    corner, width = imgui.get_cursor_screen_pos(), imgui.get_content_region_avail().x
    side = _SIZE_EM * imgui.get_font_size()
    size = imgui.ImVec2(max(width, side / 2), side)
    imgui.invisible_button("##pupil map", size)
    context.record_item_rect("pupil map")
    middle = imgui.ImVec2(corner.x + size.x / 2, corner.y + size.y / 2)
    scale = side / 2 / (_MARGIN * eyebox_half_m(context.session.system))  # pixels a metre
    handle_pupil(context, middle, scale)
    draw_list = imgui.get_window_draw_list()
    draw_list.push_clip_rect(corner, imgui.ImVec2(corner.x + size.x, corner.y + size.y), True)
    draw_list.add_rect_filled(corner, imgui.ImVec2(corner.x + size.x, corner.y + size.y), _GROUND, 3)
    draw_eyeboxes(context, middle, scale)
    draw_path(context, middle, scale)
    draw_pupil(context, middle, scale)
    draw_list.pop_clip_rect()


def handle_pupil(context: AppContext, middle: imgui.ImVec2, scale: float) -> None:
    """Has a drag on the item that was drawn last move the pupil, and the wheel resize it; scale: pixels a metre."""
    io, session = imgui.get_io(), context.session
    if imgui.is_item_hovered():
        imgui.set_item_key_owner(imgui.Key.mouse_wheel_y)  # before it turns: else the panel scrolls
        if io.mouse_wheel:
            context.attempt(resize_pupil, session, _PER_NOTCH**io.mouse_wheel)
    if imgui.is_item_activated() and context.pupil_motion.state == "playing":
        context.pupil_motion.stop()
    if imgui.is_item_active():
        place = (io.mouse_pos.y - middle.y) / scale, (io.mouse_pos.x - middle.x) / scale
        context.attempt(move_pupil, session, place)
    if imgui.is_item_deactivated():
        session.end_gesture()
    if not imgui.is_item_active():
        tooltip("The pupil in the eyebox: drag it; the wheel changes its diameter.")


def draw_eyeboxes(context: AppContext, middle: imgui.ImVec2, scale: float) -> None:
    """Draws the edge of each laser's eyebox in its colour; scale: pixels a metre.

    With its number on the right, where the next wider eyebox leaves room for it.
    """
    system, draw_list = context.session.system, imgui.get_window_draw_list()
    wider = math.inf
    for number, wavelength in sorted(enumerate(system.wavelengths_m.tolist(), 1), key=lambda of: -of[1]):
        half, text = eyebox_half_m(system, wavelength) * scale, f" {number}"
        colour = imgui.get_color_u32(laser_colour(wavelength))
        low, high = imgui.ImVec2(middle.x - half, middle.y - half), imgui.ImVec2(middle.x + half, middle.y + half)
        draw_list.add_rect(low, high, colour, 0, 1.0)
        if half + imgui.calc_text_size(text).x < wider:
            draw_list.add_text(imgui.ImVec2(high.x, high.y - imgui.get_font_size()), colour, text)
        wider = half


def draw_path(context: AppContext, middle: imgui.ImVec2, scale: float) -> None:
    """Draws the path of the pupil with a dot at its beginning; scale: pixels a metre."""
    motion, draw_list = context.pupil_motion, imgui.get_window_draw_list()
    places_m = motion.places_m
    if not places_m:
        return
    every = -(-len(places_m) // _MOST_SEGMENTS)
    shown = [*places_m[::every], places_m[-1]]
    points: list[Any] = [imgui.ImVec2(middle.x + x * scale, middle.y + y * scale) for y, x in shown]
    colour = _RECORDED_PATH if motion.state == "recording" else _PATH
    for ground, width in ((_OUTLINE, 4.0), (colour, 1.5)):
        draw_list.add_polyline(points, ground, width, 0)
        draw_list.add_circle_filled(points[0], _END_RADIUS_PX + width - 1.5, ground)


def draw_pupil(context: AppContext, middle: imgui.ImVec2, scale: float) -> None:
    """Draws the pupil as a circle; scale: pixels a metre."""
    system, draw_list = context.session.system, imgui.get_window_draw_list()
    eye, radius = eye_of(system), pupil_diameter_m(system) / 2 * scale
    centre = imgui.ImVec2(middle.x + eye.pupil_x_m * scale, middle.y + eye.pupil_y_m * scale)
    draw_list.add_circle_filled(centre, radius, _INSIDE, 64)
    draw_list.add_circle(centre, radius, _PUPIL, 64, 1.5)


# --- A graph of which plane the eye sees at which wavelength, beside the focal planes of the bench ---


_HEIGHT_EM = 11.3
_FLAGS = implot.Flags_.no_menus | implot.Flags_.no_legend | implot.Flags_.no_mouse_text | implot.Flags_.no_inputs
_AXIS = implot.AxisFlags_.no_grid_lines | implot.AxisFlags_.no_menus | implot.AxisFlags_.no_highlight
_FIRST_NM, _LAST_NM = 390.0, 710.0
_PLANE = imgui.ImVec4(0.55, 0.57, 0.60, 0.8)
_GRAPH_MARGIN = 0.2  # of the range, above and below, for the numbers


def draw_focus_graph(context: AppContext) -> None:
    """Draws the planes (mm, and dioptres on the right) over the wavelength: a curve, and a dot for each laser."""
    system, plane_m = context.session.system, context.session.view_settings.plane_m
    wavelengths_nm = np.linspace(_FIRST_NM, _LAST_NM, 65)
    curve, seen = (seen_planes_m(system, plane_m, at) for at in (wavelengths_nm * 1e-9, system.wavelengths_m))
    low, high = min(system.planes_m.min(), seen.min()), max(system.planes_m.max(), seen.max())
    margin = _GRAPH_MARGIN * (high - low) or 1e-3
    low, high = low - margin, high + margin
    if not implot.begin_plot("##focus of wavelengths", imgui.ImVec2(-1, _HEIGHT_EM * imgui.get_font_size()), _FLAGS):
        return
    implot.setup_axes("wavelength (nm)", "plane seen (mm)", _AXIS, _AXIS)
    implot.setup_axis(implot.ImAxis_.y2, "dioptres", _AXIS | implot.AxisFlags_.opposite)
    implot.setup_axis_limits(implot.ImAxis_.x1, _FIRST_NM, _LAST_NM, imgui.Cond_.always)
    implot.setup_axis_limits(implot.ImAxis_.y1, low * 1e3, high * 1e3, imgui.Cond_.always)
    ends = dioptres_of(system, low), dioptres_of(system, high)
    implot.setup_axis_limits(implot.ImAxis_.y2, *ends, imgui.Cond_.always)
    for plane in system.planes_m.tolist():
        line = np.array([plane, plane]) * 1e3
        implot.plot_line("##planes", np.array([_FIRST_NM, _LAST_NM]), line, implot.Spec(line_color=_PLANE))
    spec = implot.Spec(line_color=theme.signal_colour("accent"), line_weight=1.5)
    implot.plot_line("##curve", wavelengths_nm, curve * 1e3, spec)
    for index, (wavelength, plane) in enumerate(zip(system.wavelengths_m.tolist(), seen.tolist(), strict=True)):
        plots.laser_mark(index, wavelength, wavelength * 1e9, plane * 1e3)
    implot.end_plot()
    context.record_item_rect("focus of wavelengths")
    tooltip(
        "A mark with its number for each laser: the plane that the eye sees in its light. Grey lines are the focal "
        "planes of the bench: what they hold is sharp for a laser whose mark lies on them."
    )


# --- the panel --------------------------------------------------------------------------------------------------------


_BY_HAND = ("pupil", "pupil_y", "pupil_x", "accommodation", "infinity")
_ALL_BUT_CHROMATIC = tuple(key for key in fields_by_key(Eye) if key != "chromatic")


class EyePanel(Panel):
    """Edits the eye of the system."""

    title = "Eye"
    dock = "Left"

    def set_up(self, context: AppContext) -> None:
        add, session = partial(context.commands.add, "Eye"), context.session
        add("Eye", lambda: toggle_eye(session), "Y", "Puts an eye behind an eyepiece, or takes it away.")
        switch = "Switches the colour error of the eye, to see what it does."
        add("Chromatic aberration", lambda: toggle_chromatic(session), "Shift+Y", switch)
        beside = "The eye beside the same eye without chromatic aberration; again: one image."
        add("Compare without colour error", lambda: _compare_achromatic(context), "A", beside)
        add_path_commands(context)
        add("Eyebox", lambda: context.edit_view("Page", page="spectrum"), help="The eyebox with the pupil.")

    def draw(self, context: AppContext) -> None:
        system = context.session.system
        changed, _ = imgui.checkbox("an eye behind an eyepiece", system.eye is not None)
        context.record_item_rect("eye")
        tooltip("Shows what reaches the retina instead of the light in a focal plane.")
        if changed:
            context.attempt(toggle_eye, context.session)
        if system.eye is None:
            return
        with room_for_labels("accommodation", "luminance (cd/m²)"):
            self._draw_focus(context)
            draw_pupil_map(context)
            _draw_pupil(context, system.eye)
            draw_path_controls(context)
            imgui.separator_text("focus of the wavelengths")
            draw_fields(context, system.eye, Eye(), "eye.", without=_ALL_BUT_CHROMATIC)
            draw_focus_graph(context)
            if imgui.collapsing_header("Eyepiece and retina"):
                hidden = () if system.eye.pupil_m == AUTO else ("luminance", "age")
                draw_fields(context, system.eye, Eye(), "eye.", without=(*_BY_HAND, "chromatic", *hidden))
            if imgui.collapsing_header("Prescription"):
                draw_fields(context, system.eye.prescription, Prescription(), "eye.prescription.")

    def _draw_focus(self, context: AppContext) -> None:
        """Draws the accommodation, which moves the focal plane."""
        session = context.session
        span = [dioptres_of(session.system, z) for z in focus_range_m(session.system)]
        now = dioptres_of(session.system, session.view_settings.plane_m)
        doc = "Dioptres at which the eye is focused at its reference wavelength: 0 is infinity, 4 is 25 cm."
        edited = number_field("accommodation", VERGENCE, now, 0.0, doc, (span[0], span[1]))
        context.record_item_rect("accommodation")
        if edited is not None:
            context.attempt(focus_at, session, plane_of(session.system, edited.value))
            if not edited.is_held:
                session.end_gesture()


def _compare_achromatic(context: AppContext) -> None:
    """Compares with an eye without chromatic aberration in the mode of the last comparison, or ends that."""
    session, view = context.session, context.session.view_settings
    eye_of(session.system)
    if view.compare != "off" and (view.a, view.b) == (NOW, ACHROMATIC):
        context.edit_view("No comparison", compare="off")
        return
    compare = "wipe" if view.compare == "off" else view.compare
    context.edit_view("Compare", page="image", a=NOW, b=ACHROMATIC, compare=compare)


def _draw_pupil(context: AppContext, eye: Eye) -> None:
    system = context.session.system
    is_auto = eye.pupil_m == AUTO
    changed, wants_auto = imgui.checkbox("auto", is_auto)
    tooltip("A pupil that follows from luminance, field and age (Watson & Yellott 2012).")
    if changed:
        context.change("Pupil", "eye.pupil", AUTO if wants_auto else pupil_diameter_m(system))
    imgui.same_line()
    if is_auto:
        imgui.text(f"pupil {pupil_diameter_m(system) * 1e3:.2f} mm")
    else:
        imgui.set_next_item_width(imgui.get_content_region_avail().x * 0.62)
        diameter_m = pupil_diameter_m(system)
        edited = number_field("pupil", PUPIL, diameter_m, 3e-3, "Diameter of the pupil.", PUPIL_RANGE_M)
        _apply(context, "eye.pupil", edited)
    context.record_item_rect("eye.pupil")
    for key, value in (("pupil_y", eye.pupil_y_m), ("pupil_x", eye.pupil_x_m)):
        doc = "Place of the pupil in the eyebox: " + ("downwards." if key == "pupil_y" else "to the right.")
        edited = number_field(key.replace("_", " "), PUPIL_PLACE, value, 0.0, doc, (-4e-3, 4e-3))
        _apply(context, f"eye.{key}", edited)
        context.record_item_rect(f"eye.{key}")


def _apply(context: AppContext, key: str, edited: WidgetEdit | None) -> None:
    if edited is not None:
        context.change("Pupil", key, edited.value, is_held=edited.is_held)
