"""The panel for optimising patterns in the background: target, settings, progress."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from imgui_bundle import imgui

from holoview.holograms.optimise.eyes import (
    MOST_ALONG_AXIS,
    MOST_DRAWN,
    PupilChoice,
    PupilDraw,
    PupilGrid,
    parse_pupils,
)
from holoview.holograms.targets.picture import Picture
from holoview.holograms.targets.target import Placement
from holoview.light.model.fields import Integer, Number, Word, field_for
from holoview.util.errors import UserError
from holoview.util.text import printable
from holoview.viewer.app import plots, theme
from holoview.viewer.app.context import AppContext
from holoview.viewer.app.framing import FramingEditor
from holoview.viewer.app.panel import Panel
from holoview.viewer.app.parameter_widgets import number_field
from holoview.viewer.app.widgets import (
    combo,
    command_button,
    fine_slider,
    pale,
    room_for_labels,
    share_of_width,
    tooltip,
    wrapped_text,
)
from holoview.viewer.document.editing_session import EditingSession, OptimisationChoices
from holoview.viewer.document.focus_edits import focus_range_m
from holoview.viewer.document.optimisation_job import (
    LiveOptimisationJob,
    OptimisationJob,
    chosen_optimisation,
    last_optimisation,
    running_optimisation,
    start_optimisation,
    start_quick_optimisation,
)
from holoview.viewer.document.target_builder import TargetSpec

_KEEP, _PAUSE, _CANCEL = "Keep the best so far", "Pause or go on", "Cancel the optimisation"
_NOTHING = {"scheme": "the bench as it is", "loss": "by the observer"}
_LABELS = {"start_patterns": "begin", "chromatic": "colour error"}
_AT = "From the last modulator to the plane of the target's field."


class OptimisePanel(Panel):
    """Starts an optimisation with the chosen settings, and pauses, keeps or cancels a running one."""

    title = "Optimise"
    dock = "Low right"

    def __init__(self) -> None:
        self._framing = FramingEditor()
        self._step = ""  # of an optimisation that prepares, as it was drawn last

    def set_up(self, context: AppContext) -> None:
        """Adds the commands."""
        add = partial(context.commands.add, "Optimise")

        def is_running() -> bool:
            return running_optimisation(context.session) is not None

        find = "Find patterns for the target; undo brings the old ones back."
        add("Optimise", lambda: self.start(context), "Ctrl+Enter", find, is_enabled=lambda: not is_running())
        for name, action, help in (
            (_KEEP, OptimisationJob.stop_and_keep, "Ends it with the best so far; undo brings the old patterns back."),
            (_PAUSE, _pause_or_go_on, ""),
            (_CANCEL, OptimisationJob.cancel, "Ends it; the old patterns stay."),
        ):
            add(name, partial(_with_running, context, action), help=help, is_enabled=is_running)
        add("Quick look", lambda: _quick_optimisation(context), help="A few iterations with large pixels: seconds.")

    def draw(self, context: AppContext) -> None:
        """Draws the target, then the settings or the progress of a running optimisation."""
        if context.session.system.is_field:
            imgui.text_wrapped("A field has no patterns to optimise. Open a preset to find patterns for a picture.")
            return
        job = running_optimisation(context.session)
        self._step = "" if job is None else job.step
        with room_for_labels("brightness", "centre x", "colour error", "rows, columns"):
            self._draw_all(context)

    def _draw_all(self, context: AppContext) -> None:
        _draw_target(context)
        job = running_optimisation(context.session)
        if job is None:
            self._draw_choices(context)
        else:
            _draw_progress(context, job)
        shown = job or last_optimisation(context.session)
        if shown is not None and len(shown.progress) > 1:
            _draw_plot(shown)
        target_spec = context.session.target_spec
        if target_spec is not None and isinstance(target_spec.source, Picture):
            self._framing.draw(context, target_spec)

    def has_changed(self, context: AppContext) -> bool:
        """While an optimisation prepares, the seconds pass."""
        job = running_optimisation(context.session)
        return job is not None and job.latest is None and job.step != self._step

    def start(self, context: AppContext) -> None:
        """Starts an optimisation with the chosen settings, and brings this panel to the front."""
        session = context.session
        context.set_optimised()
        context.show_panel(self.title)
        context.attempt(
            lambda: start_optimisation(session, chosen_optimisation(session.optimisation_choices, session.system))
        )

    def _draw_choices(self, context: AppContext) -> None:
        _draw_settings(context.session)
        draw_eye_fields(context)
        imgui.begin_disabled(context.session.target_spec is None)
        if imgui.button("Optimise##start", imgui.ImVec2(-1, 1.4 * imgui.get_frame_height())):
            self.start(context)
        imgui.end_disabled()
        if context.session.target_spec is None:
            imgui.text_wrapped("Open a picture to optimise for, drop one on the window, or paste one.")


def _draw_settings(session: EditingSession) -> None:
    """Draws scheme, loss, start, iterations and the weight of the eyebox, and keeps what is chosen."""
    choices = session.optimisation_choices
    keys = ("scheme", "loss", "start_patterns", "iterations", "eyebox")
    session.choose_optimisation(replace(choices, **{key: _edit_choice(choices, key) for key in keys}))


def _edit_choice(choices: OptimisationChoices, key: str) -> Any:
    """Draws the widget of a choice, by its type; returns its value after the edit, within its range."""
    field, name, value = field_for(OptimisationChoices, key), _LABELS.get(key, key), getattr(choices, key)
    kind, doc = field.metadata["kind"], field.metadata["doc"]
    if isinstance(kind, Word):
        nothing = _NOTHING.get(key, "")
        chosen = combo(name, value or nothing, tuple(option or nothing for option in kind.options), doc)
        return "" if chosen == nothing else chosen
    if isinstance(kind, Integer):
        value = imgui.input_int(name, value, 10, 100)[1]
    else:
        is_entered, entered = imgui.input_float(name, value, 0.005, 0.05, "%.3g")
        value = float(f"{entered:.6g}") if is_entered else value
    tooltip(doc)
    return min(max(value, kind.low), kind.high)


def _draw_target(context: AppContext) -> None:
    target_spec = context.session.target_spec
    if target_spec is None:
        return
    imgui.text_wrapped(f"target: {printable(target_spec.title)}")
    if target_spec.is_field:
        _draw_place_of_field(context, target_spec)
    changed, brightness = fine_slider("brightness", target_spec.brightness, 0.1, 2.0, "%.2f")
    tooltip(field_for(TargetSpec, "brightness").metadata["doc"])
    if changed and brightness > 0:
        context.attempt(
            context.session.edit,
            "Target brightness",
            target_spec=replace(target_spec, brightness=float(f"{brightness:.3g}")),
            merge_key="brightness",
        )


def _draw_place_of_field(context: AppContext, target_spec: TargetSpec) -> None:
    """Draws the distance of the target's field behind the last modulator."""
    at_m, kind = target_spec.placement.at_m or 0.0, Number("mm", -2.0, 2.0)
    low_m, high_m = focus_range_m(context.session.system)
    edited = number_field("at", kind, at_m, 0.0, _AT, (min(low_m, 0.0), high_m))
    if edited is not None:
        moved = replace(target_spec, placement=Placement(at_m=edited.value))
        context.attempt(context.session.edit, "Place of the target", target_spec=moved, merge_key="place of the target")


