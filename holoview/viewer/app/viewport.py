"""Draws images of the device into a texture as the view settings say: zoom, tone, colour map, comparison, grid.

`PlaneStrip` and `PlaneSheet` are clickable tiles with pictures of focal planes: a strip of all planes, and a sheet as
large as the image panel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import wgpu
from imgui_bundle import imgui
from numpy.typing import NDArray

from holoview.light.engine.shader_structs import VIEWPORT
from holoview.light.gpu.device import Buffer
from holoview.light.gpu.recorder import CommandRecorder, Dispatch
from holoview.light.gpu.shader import GeneratedWgsl, link
from holoview.viewer.app.context import AppContext
from holoview.viewer.document.focus_edits import SAME_PLANE_M, dioptres_text
from holoview.viewer.render.planes import previewed_planes
from holoview.viewer.render.scene import DeviceImage
from holoview.viewer.render.tone_mapping import channel_matrix, colour_map
from holoview.viewer.render.view_settings import ViewSettings

_TILE = 8  # workgroup size of the shader along each axis
_MIN_GRID_ZOOM = 10.0  # screen pixels for each sample from which the pixel grid is drawn
_TAPS = ((1 + 1e-4, 1), (2.0, 3), (4.0, 5), (8.0, 9))
"""Samples along an axis that a screen pixel covers at most, and those that it may touch, which the shader reads."""
_SPARSE_TAPS = 8
_HALF_TOLERANCE = 1e-3  # screen pixels; positions are rounded by less
_COMPARISONS = {"off": 0, "hold": 0, "wipe": 1, "side-by-side": 2, "difference": 3}
BACKGROUND = (0.075, 0.078, 0.086)


@dataclass(frozen=True)
class VisibleArea:
    """The part of an image that is visible in `size` (x, y) screen pixels.

    origin: of the first pixel, step: from pixel to pixel, both (x, y) as fractions of the image.
    """

    size: tuple[int, int]
    origin: tuple[float, float]
    step: tuple[float, float]

    def to_image(self, x: float, y: float) -> tuple[float, float]:
        """The position in the image, as fractions, of a pixel position."""
        return self.origin[0] + x * self.step[0], self.origin[1] + y * self.step[1]

    def to_pixel(self, u: float, v: float) -> tuple[float, float]:
        """The pixel position of a position in the image, given as fractions."""
        return (u - self.origin[0]) / self.step[0], (v - self.origin[1]) / self.step[1]


def visible_area_of(view: ViewSettings, size: tuple[int, int], shape: tuple[int, int]) -> VisibleArea:
    """The part of an image of `shape` (y, x) that is visible in `size` (x, y) pixels.

    The corner of the image lies on the corner of a screen pixel. Side by side, it is the part in the left half.
    """
    width, height = max(size[0] // pane_count(view), 1), max(size[1], 1)
    zoom = view.zoom or zoom_to_fit(view, size, shape)
    step = (1 / (zoom * shape[1]), 1 / (zoom * shape[0]))
    left, top = _whole_pixel(width / 2 - view.centre[0] / step[0]), _whole_pixel(height / 2 - view.centre[1] / step[1])
    return VisibleArea(size, (-left * step[0], -top * step[1]), step)


def next_corner() -> imgui.ImVec2:
    """Where the next item begins, on a whole pixel."""
    corner = imgui.get_cursor_screen_pos()
    return imgui.ImVec2(float(round(corner.x)), float(round(corner.y)))


def _whole_pixel(position: float) -> int:
    """The nearest whole number; halves go down, rounded or not, so that a drag by n pixels moves by n from anywhere."""
    return math.ceil(position - 0.5 - _HALF_TOLERANCE)


def zoom_to_fit(view: ViewSettings, size: tuple[int, int], shape: tuple[int, int]) -> float:
    """The zoom, in screen pixels for each sample, at which the whole image is visible."""
    return max(min(size[0] / pane_count(view) / shape[1], size[1] / shape[0]), 1e-3)


def pane_count(view: ViewSettings) -> int:
    """The number of images side by side."""
    return 2 if view.compare == "side-by-side" else 1


class Viewport:
    """Images of the device in an area of a window, and what lies where in it.

    corner, size: of the area, in logical pixels of the screen. shape: rows and columns in which positions in the image
    are counted. visible_area: the part of the image that was drawn last; None before.
    """

    def __init__(self, context: AppContext, label: str) -> None:
        self._device, self._window, self._label = context.device, context.window, label
        self._uniform = self._device.uniform(bytes(VIEWPORT.size), f"{label}: what is shown")
        self._colour_maps: dict[str, Buffer] = {}
        self._drawn: Any = None
        self._texture: Any = None
        self._view: Any = None
        self._reference: imgui.ImTextureRef | None = None
        self.corner, self.size, self.shape = imgui.ImVec2(0, 0), (1, 1), (1, 1)
        self.visible_area: VisibleArea | None = None
        self._texture_size, self._scale = (0, 0), 1.0  # pixels of the texture; for each logical one
        self._pane_width = 1.0  # of an image side by side, in logical pixels

    def draw(
        self,
        a: DeviceImage,
        b: DeviceImage | None,
        view: ViewSettings,
        size: tuple[int, int],
        corner: imgui.ImVec2,
        *,
        shape: tuple[int, int] | None = None,
        shows_b: bool = False,
        is_stretched: bool = False,
    ) -> None:
        """Draws into `size` logical pixels at a corner.

        a, b: the sides of the comparison; only a is shown when b is None. shape: of the image; a's when None. shows_b:
        shows b in place of a. is_stretched: the whole image fills the area, whatever its aspect ratio.
        """
        self.corner, self.size, self.shape = corner, size, shape or a.shape
        self._scale = imgui.get_io().display_framebuffer_scale.x
        self._pane_width = size[0] / (1 if b is None else pane_count(view))
        pixels = (max(round(size[0] * self._scale), 1), max(round(size[1] * self._scale), 1))
        whole = VisibleArea(pixels, (0.0, 0.0), (1 / pixels[0], 1 / pixels[1]))
        self.visible_area = whole if is_stretched else visible_area_of(view, pixels, self.shape)
        self._draw_texture(a, b, view, self.visible_area, shows_b)
        assert self._reference is not None
        imgui.get_window_draw_list().add_image(self._reference, corner, self.end)

    @property
    def end(self) -> imgui.ImVec2:
        """The lower right corner of the area."""
        return imgui.ImVec2(self.corner.x + self.size[0], self.corner.y + self.size[1])

    @property
    def step(self) -> tuple[float, float]:
        """The step (x, y) from one logical pixel of the screen to the next, as fractions of the image."""
        assert self.visible_area is not None
        return self._scale * self.visible_area.step[0], self._scale * self.visible_area.step[1]

    def to_screen(self, x: float, y: float) -> imgui.ImVec2:
        """The place on the screen of a position in the image, (x, y) in its columns and rows."""
        assert self.visible_area is not None
        column, row = self.visible_area.to_pixel(x / self.shape[1], y / self.shape[0])
        return imgui.ImVec2(self.corner.x + column / self._scale, self.corner.y + row / self._scale)

    def to_pixel(self, place: imgui.ImVec2) -> tuple[float, float]:
        """The pixel of the texture at a place on the screen."""
        return (place.x - self.corner.x) * self._scale, (place.y - self.corner.y) * self._scale

    def to_image(self, place: imgui.ImVec2) -> tuple[float, float]:
        """The position in the image, as fractions, at a place on the screen."""
        assert self.visible_area is not None
        return self.visible_area.to_image(*self.to_pixel(place))

    def to_sample(self, place: imgui.ImVec2) -> tuple[float, float]:
        """The position in the image, (x, y) in its columns and rows, at a place on the screen."""
        u, v = self.to_image(place)
        return u * self.shape[1], v * self.shape[0]

    @property
    def panes(self) -> list[float]:
        """Where each image side by side begins, in logical pixels from the corner."""
        return [0.0, self._pane_width] if self._pane_width < self.size[0] else [0.0]

    def in_first_pane(self, place: imgui.ImVec2, pane: float | None = None) -> imgui.ImVec2:
        """The place of the left image that shows the same as a place of another one.

        pane: where that image begins; None for the image that the place is in.
        """
        pane = max(start for start in self.panes if start <= max(place.x - self.corner.x, 0)) if pane is None else pane
        return imgui.ImVec2(place.x - pane, place.y)

    def pixels(self) -> NDArray[np.uint8] | None:
        """Reads back what was drawn, 8-bit sRGB (y, x, 3); None before anything was."""
        if self._texture is None:
            return None
        width, height = self._texture_size
        data = self._device.raw.queue.read_texture(
            {"texture": self._texture, "mip_level": 0, "origin": (0, 0, 0)},
            {"bytes_per_row": 4 * width, "rows_per_image": height},
            (width, height, 1),
        )
        return np.frombuffer(data, np.uint8).reshape(height, width, 4)[..., :3].copy()

    def _draw_texture(
        self, a: DeviceImage, b: DeviceImage | None, view: ViewSettings, area: VisibleArea, shows_b: bool
    ) -> None:
        """Draws into the texture, if anything has changed."""
        is_new = self._resize(area.size)
        b_or_a = a if b is None else b
        view = view if b is not None else replace(view, compare="off")
        if view.page == "field" and view.quantity != "intensity":  # its picture has colours of its own
            view = replace(view, channel="colour", exposure_stops=0.0, gamma=1.0, low=0.0, high=1.0)
        inputs = (a.buffer, a.version, a.gain, b_or_a.buffer, b_or_a.version, b_or_a.gain, view, area, shows_b)
        if inputs == self._drawn and not is_new:
            return
        self._device.write(self._uniform, _pack_uniform(a, b_or_a, view, area))
        source = link(GeneratedWgsl("structs", VIEWPORT.wgsl), "display/viewport.wgsl")
        pipeline = self._device.pipeline(source, _constants(a, b_or_a, view, area, shows_b and b is not None))
        groups = [[self._uniform], [a.buffer, b_or_a.buffer, self._colour_map(view), self._view]]
        tiles = (-(-area.size[0] // _TILE), -(-area.size[1] // _TILE), 1)
        recorder = CommandRecorder(self._device, self._label)
        recorder.add(Dispatch.bind(self._device, pipeline, groups, tiles))
        recorder.submit()
        self._drawn = inputs

    def _resize(self, size: tuple[int, int]) -> bool:
        if size == self._texture_size:
            return False
        usage = wgpu.TextureUsage.STORAGE_BINDING | wgpu.TextureUsage.TEXTURE_BINDING | wgpu.TextureUsage.COPY_SRC
        self._device.check_alive()
        self._texture = self._device.raw.create_texture(
            label=self._label, size=(*size, 1), format=wgpu.TextureFormat.rgba8unorm, usage=usage
        )
        self._view, self._texture_size = self._texture.create_view(), size
        if self._reference is not None:
            self._window.forget_texture(self._reference)
        self._reference = self._window.texture(self._view)
        return True

    def _colour_map(self, view: ViewSettings) -> Buffer:
        name = colour_map_of(view) or "grey"
        if name not in self._colour_maps:
            opaque = np.full((256, 4), 255, np.uint8)
            opaque[:, :3] = colour_map(name)
            self._colour_maps[name] = self._device.upload(opaque, f"colour map {name}")
        return self._colour_maps[name]


def colour_map_of(view: ViewSettings) -> str:
    """The name of the colour map that the view settings need; "" for images in colour."""
    if view.page == "phase":
        return "hue"
    if view.channel == "colour":
        return ""
    return "signed" if view.compare == "difference" else view.false_colour or "grey"


def _constants(
    a: DeviceImage, b: DeviceImage, view: ViewSettings, area: VisibleArea, only_b: bool
) -> dict[str, int | float | bool]:
    """The shader's override constants: comparison, tone mapping, and how many samples a pixel covers."""
    shape = max(a.shape, b.shape)
    covered = max(area.step[0] * shape[1], area.step[1] * shape[0])
    taps = next((taps for most, taps in _TAPS if covered <= most), _SPARSE_TAPS)
    return {
        "comparison": _COMPARISONS[view.compare],
        "only_b": only_b,
        "has_palette": bool(colour_map_of(view)),
        "is_linear": view.page == "phase",
        "has_gamma": view.gamma != 1.0,
        "keeps_hue": view.keeps_hue and view.channel == "colour" and view.page != "phase",
        "has_grid": covered <= 1 / _MIN_GRID_ZOOM and not a.is_quick,
        "taps": taps,
        "is_sparse": covered > _TAPS[-1][0],
    }


