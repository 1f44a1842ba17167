"""The contents of the panels of an open rig; loaded only when a rig is opened.

RigControls           its state, the big switch that turns the lasers off, patterns, camera and stage, captures, plans
draw_live_diagnosis   the diagnosis that follows the captures
CameraPanes           what the camera sees beside its prediction, with wipe, difference in σ, χ²/n, and values under the
                      pointer
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from imgui_bundle import imgui

from holoview.bench.diagnose.report.diagnosis import Diagnosis
from holoview.bench.experiment.rig_bench import system_of_rig
from holoview.bench.rig.description import RigDescription
from holoview.holograms.view import random_drive
from holoview.light.model.drives import drive_fits
from holoview.viewer.app import plots, theme
from holoview.viewer.app.context import AppContext
from holoview.viewer.app.file_dialog import FileDialog, FileRequest
from holoview.viewer.app.readout import draw_centred_text, draw_label
from holoview.viewer.app.theme import laser_colour
from holoview.viewer.app.viewport import Viewport
from holoview.viewer.app.widgets import (
    button,
    coloured,
    combo,
    command_button,
    fine_slider,
    pale,
    share_of_width,
    tooltip,
    wrapped_text,
)
from holoview.viewer.document.document import middle_plane
from holoview.viewer.document.live_view import FIRST, MOST, LivePicture, LiveView, cause_text
from holoview.viewer.document.rig_session import (
    MODELS,
    RigSession,
    drive_pattern,
    file_pattern,
    flat_pattern,
    random_pattern,
)
from holoview.viewer.render.scene import DeviceImage
from holoview.viewer.render.view_settings import ViewSettings

_SWITCHES_A_LINE = 4
_OFF_HEIGHT = 2.2  # of the switch that turns the lasers off, in lines
_RED = imgui.ImVec4(0.68, 0.10, 0.10, 1.0)
_BRIGHT_RED = imgui.ImVec4(0.85, 0.16, 0.14, 1.0)
_WHITE = imgui.ImVec4(1.0, 1.0, 1.0, 1.0)
_KINDS = ("the viewer's frame", "random", "flat", "a hologram file")
_TOO_BRIGHT = 1e-3  # share of saturated pixels beyond which it is said in colour
_MAX_BLUR_PX, _PLOT_EM = 20.0, 6.5
_TIMES_S = (5.0, 600.0)


class RigControls:
    """The panel of an open rig. dialog: asks for files."""

    def __init__(self, dialog: FileDialog) -> None:
        self._dialog = dialog
        self.lasers, self.patterns = LaserSection(), PatternSection()
        self.devices, self.captures = DeviceSection(), CaptureSection()

    def draw(self, context: AppContext, rig: RigSession) -> None:
        """Draws the lasers' switch, which stays in its place, and below it all else."""
        assert rig.rig is not None
        _draw_state(context, rig, rig.rig.name)
        imgui.begin_disabled(context.is_read_only)
        _draw_off(context, rig)
        imgui.begin_child("rig sections", child_flags=imgui.ChildFlags_.nav_flattened)
        imgui.begin_disabled(not rig.is_open)
        self.lasers.draw(context, rig.rig)
        self.patterns.draw(context, rig.rig, self._dialog)
        self.devices.draw(context, rig.rig)
        self.captures.draw(context, self._dialog)
        imgui.end_disabled()
        imgui.end_child()
        imgui.end_disabled()


def _draw_state(context: AppContext, rig: RigSession, name: str) -> None:
    """The rig's name and state, what is being waited for, and what went wrong with a button that connects again."""
    imgui.text(name)
    imgui.same_line()
    imgui.text_disabled(rig.status)
    if rig.waiting:
        imgui.text_colored(theme.signal_colour("warning"), rig.waiting)
    if rig.problem:
        wrapped_text(rig.problem, theme.signal_colour("error"))
    if (rig.status == "failed" or rig.waiting) and not context.is_read_only:
        command_button(context, "Connect again", "Connect again##rig", width=-1, name="connect again")