def _draw_progress(context: AppContext, job: OptimisationJob) -> None:
    left, text = job.seconds_left, f"{job.fraction:.0%}"
    if left is not None:
        text += f", {left:.0f} s left" if left < 90 else f", {left / 60:.0f} min left"
    if isinstance(job, LiveOptimisationJob):
        text = "until it is kept or cancelled"
    imgui.progress_bar(job.fraction, imgui.ImVec2(-1, 0), "paused" if job.status == "paused" else text)
    latest = job.latest
    if latest is None:
        wrapped_text(job.step, pale())
    else:
        of_all = "" if isinstance(job, LiveOptimisationJob) else f" of {latest.iterations}"
        imgui.text_wrapped(f"{job.unit} {latest.iteration}{of_all}   loss {latest.loss:.4g}")
        imgui.text_wrapped(f"PSNR of all planes {latest.psnr_db:.2f} dB, best {latest.best_psnr_db:.2f} dB")
        if latest.light_text:
            imgui.text_wrapped(f"in the picture: {latest.light_text}")
    width = share_of_width(3)
    command_button(context, _PAUSE, "Go on" if job.status == "paused" else "Pause", width=width)
    imgui.same_line()
    command_button(context, _KEEP, "Keep", width=width, is_enabled=latest is not None)
    imgui.same_line()
    command_button(context, _CANCEL, "Cancel", width=width)


