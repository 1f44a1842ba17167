"""The panel of the view settings: page, exposure, channel, false colour, black and white, comparison."""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import partial

from imgui_bundle import imgui

from holoview.light.colour import fitting_stops
from holoview.light.model import preset
from holoview.viewer.app.context import AppContext
from holoview.viewer.app.panel import Panel
from holoview.viewer.app.widgets import (
    button,
    command_button,
    fine_slider,
    fine_slider_int,
    label_of,
    room_for_labels,
    tooltip,
)
from holoview.viewer.document.document import Gesture
from holoview.viewer.document.optimisation_job import SchemeComparisonJob
from holoview.viewer.render.view_settings import (
    ACHROMATIC,
    CHANNELS,
    COMPARISON_MODES,
    FALSE_COLOURS,
    NOW,
    PAGES,
    QUANTITIES,
    TARGET,
    ComparisonSide,
    ViewSettings,
    displayed_side,
)

_STOP = 0.25
_FRAMES_A_SECOND = 8
_PAGE_DOCS = {
    "image": "What is seen at the focal plane.",
    "planes": "All focal planes of the bench beside each other.",
    "phase": "The pattern on a modulator, as phase at the laser in the middle; a turn of hue is a wave.",
    "field": "The complex field of the solo laser at a stage of the bench: its amplitude, phase, parts or spectrum.",
    "spectrum": "Where the light leaves to, around the modulator's first order.",
    "target": "What the hologram should show at the focal plane.",
}
_PAGE_NAMES = {"spectrum": "eyebox"}
_COLOUR_NAMES = {"": "grey"}
_COMPARE_DOCS = {
    "off": "One image.",
    "hold": "A; B while its key is held.",
    "wipe": "A left of a line, B right of it; drag the line.",
    "side-by-side": "A and B beside each other, the same part of both.",
    "difference": "A minus B.",
}


