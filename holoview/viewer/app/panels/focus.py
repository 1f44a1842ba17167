"""The panel of the focal plane: a slider, a sweep through the planes, and previews of all of them."""

from __future__ import annotations

import time
from functools import partial

from imgui_bundle import imgui

from holoview.viewer.app.context import AppContext
from holoview.viewer.app.panel import Panel
from holoview.viewer.app.viewport import PlaneStrip
from holoview.viewer.app.widgets import command_button, fine_slider, tooltip
from holoview.viewer.document.document import Gesture
from holoview.viewer.document.focus_edits import (
    dioptres_text,
    focus_at,
    focus_at_next_plane,
    focus_range_m,
    look_on_other_side,
    step_focus,
)

_SWEEP_S = 3.0  # from the first plane to the last
_PLANE_DOC = (
    "Distance of the focal plane behind the last modulator: larger is nearer to the viewer. Ctrl+click: exact entry."
)
_PLANE_DOC_OF_FIELD = "Distance of the focal plane from the field; negative before it. Ctrl+click: exact entry."


class FocusPanel(Panel):
    """Moves the focal plane. is_playing: whether a sweep is running."""

    title = "Focal plane"
    dock = "Bottom"

    def __init__(self) -> None:
        self.is_playing = False
        self._since, self._played = 0.0, Gesture()
        self._thumbnails: PlaneStrip | None = None

    def set_up(self, context: AppContext) -> None:
        add, session = partial(context.commands.add, "Focal plane"), context.session
        add("Farther", lambda: step_focus(session, -1), ", Left", "A small step farther.", repeats=True)
        add("Nearer", lambda: step_focus(session, 1), ". Right", "A small step nearer.", repeats=True)
        add("Plane before", lambda: focus_at_next_plane(session, -1), "PageUp")
        add("Plane after", lambda: focus_at_next_plane(session, 1), "PageDown")
        add("Play", lambda: self.toggle_play(context), "Space", "Plays through the focal stack; again to stop.")
        other = "A field's image on the other side of its plane: the sign of z, or of the phase, is the other one."
        look = partial(look_on_other_side, session)
        add("Other side", look, help=other, is_enabled=lambda: session.system.is_field)
        self._thumbnails = PlaneStrip(context)

    def toggle_play(self, context: AppContext) -> None:
        """Starts or stops a sweep through the planes and back."""
        self.is_playing = not self.is_playing
        self._since, self._played = time.perf_counter(), Gesture()
        context.window.wake()

    def draw(self, context: AppContext) -> None:
        if self.is_playing:
            self._sweep(context)
        low, high = focus_range_m(context.session.system)
        width = max(52.0, imgui.calc_text_size("Stop").x + 2 * imgui.get_style().frame_padding.x)
        command_button(context, "Play", "Stop" if self.is_playing else "Play", width=width)
        imgui.same_line()
        if context.session.system.is_field:
            command_button(context, "Other side", name="other side")
            imgui.same_line()
        imgui.set_next_item_width(-1)
        changed, shown = fine_slider(
            "##plane",
            context.session.view_settings.plane_m * 1e3,
            low * 1e3,
            high * 1e3,
            _slider_text(context),
            imgui.SliderFlags_.no_round_to_format,
        )
        context.record_item_rect("plane")
        tooltip(_PLANE_DOC_OF_FIELD if context.session.system.is_field else _PLANE_DOC)
        if changed:
            self.is_playing = False
            context.attempt(focus_at, context.session, shown * 1e-3)
        if imgui.is_item_deactivated():
            context.session.end_gesture()
        assert self._thumbnails is not None
        chosen = self._thumbnails.draw(context)
        if chosen is not None:
            context.attempt(focus_at, context.session, chosen)

    def _sweep(self, context: AppContext) -> None:
        """Moves the plane as a triangle wave in real time, however long frames take."""
        planes_m = context.session.system.planes_m
        low, high = float(planes_m.min()), float(planes_m.max())
        if low == high:
            low, high = focus_range_m(context.session.system)
        phase = ((time.perf_counter() - self._since) / _SWEEP_S) % 2.0
        plane_m = low + (high - low) * (phase if phase <= 1 else 2 - phase)
        context.attempt(focus_at, context.session, plane_m, self._played)
        context.window.wake()


def _slider_text(context: AppContext) -> str:
    """The format of the slider's value, with an eye followed by its dioptres."""
    if context.session.system.eye is None:
        return "%.3f mm"
    return f"%.3f mm   {dioptres_text(context.session.system, context.session.view_settings.plane_m)}"