def _draw_off(context: AppContext, rig: RigSession) -> None:
    """The switch that turns all lasers off; it works whatever the devices do."""
    for colour, value in (
        (imgui.Col_.button, _RED),
        (imgui.Col_.button_hovered, _BRIGHT_RED),
        (imgui.Col_.button_active, _BRIGHT_RED),
        (imgui.Col_.text, _WHITE),
    ):
        imgui.push_style_color(colour, value)
    if imgui.button("LASERS OFF   F9", imgui.ImVec2(-1, _OFF_HEIGHT * imgui.get_text_line_height_with_spacing())):
        rig.lasers_off()
    imgui.pop_style_color(4)
    context.record_item_rect("lasers off")
    tooltip("Switches all lasers off at once and ends a plan. It doesn't wait for any other device.")
    if rig.off_problem:
        wrapped_text(rig.off_problem, theme.signal_colour("error"))
    elif rig.is_switching_off:
        imgui.text_colored(theme.signal_colour("warning"), "switching off…")
    elif rig.state.wavelength_m is None:
        imgui.text_disabled("all lasers are off")
    else:
        imgui.text(f"{rig.state.wavelength_m * 1e9:.0f} nm is on, power {rig.state.power:.3g}")


@dataclass
class LaserSection:
    """A switch for each laser. power: with which the next one is switched on; None: the highest that is allowed."""

    power: float | None = None

    def draw(self, context: AppContext, rig: RigDescription) -> None:
        """Draws the power and the switches."""
        imgui.separator_text("Lasers")
        power = rig.limits.power if self.power is None else self.power
        changed, value = fine_slider("power", power, 0.0, rig.limits.power, "%.3f")
        context.record_item_rect("power")
        tooltip(f"Relative; [limits] in rig.toml allows up to {rig.limits.power:g}.")
        self.power = value if changed else self.power
        on_m = context.rig.state.wavelength_m
        if imgui.is_item_deactivated_after_edit() and on_m is not None and self.power is not None:
            context.attempt(context.rig.switch_on, on_m, self.power)
        width = share_of_width(_SWITCHES_A_LINE)
        for number, wavelength_m in enumerate(rig.wavelengths_m):
            if number % _SWITCHES_A_LINE:
                imgui.same_line()
            self._draw_switch(context, wavelength_m, wavelength_m == on_m, width, value if changed else power)

    def _draw_switch(self, context: AppContext, wavelength_m: float, is_on: bool, width: float, power: float) -> None:
        label = f"{wavelength_m * 1e9:.0f} nm"
        with coloured(imgui.Col_.button, laser_colour(wavelength_m, 0.75 if is_on else 0.18)):
            is_clicked = button(context, label, width=width, name=f"laser {label}")
        if is_clicked and is_on:
            context.rig.lasers_off()
        elif is_clicked:
            context.attempt(context.rig.switch_on, wavelength_m, power)


@dataclass
class PatternSection:
    """The pattern for the modulators. kind: one of the kinds. sigma_px: of random patterns. share: of flat ones."""

    kind: str = _KINDS[1]
    sigma_px: float = 1.5
    share: float = 0.0
    seed: int = 0

    def draw(self, context: AppContext, rig: RigDescription, dialog: FileDialog) -> None:
        """Draws the kind of pattern with its number, and the button that sends it."""
        imgui.separator_text("Pattern")
        self.kind = combo("##kind", self.kind, _KINDS)
        if self.kind == "random":
            _, self.sigma_px = fine_slider("smooth", self.sigma_px, 0.0, _MAX_BLUR_PX, "%.1f px")
            tooltip("Standard deviation of the blur, in pixels of the modulator.")
        elif self.kind == "flat":
            _, self.share = fine_slider("level", self.share, 0.0, 1.0, "%.2f of the stroke")
        if button(context, "Send", width=-1, name="send"):
            context.attempt(self._send, context, rig, dialog)
        sent = context.rig.state.pattern
        imgui.text_disabled("nothing was sent yet" if sent is None else f"shown: {sent.label}")

    def send_drive(self, context: AppContext) -> None:
        """Sends the frame of the document that the view settings choose. Raises UserError for another bench's."""
        rig, session = context.rig.rig, context.session
        if rig is not None:
            frame = session.view_settings.frame
            label = f"frame {frame + 1} of {session.document.origin}"
            context.rig.send(drive_pattern(rig, session.displayed_document.drive, label, frame))

    def take_bench(self, context: AppContext) -> None:
        """Makes the nominal bench of the rig the document's, with random patterns if those it has don't fit."""
        if context.rig.rig is None:
            return
        system, session = system_of_rig(context.rig.rig), context.session
        fits = drive_fits(system, session.drive)
        session.edit(
            "Bench of the rig",
            system=system,
            drive=session.drive if fits else random_drive(system, 0),
            origin=session.document.origin if fits else "random patterns",
            view_settings=session.view_settings.with_(plane_m=middle_plane(system)),
            path=None,
        )

    def _send(self, context: AppContext, rig: RigDescription, dialog: FileDialog) -> None:
        if self.kind == _KINDS[0]:
            self.send_drive(context)
        elif self.kind == "random":
            self.seed += 1
            context.rig.send(random_pattern(rig, self.sigma_px, self.seed))
        elif self.kind == "flat":
            context.rig.send(flat_pattern(rig, self.share))
        else:
            asked = FileRequest(
                "Send a hologram", (".safetensors",), lambda path: context.rig.send(file_pattern(rig, path))
            )
            dialog.ask(asked)


