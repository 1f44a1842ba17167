"""A sheet of all focal planes, as large as fits into the image panel."""

from __future__ import annotations

import math

from imgui_bundle import imgui

from holoview.app.context import AppContext
from holoview.app.tiles import PlaneTiles
from holoview.document.focal_plane import SAME_PLANE_M
from holoview.render.plane_previews import previewed_planes

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
