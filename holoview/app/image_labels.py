"""Texts in the image panel: names of the compared sides, and what is shown while there is no image."""

from __future__ import annotations

from imgui_bundle import imgui

from holoview.app.context import AppContext
from holoview.render.view_settings import TARGET, ViewSettings


def side_labels(view: ViewSettings, shows_b: bool, has_target: bool) -> list[tuple[str, float]]:
    """Texts above the image and their positions as fractions of its width."""
    if view.page != "image" or view.compare == "off":
        return []
    a, b = (
        "no target yet: open a picture" if side == TARGET and not has_target else side.label
        for side in (view.a, view.b)
    )
    if view.compare == "hold":
        return [(b if shows_b else f"{a}   (hold B: {b})", 0.0)]
    if view.compare == "difference":
        return [(f"{a} − {b}", 0.0)]
    return [(a, 0.0), (b, 0.5 if view.compare == "side-by-side" else view.wipe)]


def draw_label(draw_list: imgui.ImDrawList, text: str, position: imgui.ImVec2) -> None:
    """Draws a white text on a dark rectangle; position: its upper left corner on the screen."""
    size = imgui.calc_text_size(text)
    low = imgui.ImVec2(position.x - 4, position.y - 2)
    high = imgui.ImVec2(position.x + size.x + 4, position.y + size.y + 2)
    draw_list.add_rect_filled(low, high, imgui.IM_COL32(0, 0, 0, 170), 3)
    draw_list.add_text(position, imgui.IM_COL32(255, 255, 255, 255), text)


def waiting_text(context: AppContext, view: ViewSettings) -> str:
    """What is shown in place of an image that isn't there."""
    if view.page == "target" and context.session.target_spec is None:
        return "no target yet: open a picture"
    return "computing the first image" if context.is_busy else "nothing to show"


def draw_centred_text(text: str, size: tuple[int, int]) -> None:
    """Draws a text in the middle of the area of the image."""
    imgui.dummy(imgui.ImVec2(*size))
    corner = imgui.get_item_rect_min()
    position = imgui.ImVec2(corner.x + size[0] / 2 - imgui.calc_text_size(text).x / 2, corner.y + size[1] / 2)
    imgui.get_window_draw_list().add_text(position, imgui.get_color_u32(imgui.Col_.text_disabled), text)