@dataclass
class DeviceSection:
    """Camera and stage. target_m: where the stage is to go; None: the nearest place that is allowed."""

    exposure_s: float | None = None
    target_m: float | None = None

    def draw(self, context: AppContext, rig: RigDescription) -> None:
        """Draws exposure, histogram and stage."""
        imgui.separator_text("Camera")
        self._draw_exposure(context, rig)
        if context.rig.view.picture is not None:
            _draw_histogram(context.rig.view.picture)
        imgui.separator_text("Stage")
        low, high = (1e3 * z for z in rig.limits.stage_m)
        target = low if self.target_m is None else 1e3 * self.target_m
        changed, value = fine_slider("##stage", target, low, high, "%.3f mm")
        context.record_item_rect("stage")
        self.target_m = 1e-3 * value if changed else self.target_m
        imgui.same_line()
        if button(context, "Move", width=-1, name="move"):
            context.attempt(context.rig.move_to, 1e-3 * value)
        at_m = context.rig.state.distance_m
        imgui.text_disabled("it wasn't moved yet" if at_m is None else f"at {1e3 * at_m:.3f} mm")

    def _draw_exposure(self, context: AppContext, rig: RigDescription) -> None:
        session = context.rig
        changed, is_live = imgui.checkbox("live", session.is_live)
        context.record_item_rect("live")
        if changed:
            session.set_live(is_live)
        imgui.same_line()
        tip = "Tries exposures until the picture fills the camera's range without saturation."
        if button(context, "Search exposure", tip, width=-1, name="search exposure"):
            context.attempt(session.search_exposure)
        low, high = (1e3 * s for s in rig.limits.exposures_s)
        shown = 1e3 * (self.exposure_s or session.state.exposure_s or rig.limits.exposures_s[0])
        flags = imgui.SliderFlags_.logarithmic | imgui.SliderFlags_.no_round_to_format
        changed, value = fine_slider("exposure", shown, low, high, "%.3f ms", flags)
        context.record_item_rect("exposure")
        self.exposure_s = 1e-3 * value if changed else self.exposure_s
        if imgui.is_item_deactivated_after_edit() and self.exposure_s is not None:
            context.attempt(session.set_exposure, self.exposure_s)
        if not imgui.is_item_active():
            self.exposure_s = None