def _draw_plot(job: OptimisationJob) -> None:
    iterations = np.array([progress.iteration for progress in job.progress])
    decibels = np.array([progress.best_psnr_db for progress in job.progress])
    low, high = float(decibels.min()), float(decibels.max())
    first, last = map(float, job.progress_range)
    with plots.plot("psnr", job.unit, "best PSNR (dB)", (first, last), (low - 0.5, high + 0.5)) as is_open:
        if is_open:
            plots.line("##best", iterations, decibels, theme.signal_colour("accent"))


def _pause_or_go_on(job: OptimisationJob) -> None:
    if job.status == "paused":
        job.resume()
    else:
        job.pause()


def _with_running(context: AppContext, action: Callable[[OptimisationJob], None]) -> None:
    job = running_optimisation(context.session)
    if job is not None:
        action(job)


def _quick_optimisation(context: AppContext) -> None:
    if context.session.target_spec is None:
        raise UserError("quick look", "there is no target", remedy="open a picture first")
    start_quick_optimisation(context.session)


# --- The fields of the panel *Optimise* for the eye: places of its pupil, and what is done about its colour error ---


_KINDS = {"where it is": None, "on a grid": PupilGrid(3, 3, 0.6e-3), "drawn anew": PupilDraw(4, 0.8e-3)}
_LEAST_MM, _MOST_MM = 0.1, 2.0


def draw_eye_fields(context: AppContext) -> None:
    """Draws the choices; without an eye they are there, but can't be made."""
    session = context.session
    has_eye = session.system.eye is not None
    imgui.separator_text("the eye")
    if not has_eye:
        wrapped_text("An eye (Y) has these choices.", pale())
    imgui.begin_disabled(not has_eye)
    choices = session.optimisation_choices
    pupils = _edit_pupils(parse_pupils(choices.pupils) if choices.pupils else None)
    chromatic = _edit_choice(choices, "chromatic")
    imgui.end_disabled()
    text = "" if pupils is None else str(pupils)
    session.choose_optimisation(replace(choices, pupils=text, chromatic=chromatic))


def _edit_pupils(pupils: PupilChoice | None) -> PupilChoice | None:
    """Draws where the pupil is; returns that as it is after the edit."""
    kind = next(name for name, usual in _KINDS.items() if type(usual) is type(pupils))
    chosen = combo("pupil", kind, tuple(_KINDS), field_for(OptimisationChoices, "pupils").metadata["doc"])
    if chosen != kind:
        return _KINDS[chosen]
    if isinstance(pupils, PupilGrid):
        _, (rows, columns) = imgui.input_int2("rows, columns", [pupils.rows, pupils.columns])
        rows, columns = (min(max(count, 1), MOST_ALONG_AXIS) for count in (rows, columns))
        return PupilGrid(rows, columns, _edit_length("spacing", pupils.spacing_m))
    if isinstance(pupils, PupilDraw):
        _, count = imgui.input_int("places", pupils.count)
        return PupilDraw(min(max(count, 1), MOST_DRAWN), _edit_length("radius", pupils.radius_m))
    return None


def _edit_length(name: str, length_m: float) -> float:
    """Draws a slider of millimetres; returns the length in metres, rounded to hundredths if it was moved."""
    flags = imgui.SliderFlags_.always_clamp
    moved, shown = fine_slider(name, length_m * 1e3, _LEAST_MM, _MOST_MM, "%.2f mm", flags)
    return round(shown, 2) * 1e-3 if moved else length_m
