"""A small map of the eyebox with the pupil as a circle, which a drag moves and the wheel resizes, and with its path."""

from __future__ import annotations

from typing import Any

from imgui_bundle import imgui

from holoview.app.context import AppContext
from holoview.app.laser_colours import laser_colour
from holoview.app.parameter_widgets import tooltip
from holoview.document.eye_edits import eye_of, eyebox_half_m, move_pupil, pupil_diameter_m, resize_pupil

_SIZE_PX = 150.0
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
    size = imgui.ImVec2(max(width, 80.0), _SIZE_PX)
    imgui.invisible_button("##pupil map", size)
    context.record_item_rect("pupil map")
    middle = imgui.ImVec2(corner.x + size.x / 2, corner.y + size.y / 2)
    scale = _SIZE_PX / 2 / (_MARGIN * eyebox_half_m(context.session.system))  # pixels a metre
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
    """Draws the edge of each laser's eyebox in its colour; scale: pixels a metre."""
    system, draw_list = context.session.system, imgui.get_window_draw_list()
    for wavelength in system.wavelengths_m.tolist():
        half = eyebox_half_m(system, wavelength) * scale
        colour = imgui.get_color_u32(laser_colour(wavelength))
        low, high = imgui.ImVec2(middle.x - half, middle.y - half), imgui.ImVec2(middle.x + half, middle.y + half)
        draw_list.add_rect(low, high, colour, 0, 1.0)


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