@dataclass
class CaptureSection:
    """Captures and plans. searches_exposure: whether a capture's exposure is searched."""

    searches_exposure: bool = True

    def take(self, context: AppContext) -> None:
        """Takes a capture. Raises UserError while something isn't set."""
        context.rig.take_capture(searches_exposure=self.searches_exposure)

    def draw(self, context: AppContext, dialog: FileDialog) -> None:
        """Draws the buttons for captures and plans, and the progress of a plan."""
        rig = context.rig
        imgui.separator_text("Captures")
        command_button(context, "Take a capture", "Take a capture   F8", width=-1, name="take a capture")
        _, self.searches_exposure = imgui.checkbox("search its exposure", self.searches_exposure)
        half, job = share_of_width(2), rig.plan_job
        if job is not None:
            left = "" if job.seconds_left is None else f", {job.seconds_left:.0f} s left"
            imgui.progress_bar(job.fraction, imgui.ImVec2(-1, 0), f"{job.note}{left}")
            if button(context, "Cancel the plan", width=-1, name="cancel the plan"):
                rig.cancel_plan()
        else:
            command_button(context, "Run the default plan", "Default plan", width=half, name="default plan")
            imgui.same_line()
            tip = "Runs into a capture file beside rig.toml, which holoview measure can go on with."
            if button(context, "A plan…", tip, width=half):
                dialog.ask(FileRequest("Run a plan", (".toml",), rig.run_plan))
        imgui.align_text_to_frame_padding()
        imgui.text(f"{len(rig.captures)} captures")
        imgui.same_line()
        if imgui.button("Save as one file…", imgui.ImVec2(-1, 0)):
            dialog.ask(FileRequest("Save captures", (".h5",), rig.save_captures, "captures.h5", is_save=True))


def _draw_histogram(picture: LivePicture) -> None:
    """Pixels by their counts, and the share of saturated ones."""
    bins = len(picture.histogram)
    heights = np.log10(1.0 + picture.histogram)
    centres, top = (np.arange(bins) + 0.5) / bins, float(heights.max()) or 1.0
    with plots.plot("counts", "", "log pixels", (0.0, 1.0), (0.0, 1.05 * top), height_em=_PLOT_EM) as is_open:
        if is_open:
            plots.bars("##counts", centres, heights, 1 / bins)
    text = f"saturated {picture.saturated:.2%}   brightest {int(picture.counts.max())} counts"
    if picture.saturated > _TOO_BRIGHT:
        imgui.text_colored(theme.signal_colour("warning"), text)
    else:
        imgui.text_disabled(text)


def draw_live_diagnosis(context: AppContext, rig: RigSession) -> None:
    """Draws the controls, the progress, and the last diagnosis."""
    live, count = rig.diagnosis, len(rig.captures)
    imgui.begin_disabled(context.is_read_only)
    _, live.is_on = imgui.checkbox("by itself", live.is_on)
    tooltip(f"Begins after a few captures, and again when there are more, with at most {MOST} of them.")
    imgui.same_line()
    imgui.set_next_item_width(5 * imgui.get_font_size())
    _, seconds = imgui.input_float("s", live.time_s, 0.0, 0.0, "%.0f")
    tooltip("Seconds that a search may take; what it has found by then is shown.")
    live.time_s = min(max(seconds, _TIMES_S[0]), _TIMES_S[1])
    imgui.same_line()
    tip = "With all captures; more of them take longer."
    if button(context, "Now", tip, width=-1, name="diagnose now", is_enabled=count > 0):
        context.attempt(rig.diagnose)
    job = live.job
    if job is not None:
        imgui.progress_bar(job.fraction, imgui.ImVec2(-1, 0), job.note)
        if live.forecast:
            imgui.text_wrapped(live.forecast)
        if live.so_far:
            imgui.text_wrapped(f"so far: {live.so_far}")
        if imgui.button("Cancel##diagnosis"):
            live.cancel()
    imgui.end_disabled()
    if live.diagnosis is not None:
        _draw_diagnosis(live.diagnosis, live.seen, count)
    elif job is None:
        imgui.text_wrapped(f"It begins with {FIRST} captures; there are {count}.")


def _draw_diagnosis(found: Diagnosis, seen: int, count: int) -> None:
    """The verdict, quality before and after, and causes. seen: number of captures then; count: of captures now."""
    of_all = f"{found.captures} captures" if found.captures == seen else f"{found.captures} of {seen} captures"
    imgui.separator_text(of_all + (f"; {count - seen} came since" if count > seen else ""))
    imgui.text(str(found.verdict))
    before, after = found.before.chi2_per_pixel, found.after.chi2_per_pixel
    imgui.text_disabled(f"χ²/n {before:.3g} → {after:.3g} (noise: 1)")
    for cause in found.causes:
        text = cause_text(cause)
        wrapped_text(text.sentence, theme.signal_colour("accent"))
        for line in text.intervals:
            imgui.bullet()
            imgui.text_wrapped(line)
        for line in text.doubts:
            wrapped_text(line, pale())
    for rival in found.rivals:
        imgui.text_wrapped(f"can't be excluded: {' and '.join(rival)}")
    for bad in found.bad_captures:
        imgui.text_wrapped(f"left out: capture {bad.index}, {bad.why}")


