"""Clickable tiles with pictures of focal planes: a strip of all planes, and a sheet as large as the image panel."""

from __future__ import annotations

import math
from dataclasses import replace

from imgui_bundle import imgui

from holoview.app.context import AppContext
from holoview.app.viewport import Viewport, visible_area_of
from holoview.document.focus import SAME_PLANE_M, dioptres_text
from holoview.render.planes import previewed_planes
from holoview.render.scene import DeviceImage
from holoview.render.view_settings import ViewSettings

_CHOSEN = imgui.IM_COL32(80, 160, 245, 255)
_EMPTY = imgui.IM_COL32(20, 20, 22, 255)
_LABEL_BACKGROUND, _LABEL_TEXT = imgui.IM_COL32(0, 0, 0, 160), imgui.IM_COL32(255, 255, 255, 255)


class PlaneTiles:
    """Draws tiles by plane; each has its own texture, which is redrawn when its picture or the view settings change."""

    def __init__(self, context: AppContext, name: str) -> None:
        self._context, self._name = context, name
        self._drawn: dict[float, tuple[Viewport, imgui.ImTextureRef]] = {}

    def draw(self, plane_m: float, picture: DeviceImage | None, size: tuple[int, int], is_chosen: bool) -> bool:
        """Draws a tile of `size` (x, y) logical pixels and returns whether it was clicked."""
        corner = imgui.get_cursor_screen_pos()
        corner = imgui.ImVec2(float(round(corner.x)), float(round(corner.y)))
        name = f"{plane_m * 1e3:.4g} mm"
        clicked = imgui.invisible_button(f"##{self._name} {name}", imgui.ImVec2(*size))
        self._context.record_item_rect(f"{self._name} {name}")
        if not imgui.is_item_visible():
            return False
        end = imgui.ImVec2(corner.x + size[0], corner.y + size[1])
        canvas = imgui.get_window_draw_list()
        if picture is None:
            canvas.add_rect_filled(corner, end, _EMPTY, 2)
        else:
            canvas.add_image(self._texture(plane_m, picture, size), corner, end)
        self._draw_label(canvas, corner, name, plane_m)
        if is_chosen or imgui.is_item_hovered():
            canvas.add_rect(corner, end, _CHOSEN, 2, 2.0 if is_chosen else 1.0)
        return clicked

    def _draw_label(self, canvas: imgui.ImDrawList, corner: imgui.ImVec2, name: str, plane_m: float) -> None:
        """The plane in mm, with an eye also in dioptres."""
        system = self._context.session.system
        text = name if system.eye is None else f"{name}\n{dioptres_text(system, plane_m)}"
        size = imgui.calc_text_size(text)
        end = imgui.ImVec2(corner.x + size.x + 8, corner.y + size.y + 2)
        canvas.add_rect_filled(corner, end, _LABEL_BACKGROUND, 2)
        canvas.add_text(imgui.ImVec2(corner.x + 4, corner.y + 1), _LABEL_TEXT, text)

    def _texture(self, plane_m: float, picture: DeviceImage, size: tuple[int, int]) -> imgui.ImTextureRef:
        view = _tile_view_settings(self._context.session.view_settings)
        picture = replace(picture, gain=self._context.side_renderers.now.quick_gain)
        entry = self._drawn.get(plane_m)
        viewport = entry[0] if entry is not None else Viewport(self._context.device, f"{self._name} {plane_m:g}")
        scale = imgui.get_io().display_framebuffer_scale.x
        pixels = (max(round(size[0] * scale), 1), max(round(size[1] * scale), 1))
        is_new = viewport.draw(picture, None, view, visible_area_of(view, pixels, picture.shape))
        if entry is not None and not is_new:
            return entry[1]
        if entry is not None:
            self._context.window.forget_texture(entry[1])
        reference = self._context.window.texture(viewport.view)
        self._drawn[plane_m] = (viewport, reference)
        return reference


def tile_size(shape: tuple[int, int], height: float) -> tuple[int, int]:
    """The size (x, y) of a tile of a given height with the aspect ratio of an image of `shape` (y, x)."""
    return max(round(height * shape[1] / shape[0]), 24), max(round(height), 16)


def _tile_view_settings(view: ViewSettings) -> ViewSettings:
    """View settings of a tile: the same tone mapping, but all of the image and no comparison."""
    neither = {"region": None, "profile": None, "pupil_path": None}
    return view.with_(page="image", compare="off", zoom=0.0, centre=(0.5, 0.5), plane_m=0.0, **neither)


# --- A horizontal strip of all focal planes of the system ---


class PlaneStrip:
    """Draws one tile for each plane in a scrollable row."""

    def __init__(self, context: AppContext) -> None:
        self._tiles = PlaneTiles(context, "plane")

    def draw(self, context: AppContext) -> float | None:
        """Draws the strip in the rest of the window and returns the plane in metres that was clicked, if any."""
        available = imgui.get_content_region_avail()
        if available.y < 24:
            return None
        planes, chosen = previewed_planes(context.session.system), None
        height = available.y
        size = tile_size(context.session.document.image_shape, height)
        if size[0] * len(planes) + 6 * len(planes) > available.x:
            size = tile_size(context.session.document.image_shape, height - imgui.get_style().scrollbar_size)
        imgui.begin_child("strip", imgui.ImVec2(0, 0), 0, imgui.WindowFlags_.horizontal_scrollbar)
        for plane_m in planes:
            is_focused = abs(plane_m - context.session.view_settings.plane_m) < SAME_PLANE_M
            if self._tiles.draw(plane_m, context.plane_previews.pictures.get(plane_m), size, is_focused):
                chosen = plane_m
            imgui.same_line()
        imgui.end_child()
        return chosen


# --- A sheet of all focal planes, as large as fits into the image panel ---


_GAP = 6.0


class PlaneSheet:
    """Draws one tile for each plane in rows and columns."""

    def __init__(self, context: AppContext) -> None:
        self._tiles = PlaneTiles(context, "sheet")

    def draw(self, context: AppContext, available: tuple[int, int]) -> float | None:
        """Draws the sheet and returns the plane in metres that was clicked, if any."""
        planes, focused, chosen = previewed_planes(context.session.system), context.session.view_settings.plane_m, None
        columns, size = fitting_tiles(len(planes), available, context.session.document.image_shape)
        corner = imgui.get_cursor_pos()
        for number, plane_m in enumerate(planes):
            row, column = divmod(number, columns)
            place = imgui.ImVec2(corner.x + column * (size[0] + _GAP), corner.y + row * (size[1] + _GAP))
            imgui.set_cursor_pos(place)
            if self._tiles.draw(
                plane_m, context.plane_previews.pictures.get(plane_m), size, abs(plane_m - focused) < SAME_PLANE_M
            ):
                chosen = plane_m
        imgui.set_cursor_pos(imgui.ImVec2(corner.x, corner.y + available[1]))
        imgui.dummy(imgui.ImVec2(0, 0))
        return chosen


def fitting_tiles(count: int, available: tuple[int, int], shape: tuple[int, int]) -> tuple[int, tuple[int, int]]:
    """Columns, and the size (x, y), of the largest tiles of an image of `shape` (y, x) that fit into a room."""
    best, chosen = (0, 0), 1
    for columns in range(1, count + 1):
        rows = math.ceil(count / columns)
        width = min(
            (available[0] - _GAP * columns) / columns, (available[1] - _GAP * rows) / rows * shape[1] / shape[0]
        )
        size = max(int(width), 16), max(int(width * shape[0] / shape[1]), 12)
        if size[0] > best[0]:
            best, chosen = size, columns
    return chosen, best
