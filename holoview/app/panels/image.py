"""The image: zoom and pan about the pointer, values under it, comparison of two sides, regions and lines."""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui
from numpy.typing import NDArray

from holoview.app.context import AppContext
from holoview.app.panel import Panel
from holoview.app.plane_sheet import PlaneSheet
from holoview.app.readout import draw_readout, readout_height
from holoview.app.viewport import DeviceImage, Viewport, VisibleArea, visible_area_of, zoom_to_fit
from holoview.session.focal_plane import step_focus
from holoview.session.view_settings import DERIVED_PAGES, TARGET, ViewSettings, displayed_side

_NOTCH = 1.25  # zoom a notch of the wheel
_MOST_ZOOM, _LEAST_ZOOM = 64.0, 0.05
_LINE = imgui.IM_COL32(255, 220, 80, 255)
_GRIP = 8.0  # pixels from the wipe's line at which it is taken hold of


class ImagePanel(Panel):
    """What an eye sees of the hologram."""

    title = "Image"
    dock = "Centre"
    flags = imgui.WindowFlags_.no_scrollbar | imgui.WindowFlags_.no_scroll_with_mouse

    def __init__(self) -> None:
        self._viewport: Viewport | None = None
        self._texture: imgui.ImTextureRef | None = None
        self._contact: PlaneSheet | None = None
        self.visible_area: VisibleArea | None = None
        self._drag_start: tuple[float, float] | None = None
        self._drags_wipe = False
        self.shows_b = False
        self._scale = 1.0

    def set_up(self, context: AppContext) -> None:
        self._viewport = Viewport(context.device, "viewport")
        self._contact = PlaneSheet(context)
        context.displayed_pixels = self.displayed_pixels
        add = context.commands.add
        add("Fit", lambda: _edit_zoom(context, zoom=0.0, centre=(0.5, 0.5)), "Image", "F", "Shows all of the image.")
        add("One to one", lambda: _edit_zoom(context, zoom=1.0), "Image", "Z", "A screen pixel a sample.")
        add("Zoom in", lambda: self._zoom_by(context, _NOTCH), "Image", "= Shift+=", is_held=True)
        add("Zoom out", lambda: self._zoom_by(context, 1 / _NOTCH), "Image", "-", is_held=True)

    def displayed_pixels(self) -> NDArray[np.uint8] | None:
        """What the panel shows, 8-bit sRGB (y, x, 3)."""
        return None if self._viewport is None or self._viewport.view is None else self._viewport.pixels()

    def draw(self, context: AppContext) -> None:
        look = context.session.view_settings
        room = imgui.get_content_region_avail()
        footer = readout_height(context, room.x) + 4
        size = (max(int(room.x), 16), max(int(room.y - footer), 16))
        corner = imgui.get_cursor_screen_pos()
        corner = imgui.ImVec2(float(round(corner.x)), float(round(corner.y)))
        if look.page == "planes":
            self._draw_sheet(context, size)
            return
        is_compared = look.compare != "off" and look.page == "image"
        a = (
            context.derived_images.picture()
            if look.page in DERIVED_PAGES
            else context.side_renderers.picture(displayed_side(look))
        )
        b = context.side_renderers.picture(look.b) if is_compared else None
        if a is None:
            _draw_text(_waiting_text(context, look), size)
        else:
            self._draw_picture(context, a, b, look, size, corner)
        draw_readout(context, self._under_pointer(a, corner))

    def _draw_sheet(self, context: AppContext, size: tuple[int, int]) -> None:
        assert self._contact is not None
        chosen = self._contact.draw(context, size)
        if chosen is not None:
            context.edit_view("Focal plane", plane_m=chosen, page="image")
        imgui.text_disabled("click a plane to look at it")

    # --- drawing ----------------------------------------------------------------------------------------------------

    def _draw_picture(
        self,
        context: AppContext,
        a: DeviceImage,
        b: DeviceImage | None,
        look: ViewSettings,
        size: tuple[int, int],
        corner: imgui.ImVec2,
    ) -> None:
        assert self._viewport is not None
        shape = context.session.document.image_shape if look.page == "image" else a.shape
        self._scale = imgui.get_io().display_framebuffer_scale.x
        pixels = (max(round(size[0] * self._scale), 1), max(round(size[1] * self._scale), 1))
        self.visible_area = visible_area_of(look, pixels, shape)
        self.shows_b = look.compare == "hold" and imgui.is_key_down(imgui.Key.b)
        if self._viewport.draw(a, b, look, self.visible_area, holds_b=self.shows_b):
            if self._texture is not None:
                context.window.forget_texture(self._texture)
            self._texture = context.window.texture(self._viewport.view)
        assert self._texture is not None
        imgui.set_cursor_screen_pos(corner)
        buttons = imgui.ButtonFlags_.mouse_button_left | imgui.ButtonFlags_.mouse_button_middle
        imgui.invisible_button("##image", imgui.ImVec2(*size), buttons)
        context.record_item_rect("image")
        drawn = imgui.get_window_draw_list()
        drawn.add_image(self._texture, corner, imgui.ImVec2(corner.x + size[0], corner.y + size[1]))
        self._follow_hand(context, shape, corner)
        self._draw_marks(context, look, shape, corner, size)

    def _draw_marks(
        self,
        context: AppContext,
        look: ViewSettings,
        shape: tuple[int, int],
        corner: imgui.ImVec2,
        size: tuple[int, int],
    ) -> None:
        """The region, the profile's line, and the names of the sides."""
        assert self.visible_area is not None
        drawn = imgui.get_window_draw_list()
        drawn.push_clip_rect(corner, imgui.ImVec2(corner.x + size[0], corner.y + size[1]), True)
        if look.page == "image" and look.region is not None:
            x, y, width, height = look.region
            drawn.add_rect(
                self._to_screen(x, y, shape, corner),
                self._to_screen(x + width, y + height, shape, corner),
                _LINE,
                0,
                1.5,
            )
        if look.page == "image" and look.profile is not None:
            x0, y0, x1, y1 = look.profile
            drawn.add_line(
                self._to_screen(x0 + 0.5, y0 + 0.5, shape, corner),
                self._to_screen(x1 + 0.5, y1 + 0.5, shape, corner),
                _LINE,
                1.5,
            )
        has_target = context.session.target_spec is not None
        for text, share in _side_names(look, self.shows_b, has_target):
            _label(drawn, text, imgui.ImVec2(corner.x + share * size[0] + 8, corner.y + 6))
        drawn.pop_clip_rect()

    def _to_screen(self, x: float, y: float, shape: tuple[int, int], corner: imgui.ImVec2) -> imgui.ImVec2:
        assert self.visible_area is not None
        column, row = self.visible_area.to_pixel(x / shape[1], y / shape[0])
        return imgui.ImVec2(corner.x + column / self._scale, corner.y + row / self._scale)

    def _to_viewport(self, at: imgui.ImVec2, corner: imgui.ImVec2) -> tuple[float, float]:
        """The viewport's pixel at a place of the screen."""
        return (at.x - corner.x) * self._scale, (at.y - corner.y) * self._scale

    # --- the hand ---------------------------------------------------------------------------------------------------

    def _follow_hand(self, context: AppContext, shape: tuple[int, int], corner: imgui.ImVec2) -> None:
        io = imgui.get_io()
        if imgui.is_item_hovered():
            self._follow_wheel(context, shape, corner, io)
            if imgui.is_mouse_double_clicked(imgui.MouseButton_.left):
                _edit_zoom(context, zoom=0.0, centre=(0.5, 0.5))
        if imgui.is_item_activated():
            self._begin_drag(context, shape, corner, io)
        if imgui.is_item_active():
            self._drag(context, shape, corner, io)
        if imgui.is_item_deactivated():
            if self._drag_start is not None:
                context.drag_tool = ""
            self._drag_start, self._drags_wipe = None, False
            context.session.end_gesture()

    def _follow_wheel(self, context: AppContext, shape: tuple[int, int], corner: imgui.ImVec2, io: imgui.IO) -> None:
        if io.mouse_wheel == 0:
            return
        if io.key_ctrl:
            context.attempt(step_focus, context.session, io.mouse_wheel)
        else:
            self._zoom_about(context, shape, corner, io.mouse_pos, _NOTCH**io.mouse_wheel)

    def _zoom_about(
        self, context: AppContext, shape: tuple[int, int], corner: imgui.ImVec2, pointer: imgui.ImVec2, factor: float
    ) -> None:
        """The place under the pointer stays where it is."""
        assert self.visible_area is not None
        look, frame = context.session.view_settings, self.visible_area
        fit = zoom_to_fit(look, frame.size, shape)
        zoom = min(max((look.zoom or fit) * factor, min(_LEAST_ZOOM, fit)), _MOST_ZOOM)
        panes = 2 if look.compare == "side-by-side" else 1
        width = frame.size[0] // panes
        x, y = self._to_viewport(pointer, corner)
        x = x % width if panes == 2 else x
        u, v = frame.to_image(x, y)
        centre = (u - (x - width / 2) / (zoom * shape[1]), v - (y - frame.size[1] / 2) / (zoom * shape[0]))
        _edit_zoom(context, zoom=zoom, centre=centre)

    def _zoom_by(self, context: AppContext, factor: float) -> None:
        look = context.session.view_settings
        fit = (
            zoom_to_fit(look, self.visible_area.size, context.session.document.image_shape)
            if self.visible_area
            else 1.0
        )
        _edit_zoom(context, zoom=min(max((look.zoom or fit) * factor, _LEAST_ZOOM), _MOST_ZOOM))

    def _begin_drag(self, context: AppContext, shape: tuple[int, int], corner: imgui.ImVec2, io: imgui.IO) -> None:
        look = context.session.view_settings
        assert self.visible_area is not None
        x = self._to_viewport(io.mouse_pos, corner)[0]
        self._drags_wipe = look.compare == "wipe" and abs(x - look.wipe * self.visible_area.size[0]) < _GRIP
        if context.drag_tool or io.key_shift:
            context.drag_tool = context.drag_tool or "region"
            self._drag_start = self._to_sample(shape, corner, io.mouse_pos)

    def _drag(self, context: AppContext, shape: tuple[int, int], corner: imgui.ImVec2, io: imgui.IO) -> None:
        look = context.session.view_settings
        assert self.visible_area is not None
        if self._drags_wipe:
            share = self._to_viewport(io.mouse_pos, corner)[0] / self.visible_area.size[0]
            context.edit_view("Wipe", wipe=min(max(share, 0.0), 1.0))
        elif self._drag_start is not None:
            self._draw_tool(context, shape, self._drag_start, self._to_sample(shape, corner, io.mouse_pos))
        elif io.mouse_delta.x or io.mouse_delta.y:
            u, v = look.centre
            step = [self._scale * share for share in self.visible_area.step]
            zoom = look.zoom or zoom_to_fit(look, self.visible_area.size, shape)
            _edit_zoom(context, zoom=zoom, centre=(u - io.mouse_delta.x * step[0], v - io.mouse_delta.y * step[1]))

    def _draw_tool(
        self, context: AppContext, shape: tuple[int, int], a: tuple[float, float], b: tuple[float, float]
    ) -> None:
        (x0, x1), (y0, y1) = sorted((a[0], b[0])), sorted((a[1], b[1]))
        if context.drag_tool == "line":
            context.edit_view("Line", profile=tuple(np.clip((*a, *b), 0, [shape[1] - 1, shape[0] - 1] * 2).tolist()))
            return
        left, top = max(int(x0), 0), max(int(y0), 0)
        width, height = min(int(x1) + 1, shape[1]) - left, min(int(y1) + 1, shape[0]) - top
        if width > 1 and height > 1:
            context.edit_view("Region", region=(left, top, width, height))

    def _to_sample(self, shape: tuple[int, int], corner: imgui.ImVec2, at: imgui.ImVec2) -> tuple[float, float]:
        """Samples of the image at a place of the screen."""
        assert self.visible_area is not None
        u, v = self.visible_area.to_image(*self._to_viewport(at, corner))
        return u * shape[1], v * shape[0]

    def _under_pointer(self, a: DeviceImage | None, corner: imgui.ImVec2) -> tuple[float, float] | None:
        """Shares of the image under the pointer; None where it isn't over the image."""
        if a is None or self.visible_area is None or not imgui.is_window_hovered():
            return None
        at = imgui.get_io().mouse_pos
        u, v = self.visible_area.to_image(*self._to_viewport(at, corner))
        return (u, v) if 0 <= u < 1 and 0 <= v < 1 else None


