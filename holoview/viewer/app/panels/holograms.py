"""The panel of the holograms that are open: a film strip with keys, on which a click switches what is looked at."""

from __future__ import annotations

from contextlib import suppress
from functools import partial

from imgui_bundle import imgui

from holoview.util.errors import UserError
from holoview.util.text import printable
from holoview.viewer.app.context import AppContext
from holoview.viewer.app.panel import Panel
from holoview.viewer.app.user_input import digit_pressed
from holoview.viewer.app.viewport import Viewport, next_corner, tile_size, tile_view_settings
from holoview.viewer.app.widgets import button, command_button, tooltip
from holoview.viewer.render.scene import DeviceImage
from holoview.viewer.render.view_settings import NOW, ComparisonSide

_MOST_KEYS = 9
_CHOSEN = imgui.IM_COL32(80, 160, 245, 255)
_EMPTY = imgui.IM_COL32(20, 20, 22, 255)
_LABEL_BACKGROUND, _LABEL_TEXT = imgui.IM_COL32(0, 0, 0, 170), imgui.IM_COL32(255, 255, 255, 255)
_LEAST_TILE_PX = 40.0


class HologramsPanel(Panel):
    """Shows a picture of each hologram that is open; it opens with the second one."""

    title = "Holograms"
    dock = "Bottom"
    starts_open = False

    def __init__(self) -> None:
        self._count = 0  # of snapshots, in the last frame
        self._before = NOW  # what was shown before what is shown now
        self._tiles: dict[ComparisonSide, Viewport] = {}

    def set_up(self, context: AppContext) -> None:
        add, session = partial(context.commands.add, "Compare"), context.session

        def has_several() -> bool:
            return bool(session.snapshots)

        keys = " ".join(str(number) for number in range(1, _MOST_KEYS + 1))
        add(
            "Show a hologram",
            lambda: self._show_number(context, digit_pressed()),
            keys,
            "By its number in the panel Holograms; 1 is the one that is edited.",
            is_enabled=has_several,
            shares_keys=True,
        )
        before = "The hologram that was shown before; again: back."
        add("Back and forth", lambda: self._show(context, self._before), "Q", before, is_enabled=has_several)
        add(
            "Difference to the shown one",
            lambda: _difference(context),
            "Shift+D",
            "The edited hologram minus the one that is shown, with its number.",
            is_enabled=lambda: session.view_settings.shown != NOW,
        )
        add(
            "Edit the shown one",
            lambda: session.edit_snapshot(session.view_settings.shown.name),
            help="Panels edit a copy of it from now on; the present one is kept.",
            is_enabled=lambda: session.view_settings.shown.kind == "snapshot",
        )

    def wants_to_open(self, context: AppContext) -> bool:
        before, self._count = self._count, len(context.session.snapshots)
        return before == 0 < self._count

    def draw(self, context: AppContext) -> None:
        """Draws the buttons, and the tiles in a row that scrolls."""
        sides = open_sides(context)
        session = context.session
        with suppress(UserError):  # while nothing can be displayed, as without light
            scenes = {side: scene for side in sides[1:] if (scene := session.scene_for(side)) is not None}
            context.kept_pictures.request(scenes)
        self._tiles = {side: tile for side, tile in self._tiles.items() if side in sides}
        if not context.is_read_only:
            command_button(context, "Open beside…", name="open beside")
            imgui.same_line()
        command_button(context, "Edit the shown one", "Edit", name="edit the shown one")
        imgui.same_line()
        command_button(context, "Difference to the shown one", "Difference", name="difference to the shown one")
        imgui.same_line()
        shown = session.view_settings.shown
        if button(context, "Forget", "Forgets the shown one.", name="forget the shown one", is_enabled=shown != NOW):
            session.unpin(shown.name)
        self._draw_strip(context, open_sides(context))

    def _draw_strip(self, context: AppContext, sides: list[ComparisonSide]) -> None:
        if not imgui.begin_child(
            "holograms", imgui.ImVec2(0, 0), imgui.ChildFlags_.nav_flattened, imgui.WindowFlags_.horizontal_scrollbar
        ):
            imgui.end_child()
            return
        height = max(imgui.get_content_region_avail().y - imgui.get_style().scrollbar_size, _LEAST_TILE_PX)
        for number, side in enumerate(sides, start=1):
            size = tile_size(context.session.document.image_shape, height)
            is_clicked = self._draw_tile(context, side, f"{number}  {name_of(context, side)}", size)
            if is_clicked and imgui.get_io().mouse_clicked_last_count[0] == 2 and side != NOW:  # as the button goes up
                context.attempt(context.session.edit_snapshot, side.name)
            elif is_clicked:
                self._show(context, side)
            context.record_item_rect(f"hologram {number}")
            imgui.same_line()
        imgui.end_child()

    def _draw_tile(self, context: AppContext, side: ComparisonSide, name: str, size: tuple[int, int]) -> bool:
        corner = next_corner()
        clicked = imgui.invisible_button(f"##{name}", imgui.ImVec2(*size))
        tooltip(f"{name}\nclick: look at it; double click: edit a copy of it")
        end, canvas = imgui.ImVec2(corner.x + size[0], corner.y + size[1]), imgui.get_window_draw_list()
        picture = _picture_of(context, side)
        if picture is None or not imgui.is_item_visible():
            canvas.add_rect_filled(corner, end, _EMPTY, 2)
        else:
            tile = self._tiles.setdefault(side, Viewport(context, f"hologram {side.kind} {side.name}"))
            tile.draw(picture, None, tile_view_settings(context.session.view_settings), size, corner)
        canvas.push_clip_rect(corner, end, True)
        text = imgui.calc_text_size(name)
        canvas.add_rect_filled(corner, imgui.ImVec2(corner.x + text.x + 8, corner.y + text.y + 2), _LABEL_BACKGROUND, 2)
        canvas.add_text(imgui.ImVec2(corner.x + 4, corner.y + 1), _LABEL_TEXT, name)
        canvas.pop_clip_rect()
        if side == context.session.view_settings.shown or imgui.is_item_hovered():
            canvas.add_rect(corner, end, _CHOSEN, 2, 2.0)
        return clicked

    def _show_number(self, context: AppContext, number: int) -> None:
        sides = open_sides(context)
        if number <= len(sides):
            self._show(context, sides[number - 1])

    def _show(self, context: AppContext, side: ComparisonSide) -> None:
        """Shows a hologram alone, in place of a comparison."""
        shown = context.session.view_settings.shown
        self._before = shown if shown != side else self._before
        is_there = side == NOW or side.name in context.session.snapshots
        context.edit_view("Shown", shown=side if is_there else NOW, compare="off", page="image")


def open_sides(context: AppContext) -> list[ComparisonSide]:
    """The edited hologram, then the others that are open, in the order of their numbers."""
    return [NOW, *(ComparisonSide("snapshot", name) for name in context.session.snapshots)]


def name_of(context: AppContext, side: ComparisonSide) -> str:
    """The name of a hologram that is open."""
    return printable(context.session.document.title if side == NOW else side.label)


def _picture_of(context: AppContext, side: ComparisonSide) -> DeviceImage | None:
    return context.side_renderers.picture(NOW) if side == NOW else context.kept_pictures.picture(side)


def _difference(context: AppContext) -> None:
    context.edit_view("Compare", a=NOW, b=context.session.view_settings.shown, compare="difference", page="image")
