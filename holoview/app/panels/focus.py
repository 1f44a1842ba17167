"""The focal plane: a slider, keys, play through the stack, thumbnails of the bench's planes."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np
from imgui_bundle import imgui

from holoview.app.panel import Panel
from holoview.app.plane_strip import PlaneStrip

if TYPE_CHECKING:
    from holoview.app.app import App

_STEP_SHARE = 0.02  # of the range, for keys and the wheel
_SWEEP_S = 3.0  # from the first plane to the last


class FocusPanel(Panel):
    """Where the eye or the camera is focused."""

    title = "Focal plane"
    dock = "Bottom"

    def __init__(self) -> None:
        self.is_playing = False
        self._since = 0.0
        self._thumbnails: PlaneStrip | None = None

    def set_up(self, app: App) -> None:
        add = app.commands.add
        add("Nearer", lambda: self.step(app, -1), "Focal plane", ", Left", "A small step nearer.", is_held=True)
        add("Farther", lambda: self.step(app, 1), "Focal plane", ". Right", "A small step farther.", is_held=True)
        add("Plane before", lambda: self.go_to_plane(app, -1), "Focal plane", "PageUp")
        add("Plane after", lambda: self.go_to_plane(app, 1), "Focal plane", "PageDown")
        add(
            "Play",
            lambda: self.toggle_play(app),
            "Focal plane",
            "Space",
            "Plays through the focal stack; again to stop.",
        )
        self._thumbnails = PlaneStrip(app)

    def range_m(self, app: App) -> tuple[float, float]:
        """The distances that the slider covers."""
        planes = app.session.system.planes_m
        low, high = float(planes.min()), float(planes.max())
        margin = 0.5 * (high - low) or 0.2 * high
        return max(low - margin, 0.0), high + margin

    def focus_at(self, app: App, plane_m: float) -> None:
        """Focuses at a distance."""
        low, high = self.range_m(app)
        app.edit_view("Focal plane", plane_m=float(f"{min(max(plane_m, low), high):.7g}"))

    def step(self, app: App, steps: float) -> None:
        """Moves the focus by small steps."""
        low, high = self.range_m(app)
        self.focus_at(app, app.session.view_settings.plane_m + steps * _STEP_SHARE * (high - low))

    def go_to_plane(self, app: App, direction: int) -> None:
        """Goes to the next of the bench's planes."""
        planes, here = np.sort(app.session.system.planes_m), app.session.view_settings.plane_m
        ahead = planes[planes > here + 1e-9] if direction > 0 else planes[planes < here - 1e-9][::-1]
        if len(ahead):
            self.focus_at(app, float(ahead[0]))

    def toggle_play(self, app: App) -> None:
        """Begins or ends a sweep to and fro."""
        self.is_playing = not self.is_playing
        self._since = time.perf_counter()
        app.window.wake()

    def draw(self, app: App) -> None:
        if self.is_playing:
            self._sweep(app)
        low, high = self.range_m(app)
        if imgui.button("Stop" if self.is_playing else "Play", imgui.ImVec2(52, 0)):
            self.toggle_play(app)
        imgui.same_line()
        imgui.set_next_item_width(-1)
        changed, shown = imgui.slider_float(
            "##plane",
            app.session.view_settings.plane_m * 1e3,
            low * 1e3,
            high * 1e3,
            "%.3f mm",
            imgui.SliderFlags_.no_round_to_format,
        )
        app.record_item_rect("plane")
        if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
            imgui.set_tooltip("Distance of the focal plane behind the last modulator. Ctrl+click: exact entry.")
        if changed:
            self.is_playing = False
            self.focus_at(app, shown * 1e-3)
        if imgui.is_item_deactivated():
            app.session.end_gesture()
        assert self._thumbnails is not None
        chosen = self._thumbnails.draw_strip(app)
        if chosen is not None:
            self.focus_at(app, chosen)

    def _sweep(self, app: App) -> None:
        """There and back as a triangle in time: the frame that is shown is that of now, however long frames take."""
        low, high = float(app.session.system.planes_m.min()), float(app.session.system.planes_m.max())
        phase = ((time.perf_counter() - self._since) / _SWEEP_S) % 2.0
        self.focus_at(app, low + (high - low) * (phase if phase <= 1 else 2 - phase))
        app.window.wake()