class ViewPanel(Panel):
    """Edits the view settings."""

    title = "View"
    dock = "Low right"

    def __init__(self) -> None:
        self._plays_since: float | None = None  # by the clock, while frames are played
        self._played = Gesture()  # one step of undo

    def set_up(self, context: AppContext) -> None:
        add = partial(context.commands.add, "Image")
        add("Brighter", lambda: _adjust_exposure(context, _STOP), "E", "A quarter stop.", repeats=True)
        add("Darker", lambda: _adjust_exposure(context, -_STOP), "Shift+E", "A quarter stop.", repeats=True)
        tone = partial(context.edit_view, "Reset tone", exposure_stops=0.0, gamma=1.0, low=0.0, high=1.0)
        add("Reset tone", tone, "R", "Exposure, gamma, black and white as at first.")
        add("Next channel", lambda: _cycle(context, "channel", CHANNELS), "C")
        add("False colour", lambda: _cycle(context, "false_colour", FALSE_COLOURS), "K", "For single channels.")
        add("Next page", lambda: _cycle(context, "page", PAGES), "G", "Image, planes, phase, field, eyebox, target.")
        add = partial(context.commands.add, "Compare")
        for name, keys in (("wipe", "W"), ("side-by-side", "S"), ("difference", "D"), ("hold", "H")):
            add(f"Compare: {name}", partial(_compare, context, name), keys, _COMPARE_DOCS[name])
        session = context.session
        add(
            "No comparison",
            partial(_leave, context),
            "Escape",
            "All as before the comparison began; from the light behind an element back to the image; drops a tool.",
            is_enabled=lambda: (
                bool(context.drag_tool)
                or session.view_settings.compare != "off"
                or _shows_light_behind(session.view_settings)
                or bool(_coming(context))
            ),
        )
        add("Swap A and B", lambda: _swap(context), "X", "A becomes B and B becomes A.")
        add(
            "Pin a snapshot", lambda: _pin(context), "P", "Keeps the present state under a name, to compare with later."
        )
        add("Compare with target", lambda: context.edit_view("Compare", b=TARGET, compare="wipe"), "T")

    def draw(self, context: AppContext) -> None:
        view = context.session.view_settings
        with room_for_labels("black, white"):
            _combo(context, "page", PAGES, view.page, _PAGE_DOCS, names=_PAGE_NAMES)
            if context.session.system.frames > 1:
                self._draw_frames(context, view)
                view = context.session.view_settings
            self._draw_tone(context, view)
            if view.page == "phase":
                self._draw_pattern_choice(context, view)
            if view.page == "field":
                _combo(context, "stage", context.session.system.stages, view.stage, {})
                _combo(context, "quantity", QUANTITIES, view.quantity, {})
            imgui.separator_text("Compare")
            self._draw_compare(context, view)

    def _draw_tone(self, context: AppContext, view: ViewSettings) -> None:
        if _slider(context, "exposure", view.exposure_stops, -8.0, 8.0, "%+.2f stops", 0.0, "Brighter by 2^stops."):
            view = context.session.view_settings
        _slider(context, "gamma", view.gamma, 0.3, 3.0, "%.2f", 1.0, "On top of the sRGB curve; 1 changes nothing.")
        _combo(
            context, "channel", CHANNELS, view.channel, {}, "What is shown of the colours: all, or a single channel."
        )
        if view.channel != "colour":
            doc = "A colour map for the single channel."
            _combo(context, "false_colour", FALSE_COLOURS, view.false_colour, {}, doc, _COLOUR_NAMES)
        changed, low, high = imgui.drag_float_range2(
            "black, white", view.low, view.high, 0.005, -10.0, 10.0, "%.3f", "%.3f", imgui.SliderFlags_.always_clamp
        )
        context.record_item_rect("black, white")
        tooltip("Values of a channel, after exposure, that are shown black and white.")
        if changed and low < high:
            context.edit_view("Black and white", low=low, high=high)
        is_on, keeps_hue = imgui.checkbox("keep hues", view.keeps_hue)
        context.record_item_rect("keep hues")
        tooltip(
            "Colours that the screen can't show keep their hue; else each channel is clipped. Numbers don't change."
        )
        if is_on:
            context.edit_view("Keep hues", keeps_hue=keeps_hue)
        command_button(context, "Reset tone", "Reset")
        imgui.same_line()
        tip = "An exposure at which only the brightest hundredth of the image is beyond white."
        if button(context, "Fit brightness", tip):
            _fit_brightness(context)

    def _draw_frames(self, context: AppContext, view: ViewSettings) -> None:
        """Draws the choice of a frame, and a button that plays them one after another."""
        frames = context.session.system.frames
        if self._plays_since is not None:
            frame = int((time.perf_counter() - self._plays_since) * _FRAMES_A_SECOND) % frames
            show = partial(context.session.edit_view, "Frame", merge_key=self._played)
            context.attempt(show, frame=frame, is_one_frame=True)
            context.window.wake()
        changed, number = fine_slider_int("frame", view.frame + 1, 1, frames)
        context.record_item_rect("frame")
        tooltip("Which frame is shown, in the image too if it is alone.")
        if changed:
            self._plays_since = None
            context.edit_view("Frame", frame=number - 1)
        if imgui.is_item_deactivated():
            context.session.end_gesture()
        is_on, is_alone = imgui.checkbox("alone", view.is_one_frame)
        context.record_item_rect("frame alone")
        tooltip("The image of this frame alone, in place of the mean of all, which an eye or a camera sees.")
        if is_on:
            context.edit_view("Frame alone", is_one_frame=is_alone)
        imgui.same_line()
        is_playing = self._plays_since is not None
        tip = f"Shows the frames one after another, {_FRAMES_A_SECOND} a second."
        if button(context, "Stop" if is_playing else "Play", tip, name="play frames"):
            self._plays_since, self._played = None if is_playing else time.perf_counter(), Gesture()
            context.window.wake()

    def _draw_pattern_choice(self, context: AppContext, view: ViewSettings) -> None:
        modulators = len(context.session.system.modulators)
        if modulators > 1:
            names = [str(number + 1) for number in range(modulators)]
            changed, chosen = imgui.combo("modulator", view.modulator, names)
            if changed:
                context.edit_view("Modulator", modulator=chosen)

    def _draw_compare(self, context: AppContext, view: ViewSettings) -> None:
        _combo(context, "compare", COMPARISON_MODES, view.compare, _COMPARE_DOCS)
        for key in ("a", "b"):
            self._draw_side(context, key, getattr(view, key))
        if view.compare == "wipe":
            _slider(context, "wipe", view.wipe, 0.0, 1.0, "%.2f", 0.5, "Share of the width that shows A.")
        command_button(context, "Pin a snapshot", "Pin")
        imgui.same_line()
        command_button(context, "Swap A and B", "Swap")
        for name in context.session.snapshots:
            _draw_snapshot(context, name)

    def _draw_side(self, context: AppContext, key: str, chosen: ComparisonSide) -> None:
        if not imgui.begin_combo(key.upper(), label_of(chosen.label)):
            return
        sides = [NOW, TARGET, ACHROMATIC, *(ComparisonSide("snapshot", name) for name in context.session.snapshots)]
        for side in [*sides, *(ComparisonSide("preset", name) for name in preset.short_form_names())]:
            text = f"preset {side.label}" if side.kind == "preset" else label_of(side.label)
            imgui.push_id(side.kind)  # a snapshot may be called "Target"
            if imgui.selectable(text, side == chosen)[0]:
                context.edit_view("Compare", **{key: side})
            imgui.pop_id()
        imgui.end_combo()


