"""How the image is looked at: page, exposure, channel, false colour, black and white, comparison."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from imgui_bundle import imgui

from holoview.app.panel import Panel
from holoview.app.parameter_widgets import tooltip
from holoview.model import preset
from holoview.session.view_settings import (
    CHANNELS,
    COMPARISON_MODES,
    FALSE_COLOURS,
    NOW,
    PAGES,
    TARGET,
    ComparisonSide,
    ViewSettings,
    displayed_side,
)

if TYPE_CHECKING:
    from holoview.app.app import App

_STOP = 0.25
_BRIGHT_PERCENT = 99.0
_PAGE_DOCS = {
    "image": "What is seen at the focal plane.",
    "planes": "All focal planes of the bench beside each other.",
    "phase": "The pattern on a modulator, as phase at the laser in the middle; a turn of hue is a wave.",
    "spectrum": "Where the light leaves to: the eyebox, around the modulator's first order.",
    "target": "What the hologram should show at the focal plane.",
}
_COMPARE_DOCS = {
    "off": "One image.",
    "hold": "A; B while its key is held.",
    "wipe": "A left of a line, B right of it; drag the line.",
    "side-by-side": "A and B beside each other, the same part of both.",
    "difference": "A minus B.",
}


class ViewPanel(Panel):
    """Exposure, channels and comparison."""

    title = "View"
    dock = "Low right"

    def set_up(self, app: App) -> None:
        add, session = app.commands.add, app.session
        add("Brighter", lambda: _adjust_exposure(app, _STOP), "Image", "E", "A quarter stop.", is_held=True)
        add("Darker", lambda: _adjust_exposure(app, -_STOP), "Image", "Shift+E", "A quarter stop.", is_held=True)
        add("Reset tone", lambda: _reset(app), "Image", "R", "Exposure, gamma, black and white as at first.")
        add("Next channel", lambda: _cycle(app, "channel", CHANNELS), "Image", "C")
        add("False colour", lambda: _cycle(app, "false_colour", FALSE_COLOURS), "Image", "K", "For single channels.")
        add("Next page", lambda: _cycle(app, "page", PAGES), "Image", "G", "Image, planes, phase, spectrum, target.")
        for name, keys in (("off", "Escape"), ("wipe", "W"), ("side-by-side", "S"), ("difference", "D"), ("hold", "H")):
            title = "No comparison" if name == "off" else f"Compare: {name}"
            action = partial(_compare, app, name)
            add(title, action, "Compare", keys, _COMPARE_DOCS[name], is_possible=lambda: not app.help_overlay.page)
        add(
            "Swap A and B",
            lambda: app.edit_view("Swap", a=session.view_settings.b, b=session.view_settings.a),
            "Compare",
            "X",
        )
        add("Pin a snapshot", lambda: _pin(app), "Compare", "P", "Keeps the present state, to compare with later.")
        add("Compare with target", lambda: app.edit_view("Compare", b=TARGET, compare="wipe"), "Compare", "T")

    def draw(self, app: App) -> None:
        look = app.session.view_settings
        imgui.push_item_width(imgui.get_content_region_avail().x * 0.62)
        _chosen(app, "page", PAGES, look.page, _PAGE_DOCS)
        self._draw_tone(app, look)
        if look.page == "phase":
            self._draw_pattern_choice(app, look)
        imgui.separator_text("Compare")
        self._draw_compare(app, look)
        imgui.pop_item_width()

    def _draw_tone(self, app: App, look: ViewSettings) -> None:
        if _slider(app, "exposure", look.exposure_stops, -8.0, 8.0, "%+.2f stops", 0.0, "Brighter by 2^stops."):
            look = app.session.view_settings
        _slider(app, "gamma", look.gamma, 0.3, 3.0, "%.2f", 1.0, "On top of the sRGB curve; 1 changes nothing.")
        _chosen(app, "channel", CHANNELS, look.channel, {}, "What is shown of the colours: all, or a single channel.")
        if look.channel != "colour":
            _chosen(app, "false_colour", FALSE_COLOURS, look.false_colour, {}, "A colour map for the single channel.")
        changed, low, high = imgui.drag_float_range2(
            "black, white", look.low, look.high, 0.005, -10.0, 10.0, "%.3f", "%.3f", imgui.SliderFlags_.always_clamp
        )
        app.record_item_rect("black, white")
        tooltip("Values of a channel, after exposure, that are shown black and white.")
        if changed and low < high:
            app.edit_view("Black and white", low=low, high=high)
        if imgui.button("Reset"):
            _reset(app)
        tooltip("Exposure, gamma, black and white as at first.")
        imgui.same_line()
        if imgui.button("Fit brightness"):
            _fit_brightness(app)
        tooltip("An exposure at which only the brightest hundredth of the image is beyond white.")

    def _draw_pattern_choice(self, app: App, look: ViewSettings) -> None:
        frames, modulators = app.session.system.drive_shape[:2]
        for name, value, count in (("modulator", look.modulator, modulators), ("frame", look.frame, frames)):
            if count > 1:
                changed, shown = imgui.combo(name, value, [str(number + 1) for number in range(count)])
                if changed:
                    app.edit_view(name.capitalize(), **{name: shown})

    def _draw_compare(self, app: App, look: ViewSettings) -> None:
        _chosen(app, "compare", COMPARISON_MODES, look.compare, _COMPARE_DOCS)
        for key in ("a", "b"):
            self._draw_side(app, key, getattr(look, key))
        if look.compare == "wipe":
            _slider(app, "wipe", look.wipe, 0.0, 1.0, "%.2f", 0.5, "Share of the width that shows A.")
        if imgui.button("Pin"):
            _pin(app)
        tooltip("Keeps the present state under a name, to compare with later.")
        imgui.same_line()
        if imgui.button("Swap"):
            app.edit_view("Swap", a=look.b, b=look.a)
        tooltip("A becomes B and B becomes A.")
        for name in app.session.snapshots:
            _draw_snapshot(app, name)

    def _draw_side(self, app: App, key: str, chosen: ComparisonSide) -> None:
        if not imgui.begin_combo(key.upper(), chosen.label):
            return
        sides = [NOW, TARGET, *(ComparisonSide("snapshot", name) for name in app.session.snapshots)]
        for side in [*sides, *(ComparisonSide("preset", name) for name in preset.names())]:
            text = f"preset {side.label}" if side.kind == "preset" else side.label
            imgui.push_id(side.kind)  # a snapshot may be called "Target"
            if imgui.selectable(text, side == chosen)[0]:
                app.edit_view("Compare", **{key: side})
            imgui.pop_id()
        imgui.end_combo()


def _draw_snapshot(app: App, name: str) -> None:
    imgui.push_id(name)
    is_forgotten = imgui.button("×")
    app.record_item_rect(f"forget {name}")
    tooltip("Forgets this snapshot; what compares with it compares with the present.")
    imgui.same_line()
    _, text = imgui.input_text("snapshot", name)
    imgui.pop_id()
    app.record_item_rect(f"snapshot {name}")
    is_done = imgui.is_item_deactivated_after_edit()
    tooltip("The name of a snapshot: type another; Enter takes it over, Escape leaves it.")
    if is_done and text.strip() != name:
        app.attempt(app.session.rename_snapshot, name, text.strip())
    if is_forgotten:
        app.session.unpin(name)


def _slider(app: App, key: str, value: float, low: float, high: float, text: str, reset: float, doc: str) -> bool:
    field = "exposure_stops" if key == "exposure" else key
    changed, shown = imgui.slider_float(key, value, low, high, text)
    app.record_item_rect(key)
    tooltip(f"{doc} Ctrl+click: exact entry; right click: {reset:g}.")
    if imgui.is_item_clicked(imgui.MouseButton_.right):
        changed, shown = True, reset
    if changed:
        app.edit_view(key.capitalize(), **{field: shown})
    if imgui.is_item_deactivated():
        app.session.end_gesture()
    return changed


def _chosen(app: App, field: str, options: tuple[str, ...], value: str, docs: dict[str, str], doc: str = "") -> None:
    label = field.replace("_", " ")
    if imgui.begin_combo(label, value or "grey"):
        for option in options:
            if imgui.selectable(option or "grey", option == value)[0]:
                app.edit_view(label.capitalize(), **{field: option})
            if option in docs:
                tooltip(docs[option])
        imgui.end_combo()
    app.record_item_rect(label)
    tooltip(doc or docs.get(value, ""))


def _adjust_exposure(app: App, stops: float) -> None:
    app.edit_view("Exposure", exposure_stops=app.session.view_settings.exposure_stops + stops)


def _reset(app: App) -> None:
    app.edit_view("Reset tone", exposure_stops=0.0, gamma=1.0, low=0.0, high=1.0)


def _fit_brightness(app: App) -> None:
    xyz = app.side_renderers.xyz(displayed_side(app.session.view_settings))
    if xyz is None:
        app.session.messages.post("the full image isn't there yet: try again in a moment")
        return
    bright = float(np.percentile(xyz[..., 1], _BRIGHT_PERCENT))
    if bright > 0:
        app.edit_view("Exposure", exposure_stops=round(-float(np.log2(bright)), 2))


def _cycle(app: App, field: str, options: tuple[str, ...]) -> None:
    index = options.index(getattr(app.session.view_settings, field))
    app.edit_view(field.replace("_", " ").capitalize(), **{field: options[(index + 1) % len(options)]})


def _compare(app: App, name: str) -> None:
    is_on = app.session.view_settings.compare == name
    app.edit_view("Compare", compare="off" if is_on else name)


def _pin(app: App) -> None:
    name = app.session.pin()
    app.session.messages.post(f"pinned as {name}: choose it as A or B to compare with")
