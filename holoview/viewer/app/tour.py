"""A tour of the viewer in steps: a card in a corner of the window, which points at a panel and blocks nothing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from imgui_bundle import imgui

from holoview.viewer.app import theme
from holoview.viewer.app.context import AppContext
from holoview.viewer.app.widgets import button, share_of_width

_WIDTH_EM, _MARGIN = 19.3, 8.0  # of the card, in heights of the font; around it, in pixels
_FIRST_SIZE = 290.0, 240.0  # before the card was drawn once
_CORNERS = ((0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0))  # of the window, in the order of preference
_SEEN = "has_seen_tour"
_Box = tuple[imgui.ImVec2, imgui.ImVec2]
"""Upper left and lower right corner on the screen."""


class Tour:
    """Shows one step after the other, until the user leaves; the preferences store whether a user has seen the tour.

    step: index of the step that is shown; None while the tour is closed.
    """

    title = "Tour"

    def __init__(self, context: AppContext) -> None:
        self._context = context
        self.steps: Sequence[TourStep] = make_tour_steps(context)
        self.step: int | None = None
        self._size = imgui.ImVec2(*_FIRST_SIZE)
        self._is_escape_taken = False
        context.overlays.append(self)
        context.commands.add("Help", "Tour", self.start, "Shift+F1", "Five things to try, one after the other.")

    @property
    def was_seen(self) -> bool:
        """Whether the tour was shown before, to this user."""
        store = self._context.store
        return store is not None and store.preferences.get(_SEEN, False)

    def start(self) -> None:
        """Opens the tour at its first step."""
        self._go_to(0)

    def leave(self) -> None:
        """Closes the tour."""
        self.step = None
        self._context.window.wake()

    def draw(self) -> None:
        """Draws the present step, unless a dialog asks for an answer."""
        if self.step is None or imgui.internal.get_top_most_popup_modal() is not None:
            return
        if not self.was_seen and self._context.store is not None:
            self._context.attempt(self._context.store.preferences.set, _SEEN, True)
        step = self.steps[self.step]
        panel = _panel_box(step.panel)
        if panel is not None:
            accent = imgui.get_color_u32(theme.signal_colour("accent"))
            imgui.get_foreground_draw_list().add_rect(*panel, accent, 4.0, thickness=2.0)
        place = imgui.get_main_viewport()
        status = imgui.get_frame_height_with_spacing()
        room = imgui.ImVec2(place.work_size.x - 2 * _MARGIN, place.work_size.y - 2 * _MARGIN - status)
        origin = imgui.ImVec2(place.work_pos.x + _MARGIN, place.work_pos.y + _MARGIN)
        corner = _free_corner(panel, origin, room, self._size)
        position = imgui.ImVec2(origin.x + corner.x * room.x, origin.y + corner.y * room.y)
        imgui.set_next_window_pos(position, imgui.Cond_.always, corner)
        width = min(_WIDTH_EM * imgui.get_font_size(), room.x)
        imgui.set_next_window_size_constraints(imgui.ImVec2(width, 0), imgui.ImVec2(width, room.y))
        self._draw_card(self.step, step)

    def _draw_card(self, index: int, step: TourStep) -> None:
        flags = theme.CARD | imgui.WindowFlags_.no_focus_on_appearing
        title = f"{self.title}, {index + 1} of {len(self.steps)}: {step.title}###tour"
        imgui.push_style_color(imgui.Col_.border, theme.signal_colour("accent"))
        is_shown, is_open = imgui.begin(title, True, flags)
        imgui.pop_style_color()
        if is_shown:
            imgui.internal.bring_window_to_display_front(imgui.internal.get_current_window())
            imgui.push_text_wrap_pos(0.0)
            imgui.text_unformatted(step.text)
            imgui.pop_text_wrap_pos()
            self._draw_buttons(index, step)
        low, self._size = imgui.get_window_pos(), imgui.get_window_size()
        self._context.item_rects["tour"] = (low.x, low.y, low.x + self._size.x, low.y + self._size.y)
        imgui.end()
        if not is_open or (imgui.is_key_pressed(imgui.Key.escape) and not self._is_escape_taken):
            self.leave()
        self._is_escape_taken = self._has_other_use_of_escape()

    def _draw_buttons(self, index: int, step: TourStep) -> None:
        if button(self._context, f"{step.button}##tour try", name="tour try", width=-1):
            self._context.attempt(step.action)
        width, last = share_of_width(3), len(self.steps) - 1
        for name, label, action in (
            ("leave", "Leave", self.leave),
            ("back", "Back", lambda: self._go_to(index - 1)),
            ("next", "Done" if index == last else "Next", lambda: self._go_to(index + 1)),
        ):
            is_enabled = name != "back" or index > 0
            label = f"{label}##tour {name}"
            if button(self._context, label, name=f"tour {name}", width=width, is_enabled=is_enabled):
                action()
            if name != "next":
                imgui.same_line()

    def _go_to(self, index: int) -> None:
        """Shows a step and opens its panel; behind the last step the tour ends."""
        if index == len(self.steps):
            self.leave()
            return
        self.step = index
        self._context.show_panel(self.steps[index].panel)

    def _has_other_use_of_escape(self) -> bool:
        """Whether the key Escape will close or end something else, which comes before the tour."""
        io, leaves_look = imgui.get_io(), self._context.commands.get("No comparison")
        return (
            (leaves_look is not None and leaves_look.is_enabled())
            or bool(self._context.help_overlay.page)
            or bool(io.config_flags & imgui.ConfigFlags_.nav_enable_keyboard.value)
            or io.want_text_input
            or imgui.is_popup_open("", imgui.PopupFlags_.any_popup)
        )


def _panel_box(title: str) -> _Box | None:
    """Where a panel was drawn; None while it isn't visible."""
    window = imgui.internal.find_window_by_name(title)
    if window is None or not window.active or window.hidden:
        return None
    return window.pos, imgui.ImVec2(window.pos.x + window.size.x, window.pos.y + window.size.y)