def _edit_zoom(context: AppContext, **fields: object) -> None:
    """Zoom and pan aren't steps of undo."""
    context.attempt(context.session.edit_view, "Zoom", undoable=False, **fields)


def _side_names(look: ViewSettings, holds_b: bool, has_target: bool) -> list[tuple[str, float]]:
    """Texts above the image and where, as a share of its width."""
    if look.page != "image" or look.compare == "off":
        return []
    a, b = (
        "no target yet: open a picture" if side == TARGET and not has_target else side.label
        for side in (look.a, look.b)
    )
    if look.compare == "hold":
        return [(b if holds_b else f"{a}   (hold B: {b})", 0.0)]
    if look.compare == "difference":
        return [(f"{a} − {b}", 0.0)]
    return [(a, 0.0), (b, 0.5 if look.compare == "side-by-side" else look.wipe)]


def _label(drawn: imgui.ImDrawList, text: str, at: imgui.ImVec2) -> None:
    size = imgui.calc_text_size(text)
    low, high = imgui.ImVec2(at.x - 4, at.y - 2), imgui.ImVec2(at.x + size.x + 4, at.y + size.y + 2)
    drawn.add_rect_filled(low, high, imgui.IM_COL32(0, 0, 0, 170), 3)
    drawn.add_text(at, imgui.IM_COL32(255, 255, 255, 255), text)


def _waiting_text(context: AppContext, look: ViewSettings) -> str:
    if look.page == "target" and context.session.target_spec is None:
        return "no target yet: open a picture"
    return "computing the first image" if context.is_busy else "nothing to show"


def _draw_text(text: str, size: tuple[int, int]) -> None:
    """A text in the middle of what is else the image."""
    imgui.dummy(imgui.ImVec2(*size))
    place = imgui.get_item_rect_min()
    where = imgui.ImVec2(place.x + size[0] / 2 - imgui.calc_text_size(text).x / 2, place.y + size[1] / 2)
    imgui.get_window_draw_list().add_text(where, imgui.get_color_u32(imgui.Col_.text_disabled), text)
