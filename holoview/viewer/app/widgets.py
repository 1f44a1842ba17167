"""Widgets that panels share: buttons, buttons of commands, combo boxes, coloured text, tooltips."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from imgui_bundle import imgui

from holoview.viewer.app import theme
from holoview.viewer.app.context import AppContext

_OLD_ALPHA = 0.45
_ITEM_SHARE, _NARROWEST_EM = 0.65, 3.0  # of the panel's width, as ImGui has it, and in heights of the font
_TOOLTIP_EM = 26.0  # width of tooltips, in heights of the font: about that of a panel


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


def combo(label: str, chosen: str, options: Sequence[str], tip: str = "", width: float = 0.0) -> str:
    """Draws a combo box; returns the option that is chosen after this frame. width: 0 for that of other items."""
    if width:
        imgui.set_next_item_width(width)
    is_found, index = imgui.combo(label, options.index(chosen), list(options))
    tooltip(tip)
    return options[index] if is_found else chosen


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
