"""Widgets that panels share: buttons, buttons of commands, combo boxes, coloured text, tooltips."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from imgui_bundle import imgui

from holoview.util.text import printable
from holoview.viewer.app import theme
from holoview.viewer.app.context import AppContext

_OLD_ALPHA = 0.45
_ITEM_SHARE, _NARROWEST_EM = 0.65, 3.0  # of the panel's width, as ImGui has it, and in heights of the font
_TOOLTIP_EM = 26.0  # width of tooltips, in heights of the font: about that of a panel


def label_of(text: str) -> str:
    """A name as the label of an item, printable and seen whole: ImGui leaves out what follows two number signs."""
    return re.sub("#(?=#)", "# ", printable(text))


def button(
    context: AppContext,
    label: str,
    tip: str = "",
    *,
    width: float = 0.0,
    name: str = "",
    is_on: bool = False,
    is_enabled: bool = True,
) -> bool:
    """Draws a button, with a tooltip, and returns whether it was clicked.

    width: 0 for that of the label, −1 for all that there is. name: by which scripts find it; "" if they needn't.
    is_on: in the accent colour.
    """
    imgui.begin_disabled(not is_enabled)
    with coloured(imgui.Col_.button, theme.signal_colour("accent") if is_on else None):
        is_clicked = imgui.button(label, imgui.ImVec2(width, 0))
    imgui.end_disabled()
    if name:
        context.record_item_rect(name)
    tooltip(tip)
    return is_clicked


def command_button(
    context: AppContext,
    command: str,
    label: str = "",
    *,
    width: float = 0.0,
    name: str = "",
    is_on: bool = False,
    is_enabled: bool = True,
) -> None:
    """Draws a button that runs a command, whose help is the tooltip; disabled while the command is.

    A viewer to look at hasn't all commands; the buttons of the others do nothing. label: on the button; the command's
    name if empty. Other arguments: see `button`.
    """
    found = context.commands.get(command)
    is_enabled = is_enabled and found is not None and found.is_enabled()
    tip = "" if found is None else found.help
    is_clicked = button(context, label or command, tip, width=width, name=name, is_on=is_on, is_enabled=is_enabled)
    if is_clicked and found is not None:
        context.attempt(found.action)


def share_of_width(count: int) -> float:
    """The width of each of `count` items that fill a line side by side."""
    return (imgui.get_content_region_avail().x - (count - 1) * imgui.get_style().item_spacing.x) / count


def most_across(labels: Sequence[str], most: int) -> int:
    """How many buttons of one width, up to `most`, fill a line side by side so that each of these labels is whole."""
    widest = max(imgui.calc_text_size(label, hide_text_after_double_hash=True).x for label in labels)
    widest += 2 * imgui.get_style().frame_padding.x
    return next((count for count in range(most, 1, -1) if widest <= share_of_width(count)), 1)


def same_line_for(label: str, *, has_arrow: bool = False) -> None:
    """Has the button, or the combo box, of a label stand beside the last item, if the panel has room for it there."""
    width = imgui.calc_text_size(label).x + 2 * imgui.get_style().frame_padding.x
    width += imgui.get_frame_height() if has_arrow else 0.0
    right = imgui.get_item_rect_max().x - imgui.get_cursor_screen_pos().x + imgui.get_style().item_spacing.x
    if right + width <= imgui.get_content_region_avail().x:
        imgui.same_line()


@contextmanager
def room_for_labels(*labels: str) -> Iterator[None]:
    """Draws items so wide that each of these labels beside them is seen, if the panel is wide enough for any item."""
    widest = max(imgui.calc_text_size(label).x for label in labels) + imgui.get_style().item_inner_spacing.x
    share = imgui.get_content_region_avail().x - widest
    imgui.push_item_width(
        max(min(share, _ITEM_SHARE * imgui.get_content_region_avail().x), _NARROWEST_EM * imgui.get_font_size())
    )
    try:
        yield
    finally:
        imgui.pop_item_width()


def header(name: str, short: str = "") -> bool:
    """Draws the header of a part of a panel, which folds it; returns whether it is open. short: in a narrow panel."""
    room = imgui.get_content_region_avail().x - 2 * imgui.get_font_size()  # beside the arrow and the edges
    label = short if short and imgui.calc_text_size(name).x > room else name
    return bool(imgui.collapsing_header(f"{label}###{name}", imgui.TreeNodeFlags_.default_open))


def next_item(label: str, width: float) -> str:
    """Gives the next item this width, and returns its label; that is written above where it has no room beside it."""
    room = imgui.get_content_region_avail().x - width - imgui.get_style().item_inner_spacing.x
    is_above = imgui.calc_text_size(label, hide_text_after_double_hash=True).x > room
    if is_above:
        imgui.text_wrapped(label.partition("##")[0])
    imgui.set_next_item_width(width)
    return f"##{label}" if is_above else label


def combo(label: str, chosen: str, options: Sequence[str], tip: str = "", width: float = 0.0) -> str:
    """Draws a combo box; returns the option that is chosen after this frame. width: 0 for that of other items."""
    if width:
        imgui.set_next_item_width(width)
    is_found, index = imgui.combo(label, options.index(chosen), list(options))
    tooltip(tip)
    return options[index] if is_found else chosen


# --- numbers that are dragged: with Alt ten times finer, and by the keys Up and Down ---


FINE = 0.1
"""The share of a drag, or of a key's step, while Alt is held."""
_STEP_KEYS = (imgui.Key.up_arrow, imgui.Key.down_arrow)
_COARSE, _KEY_STEPS = 10.0, 200  # while Shift is held; steps of a key over the range of a slider


