"""The strip of the bench's focal planes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from imgui_bundle import imgui

from holoview.app.tiles import SAME_PLANE_M, PlaneTiles, tile_size

if TYPE_CHECKING:
    from holoview.app.app import App


class PlaneStrip:
    """A row of tiles, a plane each."""

    def __init__(self, app: App) -> None:
        self._tiles = PlaneTiles(app, "plane")

    def draw_strip(self, app: App) -> float | None:
        """Draws the strip in the room that is left; the plane that was clicked."""
        room = imgui.get_content_region_avail()
        if room.y < 24:
            return None
        planes, chosen = app.plane_previews.planes_m, None
        height = room.y
        size = tile_size(app.session.document.image_shape, height)
        if size[0] * len(planes) + 6 * len(planes) > room.x:
            size = tile_size(app.session.document.image_shape, height - imgui.get_style().scrollbar_size)
        imgui.begin_child("strip", imgui.ImVec2(0, 0), 0, imgui.WindowFlags_.horizontal_scrollbar)
        for plane_m in planes:
            is_here = abs(plane_m - app.session.view_settings.plane_m) < SAME_PLANE_M
            if self._tiles.draw(plane_m, app.plane_previews.pictures.get(plane_m), size, is_here):
                chosen = plane_m
            imgui.same_line()
        imgui.end_child()
        return chosen