# --- the pictures of the camera ---


_SPANS = (3.0, 5.0, 10.0, 30.0, 100.0)
_TIPS = {
    "show": "Difference: camera − prediction, in standard deviations of the noise. Blue: too dark, red: too bright.",
    "predicted by": "rig.toml: the nominal bench. The viewer's bench: with its gap, stops and effects. The "
    "diagnosis: the nominal bench with what the last diagnosis found.",
}
MODES = ("side-by-side", "wipe", "difference", "camera", "prediction")
"""Ways to show camera and prediction."""
_VIEW = ViewSettings(plane_m=0.0, channel="luminance")


class CameraPanes:
    """Shows what the camera sees and what it should see. model: one of MODELS."""

    def __init__(self, context: AppContext) -> None:
        self.picture = CameraPicture(context)
        self.model = MODELS[0]

    def draw(self, context: AppContext) -> None:
        """Draws the choices, the pictures, and values under the pointer."""
        self._draw_choices(context, self.picture)
        available = imgui.get_content_region_avail()
        footer = imgui.get_text_line_height_with_spacing() + 2
        size = (max(int(available.x), 16), max(int(available.y - footer), 16))
        corner = imgui.get_cursor_screen_pos()
        if not self.picture.draw(context.rig.view, size, corner):
            draw_centred_text(_waiting_text(context), size)
            return
        imgui.invisible_button("##camera", imgui.ImVec2(*size))
        context.record_item_rect("camera")
        _draw_labels(context, self.picture)
        if self.picture.mode == "wipe" and imgui.is_item_active():
            self.picture.wipe = float(np.clip((imgui.get_io().mouse_pos.x - corner.x) / size[0], 0.0, 1.0))
        imgui.text_disabled(_under_pointer(context, self.picture))

    def _draw_choices(self, context: AppContext, picture: CameraPicture) -> None:
        em = imgui.get_font_size()
        picture.mode = combo("##show", picture.mode, MODES, _TIPS["show"], width=8 * em)
        context.record_item_rect("camera view")
        imgui.same_line()
        chosen = combo("##model", f"by {self.model}", [f"by {name}" for name in MODELS], _TIPS["predicted by"], 9 * em)
        self.model = chosen.removeprefix("by ")
        context.rig.choose_model(self.model)
        imgui.same_line()
        imgui.set_next_item_width(-1)
        if picture.mode == "difference":
            spans = {f"±{span:g} σ": span for span in _SPANS}
            picture.span_sigmas = spans[combo("##span", f"±{picture.span_sigmas:g} σ", tuple(spans))]
        else:
            _, picture.stops = fine_slider("##stops", picture.stops, -4.0, 8.0, "%.1f stops")
            tooltip("Brightens both pictures alike, on the screen only.")


def _draw_labels(context: AppContext, picture: CameraPicture) -> None:
    """The names of both sides, and χ²/n in the corner."""
    found, draw_list, shown = context.rig.view.prediction, imgui.get_window_draw_list(), picture.shown
    predicted = "" if found is None else f"prediction by {found.model}"
    b_at = {"side-by-side": 0.5, "wipe": picture.wipe}.get(picture.mode)
    first = {"difference": f"camera − {predicted}", "prediction": predicted}.get(picture.mode, "camera")
    corner, end = shown.corner, shown.end
    draw_label(draw_list, first, imgui.ImVec2(corner.x + 8, corner.y + 6))
    if b_at is not None and predicted:
        draw_label(draw_list, predicted, imgui.ImVec2(corner.x + b_at * shown.size[0] + 8, corner.y + 6))
    text = _waiting_text(context) if found is None else f"χ²/n {found.chi2:.3g}"
    draw_label(draw_list, text, imgui.ImVec2(end.x - imgui.calc_text_size(text).x - 10, end.y - 24))