def _pack_uniform(a: DeviceImage, b: DeviceImage, view: ViewSettings, area: VisibleArea) -> bytes:
    rows = np.zeros((3, 4))
    matrix = np.array([[0.0, 1.0, 0.0]]) if view.page == "phase" else channel_matrix(view.channel)
    scale = 1.0 if view.page == "phase" else 2.0**view.exposure_stops / (view.high - view.low)
    rows[:, :3] = matrix * scale
    is_offset = view.page != "phase" and view.compare != "difference"  # in a difference the black levels cancel
    rows[:, 3] = -view.low / (view.high - view.low) if is_offset else 0.0
    first, second, third = rows
    return VIEWPORT.pack(
        channel_r=first,
        channel_g=second,
        channel_b=third,
        background=(*BACKGROUND, 1.0),
        origin=area.origin,
        step=area.step,
        size_a=a.shape[::-1],
        size_b=b.shape[::-1],
        size=area.size,
        gain_a=(*a.gain, 0.0),
        gain_b=(*b.gain, 0.0),
        split=view.wipe * area.size[0],
        gamma=view.gamma,
    )


# --- tiles of planes --------------------------------------------------------------------------------------------------


_CHOSEN = imgui.IM_COL32(80, 160, 245, 255)
_EMPTY = imgui.IM_COL32(20, 20, 22, 255)
_LABEL_BACKGROUND, _LABEL_TEXT = imgui.IM_COL32(0, 0, 0, 160), imgui.IM_COL32(255, 255, 255, 255)