def _shows_light_behind(view: ViewSettings) -> bool:
    """Whether the image shows the intensity at a stage, as right behind an element."""
    return view.page == "field" and view.quantity == "intensity"


def _coming(context: AppContext) -> list[SchemeComparisonJob]:
    """The comparisons of schemes that are being computed, and will be shown."""
    return [job for job in context.session.jobs.active if isinstance(job, SchemeComparisonJob)]


def _leave(context: AppContext) -> None:
    """Drops the tool for a region or a line, else ends a comparison, be it one that is still being computed, else the
    view of the light behind an element."""
    if context.drag_tool:
        context.drag_tool = ""
    elif coming := _coming(context):
        for job in coming:
            job.cancel()
    elif context.session.view_settings.compare == "off":
        context.edit_view("Image", page="image")
    else:
        context.session.end_comparison()


def _draw_snapshot(context: AppContext, name: str) -> None:
    imgui.push_id(name)
    tip = "Forgets this snapshot; what compares with it compares with the present."
    is_forgotten = button(context, "×", tip, name=f"forget {name}")
    imgui.same_line()
    _, text = imgui.input_text("snapshot", name)
    imgui.pop_id()
    context.record_item_rect(f"snapshot {name}")
    is_done = imgui.is_item_deactivated_after_edit()
    tooltip("The name of a snapshot: type another; Enter takes it over, Escape leaves it.")
    if is_done and text.strip() != name:
        context.attempt(context.session.rename_snapshot, name, text.strip())
    if is_forgotten:
        context.session.unpin(name)


def _slider(
    context: AppContext, key: str, value: float, low: float, high: float, text: str, reset: float, doc: str
) -> bool:
    field = "exposure_stops" if key == "exposure" else key
    changed, value_shown = fine_slider(key, value, low, high, text)
    context.record_item_rect(key)
    tooltip(f"{doc} Ctrl+click: exact entry; right click: {reset:g}.")
    if imgui.is_item_clicked(imgui.MouseButton_.right):
        changed, value_shown = True, reset
    if changed:
        context.edit_view(key.capitalize(), **{field: value_shown})
    if imgui.is_item_deactivated():
        context.session.end_gesture()
    return changed


def _combo(
    context: AppContext,
    field: str,
    options: tuple[str, ...],
    value: str,
    docs: Mapping[str, str],
    doc: str = "",
    names: Mapping[str, str] | None = None,
) -> None:
    """A field of the view settings; names: of options that are shown under another name."""
    label, names = field.replace("_", " "), names or {}
    if imgui.begin_combo(label, names.get(value, value)):
        for option in options:
            if imgui.selectable(names.get(option, option), option == value)[0]:
                context.edit_view(label.capitalize(), **{field: option})
            if option in docs:
                tooltip(docs[option])
        imgui.end_combo()
    context.record_item_rect(label)
    tooltip(doc or docs.get(value, ""))


def _adjust_exposure(context: AppContext, stops: float) -> None:
    context.edit_view("Exposure", exposure_stops=context.session.view_settings.exposure_stops + stops)


def _fit_brightness(context: AppContext) -> None:
    xyz = context.side_renderers.xyz(displayed_side(context.session.view_settings))
    if xyz is None:
        context.session.messages.post("the full image isn't there yet: try again in a moment")
        return
    context.edit_view("Exposure", exposure_stops=round(fitting_stops(xyz), 2))


def _cycle(context: AppContext, field: str, options: tuple[str, ...]) -> None:
    index = options.index(getattr(context.session.view_settings, field))
    context.edit_view(field.replace("_", " ").capitalize(), **{field: options[(index + 1) % len(options)]})


def _compare(context: AppContext, name: str) -> None:
    if context.session.view_settings.compare == name:
        context.attempt(context.session.end_comparison)
    else:
        context.edit_view("Compare", compare=name)


def _swap(context: AppContext) -> None:
    view = context.session.view_settings
    context.edit_view("Swap", a=view.b, b=view.a)


def _pin(context: AppContext) -> None:
    name = context.session.pin()
    number = list(context.session.snapshots).index(name) + 2  # 1 is the hologram that is edited
    key = f"the key {number} shows it; " if number <= 9 else ""
    context.session.messages.post(f"pinned as {name}: {key}choose it as A or B to compare with")