def fine_slider(
    label: str, value: float, low: float, high: float, text: str = "%.3f", flags: int = 0
) -> tuple[bool, float]:
    """ImGui's slider, finer: a drag with Alt goes a tenth as far, and the keys Up and Down step it under the pointer.

    The same keys step a slider that was clicked last. Shift takes ten steps, Alt a tenth of one. Returns whether the
    value has changed, and the value.
    """
    changed, shown = imgui.slider_float(label, value, low, high, text, flags)
    io, turns = imgui.get_io(), _key_steps() / _KEY_STEPS
    if imgui.is_item_active() and io.key_alt and imgui.is_mouse_down(imgui.MouseButton_.left):
        changed, turns = False, io.mouse_delta.x / imgui.calc_item_width() * FINE
    if not turns:
        return (changed, shown) if not (imgui.is_item_active() and io.key_alt) else (changed, value)
    is_logarithmic = bool(flags & imgui.SliderFlags_.logarithmic) and 0 < low < high and value > 0
    moved = value * (high / low) ** turns if is_logarithmic else value + turns * (high - low)
    moved = min(max(moved, min(low, value)), max(high, value))  # a typed value may lie outside
    return moved != value, moved


def fine_slider_int(label: str, value: int, low: int, high: int) -> tuple[bool, int]:
    """A slider of whole numbers, which the keys Up and Down change by one."""
    changed, shown = imgui.slider_int(label, value, low, high)
    steps = _key_steps()
    stepped = min(max(value + (1 if steps > 0 else -1), min(low, value)), max(high, value)) if steps else shown
    return changed or stepped != value, stepped


def fine_drag(label: str, value: float, speed: float, low: float, high: float, text: str) -> tuple[bool, float]:
    """ImGui's number that is dragged, which the keys Up and Down change by the step of a pixel of the drag."""
    changed, shown = imgui.drag_float(label, value, speed, low, high, text)
    steps = _key_steps()
    return (True, min(max(value + steps * speed, low), high)) if steps else (changed, shown)


def is_taken_over(is_entered: bool) -> bool:
    """Whether the text of the last field is taken over: by Enter, or as the field is left; Escape drops it."""
    is_left = imgui.is_item_deactivated_after_edit() and not imgui.is_key_pressed(imgui.Key.escape)
    return is_entered or is_left


def is_item_held() -> bool:
    """Whether the last item is being dragged, or stepped by a key: such edits belong together."""
    return imgui.is_item_active() or any(imgui.is_key_down(key) for key in _STEP_KEYS)


def _key_steps() -> float:
    """The steps by which keys change the last item: the one under the pointer, or that which was clicked last."""
    io = imgui.get_io()
    has_keys = imgui.is_item_hovered() or (imgui.is_item_focused() and not io.nav_visible)  # else arrows go to others
    if io.want_text_input or not has_keys:
        return 0.0
    for key in _STEP_KEYS:
        imgui.set_item_key_owner(key)
    up, down = (int(imgui.is_key_pressed(key)) for key in _STEP_KEYS)
    return (up - down) * (_COARSE if io.key_shift else FINE if io.key_alt else 1.0)


@contextmanager
def coloured(part: imgui.Col_, colour: imgui.ImVec4 | None) -> Iterator[None]:
    """Draws items with another colour of this part of them; None: with their own."""
    if colour is not None:
        imgui.push_style_color(part, colour)
    try:
        yield
    finally:
        if colour is not None:
            imgui.pop_style_color()


@contextmanager
def dimmed(is_old: bool) -> Iterator[None]:
    """Draws items paler while what they tell is of an earlier image."""
    imgui.push_style_var(imgui.StyleVar_.alpha, _OLD_ALPHA if is_old else 1.0)
    try:
        yield
    finally:
        imgui.pop_style_var()


def wrapped_text(text: str, colour: imgui.ImVec4) -> None:
    """Draws a text in a colour, in as many lines as it needs."""
    with coloured(imgui.Col_.text, colour):
        imgui.text_wrapped(text)


def pale() -> imgui.ImVec4:
    """The colour of text that matters less."""
    return imgui.get_style_color_vec4(imgui.Col_.text_disabled)


def tooltip(text: str) -> None:
    """Shows a tooltip while the pointer rests on the last item."""
    if text and imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip | imgui.HoveredFlags_.allow_when_disabled):
        show_tooltip(text)


def show_tooltip(text: str) -> None:
    """Shows a tooltip in this frame; lines that are longer than a panel is wide are wrapped."""
    if imgui.begin_tooltip():
        imgui.push_text_wrap_pos(_TOOLTIP_EM * imgui.get_font_size())
        imgui.text_unformatted(text)
        imgui.pop_text_wrap_pos()
        imgui.end_tooltip()
