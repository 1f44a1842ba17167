"""The image panel: zoom and pan, values under the pointer, comparison of two sides, drawing of regions and lines."""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui
from numpy.typing import NDArray

from holoview.app.context import AppContext
from holoview.app.panel import Panel
from holoview.app.panels.eye import draw_path, draw_pupil, handle_pupil
from holoview.app.readout import draw_centred_text, draw_label, draw_readout, readout_height, side_labels, waiting_text
from holoview.app.viewport import PlaneSheet, Viewport, VisibleArea, pane_count, visible_area_of, zoom_to_fit
from holoview.document.focus_edits import eyebox_half_m, focus_on, step_focus
from holoview.render.scene import DeviceImage
from holoview.render.view_settings import DERIVED_PAGES, ViewSettings, displayed_side

_ZOOM_PER_NOTCH = 1.25  # of the wheel
_MAX_ZOOM, _MIN_ZOOM = 64.0, 0.05
_MARK_COLOUR = imgui.IM_COL32(255, 220, 80, 255)
_WIPE_GRIP_PX = 8.0  # from the line of the wipe, within which a drag moves it


class ImagePanel(Panel):
    """Shows the page of the view settings.

    visible_area: the part of the image that was drawn last. shows_b: whether B of a comparison is shown while held.
    """

    title = "Image"
    dock = "Centre"
    flags = imgui.WindowFlags_.no_scrollbar | imgui.WindowFlags_.no_scroll_with_mouse

    def __init__(self) -> None:
        self._viewport: Viewport | None = None
        self._texture: imgui.ImTextureRef | None = None
        self._plane_sheet: PlaneSheet | None = None
        self.visible_area: VisibleArea | None = None
        self._drag_start: tuple[float, float] | None = None
        self._drags_wipe = False
        self.shows_b = False
        self._scale = 1.0

    def set_up(self, context: AppContext) -> None:
        self._viewport = Viewport(context.device, "viewport")
        self._plane_sheet = PlaneSheet(context)
        context.displayed_pixels = self.displayed_pixels
        add = context.commands.add
        add("Fit", lambda: _edit_zoom(context, zoom=0.0, centre=(0.5, 0.5)), "Image", "F", "Shows all of the image.")
        add("One to one", lambda: _edit_zoom(context, zoom=1.0), "Image", "Z", "A screen pixel a sample.")
        add("Zoom in", lambda: self._zoom_by(context, _ZOOM_PER_NOTCH), "Image", "= Shift+=", repeats=True)
        add("Zoom out", lambda: self._zoom_by(context, 1 / _ZOOM_PER_NOTCH), "Image", "-", repeats=True)

    def displayed_pixels(self) -> NDArray[np.uint8] | None:
        """The image that the panel shows, 8-bit sRGB (y, x, 3); None before anything was drawn."""
        return None if self._viewport is None or self._viewport.view is None else self._viewport.pixels()

    def draw(self, context: AppContext) -> None:
        view = context.session.view_settings
        available = imgui.get_content_region_avail()
        footer = readout_height(context, available.x) + 4
        size = (max(int(available.x), 16), max(int(available.y - footer), 16))
        corner = imgui.get_cursor_screen_pos()
        corner = imgui.ImVec2(float(round(corner.x)), float(round(corner.y)))
        if view.page == "planes":
            self._draw_sheet(context, size)
            return
        is_compared = view.compare != "off" and view.page == "image"
        a = (
            context.page_images.picture(context.session.displayed_document.scene, view)
            if view.page in DERIVED_PAGES
            else context.side_renderers.picture(displayed_side(view))
        )
        b = context.side_renderers.picture(view.b) if is_compared else None
        if a is None:
            draw_centred_text(waiting_text(context, view), size)
        else:
            self._draw_picture(context, a, b, view, size, corner)
        draw_readout(context, self._under_pointer(a, corner))

    def _draw_sheet(self, context: AppContext, size: tuple[int, int]) -> None:
        assert self._plane_sheet is not None
        chosen = self._plane_sheet.draw(context, size)
        if chosen is not None:
            context.edit_view("Focal plane", plane_m=chosen, page="image")
        imgui.text_disabled("click a plane to look at it")

    # --- drawing ----------------------------------------------------------------------------------------------------

    def _draw_picture(
        self,
        context: AppContext,
        a: DeviceImage,
        b: DeviceImage | None,
        view: ViewSettings,
        size: tuple[int, int],
        corner: imgui.ImVec2,
    ) -> None:
        assert self._viewport is not None
        shape = context.session.document.image_shape if view.page == "image" else a.shape
        self._scale = imgui.get_io().display_framebuffer_scale.x
        pixels = (max(round(size[0] * self._scale), 1), max(round(size[1] * self._scale), 1))
        self.visible_area = visible_area_of(view, pixels, shape)
        self.shows_b = view.compare == "hold" and imgui.is_key_down(imgui.Key.b)
        if self._viewport.draw(a, b, view, self.visible_area, shows_b=self.shows_b):
            if self._texture is not None:
                context.window.forget_texture(self._texture)
            self._texture = context.window.texture(self._viewport.view)
        assert self._texture is not None
        imgui.set_cursor_screen_pos(corner)
        buttons = imgui.ButtonFlags_.mouse_button_left | imgui.ButtonFlags_.mouse_button_middle
        imgui.invisible_button("##image", imgui.ImVec2(*size), buttons)
        context.record_item_rect("image")
        draw_list = imgui.get_window_draw_list()
        draw_list.add_image(self._texture, corner, imgui.ImVec2(corner.x + size[0], corner.y + size[1]))
        if view.page == "spectrum" and context.session.system.eye is not None:
            self._draw_pupil(context, shape, corner, size)
        else:
            self._handle_pointer(context, shape, corner)
        self._draw_marks(context, view, shape, corner, size)

    def _draw_pupil(
        self, context: AppContext, shape: tuple[int, int], corner: imgui.ImVec2, size: tuple[int, int]
    ) -> None:
        """The eyebox's page: the pupil over it, which the pointer moves."""
        middle = self._to_screen(shape[1] // 2 + 0.5, shape[0] // 2 + 0.5, shape, corner)
        right = self._to_screen(shape[1] + 0.5, shape[0] // 2 + 0.5, shape, corner)
        scale = (right.x - middle.x) / eyebox_half_m(context.session.system)
        handle_pupil(context, middle, scale)
        draw_list = imgui.get_window_draw_list()
        draw_list.push_clip_rect(corner, imgui.ImVec2(corner.x + size[0], corner.y + size[1]), True)
        draw_path(context, middle, scale)
        draw_pupil(context, middle, scale)
        draw_list.pop_clip_rect()

    def _draw_marks(
        self,
        context: AppContext,
        view: ViewSettings,
        shape: tuple[int, int],
        corner: imgui.ImVec2,
        size: tuple[int, int],
    ) -> None:
        """Draws the region, the line of the profile, and the names of the sides above the image."""
        assert self.visible_area is not None
        draw_list = imgui.get_window_draw_list()
        draw_list.push_clip_rect(corner, imgui.ImVec2(corner.x + size[0], corner.y + size[1]), True)
        if view.page == "image" and view.region is not None:
            x, y, width, height = view.region
            draw_list.add_rect(
                self._to_screen(x, y, shape, corner),
                self._to_screen(x + width, y + height, shape, corner),
                _MARK_COLOUR,
                0,
                1.5,
            )
        if view.page == "image" and view.profile is not None:
            x0, y0, x1, y1 = view.profile
            draw_list.add_line(
                self._to_screen(x0 + 0.5, y0 + 0.5, shape, corner),
                self._to_screen(x1 + 0.5, y1 + 0.5, shape, corner),
                _MARK_COLOUR,
                1.5,
            )
        has_target = context.session.target_spec is not None
        for text, share in side_labels(view, self.shows_b, has_target):
            draw_label(draw_list, text, imgui.ImVec2(corner.x + share * size[0] + 8, corner.y + 6))
        draw_list.pop_clip_rect()

    def _to_screen(self, x: float, y: float, shape: tuple[int, int], corner: imgui.ImVec2) -> imgui.ImVec2:
        assert self.visible_area is not None
        column, row = self.visible_area.to_pixel(x / shape[1], y / shape[0])
        return imgui.ImVec2(corner.x + column / self._scale, corner.y + row / self._scale)

    def _to_viewport(self, position: imgui.ImVec2, corner: imgui.ImVec2) -> tuple[float, float]:
        """The pixel of the viewport at a screen position."""
        return (position.x - corner.x) * self._scale, (position.y - corner.y) * self._scale

    # --- pointer ----------------------------------------------------------------------------------------------------

    def _handle_pointer(self, context: AppContext, shape: tuple[int, int], corner: imgui.ImVec2) -> None:
        io = imgui.get_io()
        if imgui.is_item_hovered():
            self._handle_wheel(context, shape, corner, io)
            if imgui.is_mouse_double_clicked(imgui.MouseButton_.left):
                _edit_zoom(context, zoom=0.0, centre=(0.5, 0.5))
        if imgui.is_item_activated() and io.key_alt:
            x, y = (
                min(max(int(at), 0), n - 1)
                for at, n in zip(self._to_sample(shape, corner, io.mouse_pos), reversed(shape), strict=True)
            )
            context.attempt(focus_on, context.session, y, x)
        elif imgui.is_item_activated():
            self._begin_drag(context, shape, corner, io)
        if imgui.is_item_active():
            self._drag(context, shape, corner, io)
        if imgui.is_item_deactivated():
            if self._drag_start is not None:
                context.drag_tool = ""
            self._drag_start, self._drags_wipe = None, False
            context.session.end_gesture()

    def _handle_wheel(self, context: AppContext, shape: tuple[int, int], corner: imgui.ImVec2, io: imgui.IO) -> None:
        if io.mouse_wheel == 0:
            return
        if io.key_ctrl:
            context.attempt(step_focus, context.session, io.mouse_wheel)
        else:
            self._zoom_about(context, shape, corner, io.mouse_pos, _ZOOM_PER_NOTCH**io.mouse_wheel)

    def _zoom_about(
        self, context: AppContext, shape: tuple[int, int], corner: imgui.ImVec2, pointer: imgui.ImVec2, factor: float
    ) -> None:
        """The place under the pointer stays where it is."""
        assert self.visible_area is not None
        view, area = context.session.view_settings, self.visible_area
        zoom = _scaled_zoom(view, zoom_to_fit(view, area.size, shape), factor)
        panes = pane_count(view)
        width = area.size[0] // panes
        x, y = self._to_viewport(pointer, corner)
        x = x % width if panes == 2 else x
        u, v = area.to_image(x, y)
        centre = (u - (x - width / 2) / (zoom * shape[1]), v - (y - area.size[1] / 2) / (zoom * shape[0]))
        _edit_zoom(context, zoom=zoom, centre=centre)

    def _zoom_by(self, context: AppContext, factor: float) -> None:
        view, shape, area = context.session.view_settings, context.session.document.image_shape, self.visible_area
        fit = 1.0 if area is None else zoom_to_fit(view, area.size, shape)
        _edit_zoom(context, zoom=_scaled_zoom(view, fit, factor))

    def _begin_drag(self, context: AppContext, shape: tuple[int, int], corner: imgui.ImVec2, io: imgui.IO) -> None:
        view = context.session.view_settings
        assert self.visible_area is not None
        x = self._to_viewport(io.mouse_pos, corner)[0]
        self._drags_wipe = view.compare == "wipe" and abs(x - view.wipe * self.visible_area.size[0]) < _WIPE_GRIP_PX
        if context.drag_tool or io.key_shift:
            context.drag_tool = context.drag_tool or "region"
            self._drag_start = self._to_sample(shape, corner, io.mouse_pos)

    def _drag(self, context: AppContext, shape: tuple[int, int], corner: imgui.ImVec2, io: imgui.IO) -> None:
        view = context.session.view_settings
        assert self.visible_area is not None
        if self._drags_wipe:
            share = self._to_viewport(io.mouse_pos, corner)[0] / self.visible_area.size[0]
            context.edit_view("Wipe", wipe=min(max(share, 0.0), 1.0))
        elif self._drag_start is not None:
            self._drag_tool(context, shape, self._drag_start, self._to_sample(shape, corner, io.mouse_pos))
        elif io.mouse_delta.x or io.mouse_delta.y:
            u, v = view.centre
            step = [self._scale * share for share in self.visible_area.step]
            zoom = view.zoom or zoom_to_fit(view, self.visible_area.size, shape)
            _edit_zoom(context, zoom=zoom, centre=(u - io.mouse_delta.x * step[0], v - io.mouse_delta.y * step[1]))

    def _drag_tool(
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

    def _to_sample(self, shape: tuple[int, int], corner: imgui.ImVec2, position: imgui.ImVec2) -> tuple[float, float]:
        """The position in samples of the image at a screen position."""
        assert self.visible_area is not None
        u, v = self.visible_area.to_image(*self._to_viewport(position, corner))
        return u * shape[1], v * shape[0]

    def _under_pointer(self, a: DeviceImage | None, corner: imgui.ImVec2) -> tuple[float, float] | None:
        """The position of the pointer as fractions of the image; None if it isn't over the image."""
        if a is None or self.visible_area is None or not imgui.is_window_hovered():
            return None
        position = imgui.get_io().mouse_pos
        u, v = self.visible_area.to_image(*self._to_viewport(position, corner))
        return (u, v) if 0 <= u < 1 and 0 <= v < 1 else None


def _edit_zoom(context: AppContext, **fields: object) -> None:
    """Changes zoom or centre; these aren't steps of undo."""
    context.attempt(context.session.edit_view, "Zoom", undoable=False, **fields)


def _scaled_zoom(view: ViewSettings, fit: float, factor: float) -> float:
    """The present zoom times a factor, within limits that include `fit`, at which the whole image is visible."""
    return min(max((view.zoom or fit) * factor, min(_MIN_ZOOM, fit)), _MAX_ZOOM)