def _free_corner(panel: _Box | None, origin: imgui.ImVec2, room: imgui.ImVec2, size: imgui.ImVec2) -> imgui.ImVec2:
    """The corner of the window, (x, y) of 0 or 1, in which a card of `size` covers the least of a panel."""

    def covered(corner: tuple[float, float]) -> float:
        assert panel is not None
        low = origin.x + corner[0] * (room.x - size.x), origin.y + corner[1] * (room.y - size.y)
        width = min(low[0] + size.x, panel[1].x) - max(low[0], panel[0].x)
        height = min(low[1] + size.y, panel[1].y) - max(low[1], panel[0].y)
        return max(width, 0.0) * max(height, 0.0)

    return imgui.ImVec2(*(_CORNERS[0] if panel is None else min(_CORNERS, key=covered)))


# --- The steps of the tour: what each says, the panel that it is about, and what its button does ---


_EFFECT = {"crosstalk": {"sigma": 0.4}}


@dataclass(frozen=True)
class TourStep:
    """A step: its title and text, the title of the panel that it shows, and a button with what it does."""

    title: str
    text: str
    panel: str
    button: str
    action: Callable[[], None]


def make_tour_steps(context: AppContext) -> tuple[TourStep, ...]:
    """The steps, whose buttons act on the viewer of `context`."""
    run = context.commands.run
    steps = (
        TourStep(
            "Focus",
            "The image is what an eye sees of a hologram. It has depth: drag the slider, or turn the wheel over the "
            "image with Ctrl held. At 9 mm the back of the still life is sharp, at 11 mm its front.",
            "Focal plane",
            "Play through all planes / stop",
            partial(run, "Play"),
        ),
        TourStep(
            "Lasers",
            "Eight lasers shine at once, and their speckle averages out. The keys 1 to 8 show one of them alone, 0 all "
            "again. Drag a peak to change its wavelength and power.",
            "Lasers",
            "One laser alone / all",
            lambda: context.edit_view("Solo", solo=0 if context.session.view_settings.solo is None else None),
        ),
        TourStep(
            "Effects",
            "A real bench differs from the plain model. Switch on an effect to see what it does to the image. Ctrl+Z "
            "undoes this, as every edit.",
            "Effects",
            "Crosstalk of the pixels on / off",
            lambda: context.change("Effects", "effects", {} if context.session.system.effects else _EFFECT),
        ),
        TourStep(
            "Optimise",
            "Ctrl+Enter finds patterns for the target. It begins with random ones: the picture comes out of the "
            "speckle. Keep ends it early, Cancel brings these patterns back. T compares the image with the target.",
            "Optimise",
            "Optimise",
            partial(run, "Optimise"),
        ),
        TourStep(
            "Your pictures",
            "Drop a picture on the window, or open one by Ctrl+O: it becomes the target. Ctrl+S saves the hologram, "
            "Ctrl+E the image as it is seen. ? shows all keys, and Ctrl+P finds any command.",
            "Files",
            "Open a picture…",
            partial(run, "Open…"),
        ),
    )
    return steps[:-1] if context.is_read_only else steps