class PlaneTiles:
    """Draws tiles by plane; each has its own texture, which is redrawn when its picture or the view settings change."""

    def __init__(self, context: AppContext, name: str) -> None:
        self._context, self._name = context, name
        self._viewports: dict[float, Viewport] = {}

    def draw(self, plane_m: float, picture: DeviceImage | None, size: tuple[int, int], is_chosen: bool) -> bool:
        """Draws a tile of `size` (x, y) logical pixels and returns whether it was clicked."""
        corner = next_corner()
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
            shown = self._viewport_of(plane_m)
            picture = replace(picture, gain=self._context.side_renderers.now.quick_gain)
            shown.draw(picture, None, tile_view_settings(self._context.session.view_settings), size, corner)
        self._draw_label(canvas, corner, name, plane_m)
        if is_chosen or imgui.is_item_hovered():
            canvas.add_rect(corner, end, _CHOSEN, 2, 2.0 if is_chosen else 1.0)
        return clicked

    def _viewport_of(self, plane_m: float) -> Viewport:
        if plane_m not in self._viewports:
            self._viewports[plane_m] = Viewport(self._context, f"{self._name} {plane_m:g}")
        return self._viewports[plane_m]

    def _draw_label(self, canvas: imgui.ImDrawList, corner: imgui.ImVec2, name: str, plane_m: float) -> None:
        """The plane in mm, with an eye also in dioptres."""
        system = self._context.session.system
        text = name if system.eye is None else f"{name}\n{dioptres_text(system, plane_m)}"
        size = imgui.calc_text_size(text)
        end = imgui.ImVec2(corner.x + size.x + 8, corner.y + size.y + 2)
        canvas.add_rect_filled(corner, end, _LABEL_BACKGROUND, 2)
        canvas.add_text(imgui.ImVec2(corner.x + 4, corner.y + 1), _LABEL_TEXT, text)


