"""The image panel: zoom and pan, values under the pointer, comparison of two sides, drawing of regions and lines."""

from __future__ import annotations

from functools import partial
from itertools import pairwise

import numpy as np
from imgui_bundle import imgui

from holoview.viewer.app.context import AppContext
from holoview.viewer.app.panel import Panel
from holoview.viewer.app.panels.eye import draw_path, draw_pupil, handle_pupil
from holoview.viewer.app.readout import (
    draw_centred_text,
    draw_label,
    draw_notes,
    draw_readout,
    readout_height,
    side_labels,
    waiting_text,
)
from holoview.viewer.app.viewport import PlaneSheet, Viewport, next_corner, pane_count, zoom_to_fit
from holoview.viewer.document.focus_edits import eyebox_half_m, focus_on, step_focus
from holoview.viewer.document.optimisation_job import OptimisationJob, running_optimisation
from holoview.viewer.render.scene import DeviceImage
from holoview.viewer.render.view_settings import DERIVED_PAGES, TARGET, ViewSettings, displayed_side

_ZOOM_PER_NOTCH = 1.25  # of the wheel
_MAX_ZOOM, _MIN_ZOOM = 64.0, 0.05
_MARK_COLOUR = imgui.IM_COL32(255, 220, 80, 255)
_PALE_MARK_COLOUR = imgui.IM_COL32(255, 255, 255, 210)
_CURSOR_PX = 7.0  # half the length of the lines of its cross
_WIPE_GRIP_PX = 8.0  # from the line of the wipe, within which a drag moves it