def _under_pointer(context: AppContext, picture: CameraPicture) -> str:
    """Values of the pixel under the pointer, else a hint."""
    view, area = context.rig.view, picture.shown.visible_area
    if view.picture is None or area is None or not imgui.is_item_hovered():
        return context.rig.waiting or "χ²/n: mean squared difference in σ; noise alone gives 1"
    x, y = picture.shown.to_pixel(imgui.get_io().mouse_pos)
    is_pair = picture.view_settings.compare == "side-by-side" and view.prediction is not None
    u, v = area.to_image(x % (area.size[0] // 2) if is_pair else x, y)
    rows, columns = view.picture.counts.shape
    row, column = int(v * rows), int(u * columns)
    if not (0 <= u < 1 and 0 <= v < 1):
        return ""
    counts = int(view.picture.counts[row, column])
    if view.prediction is None:
        return f"({column}, {row})   {counts} counts"
    expected = view.prediction.expected[row, column] + view.picture.black
    sigmas = view.prediction.residual[row, column]
    return f"({column}, {row})   {counts} counts   expected {expected:.0f}   {sigmas:+.1f} σ"


def _waiting_text(context: AppContext) -> str:
    """Why there is no picture or no prediction."""
    rig = context.rig
    if rig.status != "open":
        return f"the rig is {rig.status}"
    if rig.view.picture is None:
        return rig.waiting or "no picture yet"
    missing = rig.state.missing
    return f"for a prediction: {missing}" if missing else rig.view.problem or "computing the prediction"


class CameraPicture:
    """Draws camera and prediction. mode: one of MODES. wipe: share of the width that shows the camera.

    span_sigmas: differences from −span to +span are told apart. stops: a factor 2^stops on the light.
    shown: the picture in the window.
    """

    def __init__(self, context: AppContext) -> None:
        self._context, self.shown = context, Viewport(context, "camera")
        self._images: dict[str, DeviceImage] = {}
        self._shown: dict[str, object] = {}
        self.mode, self.wipe, self.span_sigmas, self.stops = MODES[0], 0.5, 5.0, 0.0

    @property
    def view_settings(self) -> ViewSettings:
        """How the viewport is to show the pair."""
        if self.mode == "difference":
            return replace(_VIEW, compare="difference", high=self.span_sigmas)
        compare = self.mode if self.mode in ("wipe", "side-by-side") else "off"
        return replace(_VIEW, compare=compare, wipe=self.wipe, exposure_stops=self.stops)

    def draw(self, view: LiveView, size: tuple[int, int], corner: imgui.ImVec2) -> bool:
        """Draws into `size` (x, y) logical pixels at a corner; returns whether there was anything to draw."""
        a, b = self._pair(view)
        if a is None:
            return False
        settings = self.view_settings if b is not None else replace(_VIEW, exposure_stops=self.stops)
        self.shown.draw(a, b, settings, size, corner)
        return True

    def _pair(self, view: LiveView) -> tuple[DeviceImage | None, DeviceImage | None]:
        """The images of both sides; None for a side that isn't there or isn't wanted."""
        picture, found = view.picture, view.prediction
        if picture is None:
            return None, None
        if self.mode == "difference":
            if found is None:
                return None, None
            zero = self._image("zero", found.residual.shape, lambda: np.zeros_like(found.residual))
            return self._image("residual", found, lambda: found.residual), zero
        expected = None if found is None else self._image("expected", found, lambda: found.expected / picture.white)
        if self.mode == "prediction":
            return expected, None
        measured = self._image("measured", picture, lambda: (picture.counts - picture.black) / picture.white)
        return measured, None if self.mode == "camera" else expected

    def _image(self, name: str, of: object, values: Any) -> DeviceImage:
        """An image of values (y, x), which are asked for when `of` is another one than before."""
        if self._shown.get(name) is not of and self._shown.get(name) != of:
            light = np.asarray(values(), np.float32)
            xyz = np.repeat(light[..., None], 4, axis=2)
            old = self._images.get(name)
            if old is not None and old.shape == light.shape:
                self._context.device.write(old.buffer, xyz)
                self._images[name] = replace(old, version=old.version + 1)
            else:
                shape = (light.shape[0], light.shape[1])
                self._images[name] = DeviceImage(self._context.device.upload(xyz, f"camera: {name}"), shape)
            self._shown[name] = of
        return self._images[name]