def tile_size(shape: tuple[int, int], height: float) -> tuple[int, int]:
    """The size (x, y) of a tile of a given height with the aspect ratio of an image of `shape` (y, x)."""
    return max(round(height * shape[1] / shape[0]), 24), max(round(height), 16)


def tile_view_settings(view: ViewSettings) -> ViewSettings:
    """View settings of a tile: the same tone mapping, but all of the image and no comparison."""
    neither = {"region": None, "other_regions": (), "profile": None, "cursor": None, "pupil_path": None}
    return view.with_(page="image", compare="off", zoom=0.0, centre=(0.5, 0.5), plane_m=0.0, **neither)


# --- A horizontal strip of all focal planes of the system ---


_GAP, _LEAST_TILE_EM = 6.0, 3.0  # between tiles; height of one in a strip, in heights of the font


class PlaneStrip:
    """Draws one tile for each plane in a row, which scrolls where its tiles would become too small."""

    def __init__(self, context: AppContext) -> None:
        self._tiles = PlaneTiles(context, "plane")

    def draw(self, context: AppContext) -> float | None:
        """Draws the strip in the rest of the window and returns the plane in metres that was clicked, if any."""
        available = imgui.get_content_region_avail()
        if available.y < 24:
            return None
        planes, chosen = previewed_planes(context.session.system), None
        rows, columns = context.session.document.image_shape
        height, all_seen = available.y, (available.x / len(planes) - _GAP) * rows / columns
        if all_seen < height:
            is_small = all_seen < _LEAST_TILE_EM * imgui.get_font_size()
            height = height - math.ceil(imgui.get_style().scrollbar_size) if is_small else all_seen
        size = tile_size((rows, columns), height)
        imgui.begin_child(
            "strip", imgui.ImVec2(0, 0), imgui.ChildFlags_.nav_flattened, imgui.WindowFlags_.horizontal_scrollbar
        )
        for plane_m in planes:
            is_focused = abs(plane_m - context.session.view_settings.plane_m) < SAME_PLANE_M
            if self._tiles.draw(plane_m, context.plane_previews.pictures.get(plane_m), size, is_focused):
                chosen = plane_m
            imgui.same_line()
        imgui.end_child()
        return chosen


# --- A sheet of all focal planes, as large as fits into the image panel ---


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