class ImagePanel(Panel):
    """Shows the page of the view settings.

    picture: the picture that was drawn last, and its place. shows_b: whether B of a comparison is shown while a key is
    held.
    """

    title = "Image"
    dock = "Centre"
    flags = imgui.WindowFlags_.no_scrollbar | imgui.WindowFlags_.no_scroll_with_mouse

    def __init__(self) -> None:
        self._drag_start: tuple[float, float] | None = None
        self._seen_job: OptimisationJob | None = None  # whose picture has been shown
        self._drags_wipe = self._drags_cursor = self.shows_b = False
        self._draws_new = self._has_moved = False
        self._pane = 0.0  # where the image begins in which a drag began, side by side

    def set_up(self, context: AppContext) -> None:
        self.picture, self._plane_sheet = Viewport(context, "viewport"), PlaneSheet(context)
        context.displayed_pixels = self.picture.pixels
        add = partial(context.commands.add, "Image")
        add("Fit", lambda: _edit_zoom(context, zoom=0.0, centre=(0.5, 0.5)), "F", "Shows all of the image.")
        add("One to one", lambda: _edit_zoom(context, zoom=1.0), "Z", "A screen pixel a sample.")
        add("Zoom in", lambda: self._zoom_by(context, _ZOOM_PER_NOTCH), "= Shift+=", repeats=True)
        add("Zoom out", lambda: self._zoom_by(context, 1 / _ZOOM_PER_NOTCH), "-", repeats=True)

    def draw(self, context: AppContext) -> None:
        view = context.session.view_settings
        available = imgui.get_content_region_avail()
        footer = readout_height(context, available.x) + 4
        size = (max(int(available.x), 16), max(int(available.y - footer), 16))
        corner = next_corner()
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
        if view.page == "image" and not is_compared and self._awaits_optimised_picture(context):
            target = context.side_renderers.picture(TARGET)
            a = a if target is None else target
        if a is None:
            draw_centred_text(waiting_text(context, view), size)
        else:
            self._draw_picture(context, a, b, view, size, corner)
        draw_readout(context, None if a is None else self._under_pointer())

    def _awaits_optimised_picture(self, context: AppContext) -> bool:
        """Whether an optimisation runs of which there is no picture yet; until then its target is shown."""
        job = running_optimisation(context.session)
        if job is None or job is self._seen_job:
            return False
        if context.session.preview_document is not None and context.side_renderers.now.follows:
            self._seen_job = job
            return False
        return True

    def _draw_sheet(self, context: AppContext, size: tuple[int, int]) -> None:
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
        shape = context.session.document.image_shape if view.page == "image" else a.shape
        self.shows_b = view.compare == "hold" and imgui.is_key_down(imgui.Key.b)
        self.picture.draw(a, b, view, size, corner, shape=shape, shows_b=self.shows_b)
        imgui.set_cursor_screen_pos(corner)
        buttons = imgui.ButtonFlags_.mouse_button_left | imgui.ButtonFlags_.mouse_button_middle
        imgui.invisible_button("##image", imgui.ImVec2(*size), buttons)
        context.record_item_rect("image")
        context.picture_place = context.item_rects["image"]
        draw_list = imgui.get_window_draw_list()
        has_pupil = view.page == "spectrum" and context.session.system.eye is not None
        if not has_pupil:
            self._handle_pointer(context)
        draw_list.push_clip_rect(corner, self.picture.end, True)
        if has_pupil:
            self._draw_pupil(context)
        if view.page == "image":
            self._draw_marks(view, draw_list)
        job = running_optimisation(context.session)
        if job is not None and job is not self._seen_job and view.page == "image" and b is None:
            step = job.step if job.latest is None else "its first picture is computed"
            draw_label(draw_list, f"target   {step}", imgui.ImVec2(corner.x + 8, corner.y + 6))
        if a.is_quick and view.page == "image":
            badge = "quick image"
            left = self.picture.end.x - imgui.calc_text_size(badge).x - 8
            draw_label(draw_list, badge, imgui.ImVec2(left, corner.y + 6))
        if view.page == "field" and view.quantity == "intensity":
            where = view.stage if view.stage.startswith("before ") else f"behind {view.stage}"
            badge = f"light right {where}; Escape: the image"
            draw_label(draw_list, badge, imgui.ImVec2(corner.x + 8, corner.y + 6))
        names = [context.session.document.title, *context.session.snapshots]
        for text, share in side_labels(view, self.shows_b, context.session.target_spec is not None, names):
            draw_label(draw_list, text, imgui.ImVec2(corner.x + share * size[0] + 8, corner.y + 6))
        if view.page in ("image", "target"):
            draw_notes(draw_list, context.session.previewed_document, self.picture)
        draw_list.pop_clip_rect()

    def _draw_pupil(self, context: AppContext) -> None:
        """The eyebox's page: the pupil over it, which the pointer moves."""
        rows, columns = self.picture.shape
        middle = self.picture.to_screen(columns // 2 + 0.5, rows // 2 + 0.5)
        right = self.picture.to_screen(columns + 0.5, rows // 2 + 0.5)
        scale = (right.x - middle.x) / eyebox_half_m(context.session.system)
        handle_pupil(context, middle, scale)
        draw_path(context, middle, scale)
        draw_pupil(context, middle, scale)

    def _draw_marks(self, view: ViewSettings, draw_list: imgui.ImDrawList) -> None:
        """The regions, the line of the profile, and the cursor, on each of the images beside each other."""
        corner, end = self.picture.corner, self.picture.end
        starts = [*self.picture.panes, end.x - corner.x]
        for start, stop in pairwise(starts):
            low, high = imgui.ImVec2(corner.x + start, corner.y), imgui.ImVec2(corner.x + stop, end.y)
            draw_list.push_clip_rect(low, high, True)
            self._draw_marks_in_pane(view, draw_list, start)
            draw_list.pop_clip_rect()

    def _draw_marks_in_pane(self, view: ViewSettings, draw_list: imgui.ImDrawList, start: float) -> None:
        def at(x: float, y: float) -> imgui.ImVec2:
            place = self.picture.to_screen(x, y)
            return imgui.ImVec2(place.x + start, place.y)

        for of in view.regions:
            x, y, width, height = of.region
            is_chosen = of.name == view.region_name
            colour = _MARK_COLOUR if is_chosen else _PALE_MARK_COLOUR
            draw_list.add_rect(at(x, y), at(x + width, y + height), colour, 0, 1.5)
            if len(view.regions) > 1:
                name = at(x, y)
                draw_label(draw_list, of.name, imgui.ImVec2(name.x + 5, name.y + 3))
        if view.profile is not None:
            x0, y0, x1, y1 = view.profile
            draw_list.add_line(at(x0 + 0.5, y0 + 0.5), at(x1 + 0.5, y1 + 0.5), _MARK_COLOUR, 1.5)
        if view.cursor is not None:
            middle = at(view.cursor[0] + 0.5, view.cursor[1] + 0.5)
            for dx, dy in ((_CURSOR_PX, 0), (0, _CURSOR_PX)):
                ends = imgui.ImVec2(middle.x - dx, middle.y - dy), imgui.ImVec2(middle.x + dx, middle.y + dy)
                draw_list.add_line(*ends, _MARK_COLOUR, 1.5)

    # --- pointer ----------------------------------------------------------------------------------------------------

    def _handle_pointer(self, context: AppContext) -> None:
        io, view = imgui.get_io(), context.session.view_settings
        if imgui.is_item_hovered():
            self._handle_wheel(context, io)
            if imgui.is_mouse_double_clicked(imgui.MouseButton_.left):
                _edit_zoom(context, zoom=0.0, centre=(0.5, 0.5))
        if imgui.is_item_activated() and io.key_alt:
            x, y = self._nearest_sample(io.mouse_pos)
            context.attempt(focus_on, context.session, y, x)
        elif imgui.is_item_activated():
            self._begin_drag(context, io)
        if imgui.is_item_active():
            self._drag(context, io)
        if imgui.is_item_deactivated():
            if self._drag_start is not None:
                context.drag_tool = ""
            elif not self._has_moved and view.page == "image":
                self._choose_region(context, io)
            self._drag_start, self._drags_wipe, self._drags_cursor = None, False, False
            context.session.end_gesture()

    def _handle_wheel(self, context: AppContext, io: imgui.IO) -> None:
        if io.mouse_wheel == 0:
            return
        if io.key_ctrl:
            context.attempt(step_focus, context.session, io.mouse_wheel)
        else:
            self._zoom_about(context, io.mouse_pos, _ZOOM_PER_NOTCH**io.mouse_wheel)

    def _zoom_about(self, context: AppContext, pointer: imgui.ImVec2, factor: float) -> None:
        """The place under the pointer stays where it is."""
        view, area, shape = context.session.view_settings, self.picture.visible_area, self.picture.shape
        assert area is not None
        zoom = _scaled_zoom(view, zoom_to_fit(view, area.size, shape), factor)
        panes = pane_count(view)
        width = area.size[0] // panes
        x, y = self.picture.to_pixel(pointer)
        x = x % width if panes == 2 else x
        u, v = area.to_image(x, y)
        centre = (u - (x - width / 2) / (zoom * shape[1]), v - (y - area.size[1] / 2) / (zoom * shape[0]))
        _edit_zoom(context, zoom=zoom, centre=centre)

    def _zoom_by(self, context: AppContext, factor: float) -> None:
        view, shape, area = (
            context.session.view_settings,
            context.session.document.image_shape,
            self.picture.visible_area,
        )
        fit = 1.0 if area is None else zoom_to_fit(view, area.size, shape)
        _edit_zoom(context, zoom=_scaled_zoom(view, fit, factor))

    def _begin_drag(self, context: AppContext, io: imgui.IO) -> None:
        view, area = context.session.view_settings, self.picture.visible_area
        assert area is not None
        x = self.picture.to_pixel(io.mouse_pos)[0]
        self._drags_wipe = view.compare == "wipe" and abs(x - view.wipe * area.size[0]) < _WIPE_GRIP_PX
        self._drags_cursor = io.key_ctrl and view.page == "image"
        self._has_moved = False
        self._pane = io.mouse_pos.x - self.picture.in_first_pane(io.mouse_pos).x
        if context.drag_tool or io.key_shift:
            context.drag_tool = context.drag_tool or "region"
            self._drag_start = self.picture.to_sample(self.picture.in_first_pane(io.mouse_pos))
            self._draws_new = context.drag_tool == "region"

    def _drag(self, context: AppContext, io: imgui.IO) -> None:
        view, area = context.session.view_settings, self.picture.visible_area
        assert area is not None
        self._has_moved |= bool(io.mouse_delta.x or io.mouse_delta.y)
        if self._drags_wipe:
            share = self.picture.to_pixel(io.mouse_pos)[0] / area.size[0]
            context.edit_view("Wipe", wipe=min(max(share, 0.0), 1.0))
        elif self._drags_cursor:
            context.edit_view("Cursor", cursor=self._nearest_sample(io.mouse_pos))
        elif self._drag_start is not None:
            place = self.picture.to_sample(self.picture.in_first_pane(io.mouse_pos, self._pane))
            self._drag_tool(context, self._drag_start, place)
        elif io.mouse_delta.x or io.mouse_delta.y:
            (u, v), step = view.centre, self.picture.step
            zoom = view.zoom or zoom_to_fit(view, area.size, self.picture.shape)
            _edit_zoom(context, zoom=zoom, centre=(u - io.mouse_delta.x * step[0], v - io.mouse_delta.y * step[1]))

    def _drag_tool(self, context: AppContext, a: tuple[float, float], b: tuple[float, float]) -> None:
        (x0, x1), (y0, y1), (rows, columns) = sorted((a[0], b[0])), sorted((a[1], b[1])), self.picture.shape
        if context.drag_tool == "line":
            context.edit_view("Line", profile=tuple(np.clip((*a, *b), 0, [columns - 1, rows - 1] * 2).tolist()))
            return
        left, top = max(int(x0), 0), max(int(y0), 0)
        width, height = min(int(x1) + 1, columns) - left, min(int(y1) + 1, rows) - top
        if width <= 1 or height <= 1:
            return
        view, region = context.session.view_settings, (left, top, width, height)
        view = view.with_new_region(region) if self._draws_new else view.with_(region=region)
        context.attempt(context.session.edit, "Region", merge_key="region", view_settings=view)
        self._draws_new = False

    def _choose_region(self, context: AppContext, io: imgui.IO) -> None:
        """A click into a region chooses it; where several lie above each other, the smallest."""
        (x, y), view = self.picture.to_sample(self.picture.in_first_pane(io.mouse_pos)), context.session.view_settings
        hit = [
            of for of in view.regions if 0 <= x - of.region[0] < of.region[2] and 0 <= y - of.region[1] < of.region[3]
        ]
        if hit:
            name = min(hit, key=lambda of: of.region[2] * of.region[3]).name
            context.attempt(context.session.edit, "Choose a region", view_settings=view.with_region_chosen(name))

    def _nearest_sample(self, place: imgui.ImVec2) -> tuple[int, int]:
        """The sample (x, y) of the image at a place on the screen, or the one at its edge that is nearest."""
        (x, y), (rows, columns) = self.picture.to_sample(self.picture.in_first_pane(place)), self.picture.shape
        return min(max(int(x), 0), columns - 1), min(max(int(y), 0), rows - 1)

    def _under_pointer(self) -> tuple[float, float] | None:
        """The position of the pointer as fractions of the image; None if it isn't over the image."""
        if self.picture.visible_area is None or not imgui.is_window_hovered():
            return None
        u, v = self.picture.to_image(imgui.get_io().mouse_pos)
        return (u, v) if 0 <= u < 1 and 0 <= v < 1 else None


def _edit_zoom(context: AppContext, **fields: object) -> None:
    """Changes zoom or centre; these aren't steps of undo."""
    context.attempt(context.session.edit_view, "Zoom", undoable=False, **fields)


def _scaled_zoom(view: ViewSettings, fit: float, factor: float) -> float:
    """The present zoom times a factor, within limits that include `fit`, at which the whole image is visible."""
    return min(max((view.zoom or fit) * factor, min(_MIN_ZOOM, fit)), _MAX_ZOOM)
