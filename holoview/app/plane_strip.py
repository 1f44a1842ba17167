"""A horizontal strip of all focal planes of the system."""

from __future__ import annotations

from imgui_bundle import imgui

from holoview.app.context import AppContext
from holoview.app.tiles import PlaneTiles, tile_size
from holoview.document.focal_plane import SAME_PLANE_M
from holoview.render.plane_previews import previewed_planes


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
