"""The diagnosis that follows a rig's captures: verdict, causes with intervals, what looks alike."""

from __future__ import annotations

from imgui_bundle import imgui

from holoview.app import theme
from holoview.app.context import AppContext
from holoview.app.parameter_widgets import tooltip
from holoview.diagnose.report.diagnosis import Diagnosis
from holoview.experiment.live.live_diagnosis import FIRST, MOST, cause_text
from holoview.experiment.live.rig_session import RigSession

_TIMES_S = (5.0, 600.0)


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
    imgui.begin_disabled(count == 0)
    if imgui.button("Now", imgui.ImVec2(-1, 0)):
        context.attempt(rig.diagnose)
    context.record_item_rect("diagnose now")
    tooltip("With all captures; more of them take longer.")
    imgui.end_disabled()
    job = live.job
    if job is not None:
        imgui.progress_bar(job.fraction, imgui.ImVec2(-1, 0), job.note)
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
    """The verdict, quality before and after, and causes. seen: captures there were; count: those there are."""
    of_all = f"{found.captures} captures" if found.captures == seen else f"{found.captures} of {seen} captures"
    imgui.separator_text(of_all + (f"; {count - seen} came since" if count > seen else ""))
    imgui.text(str(found.verdict))
    before, after = found.before.chi2_per_pixel, found.after.chi2_per_pixel
    imgui.text_disabled(f"χ²/n {before:.3g} → {after:.3g} (noise: 1)")
    for cause in found.causes:
        text = cause_text(cause)
        imgui.push_style_color(imgui.Col_.text, theme.ACCENT)
        imgui.text_wrapped(text.sentence)
        imgui.pop_style_color()
        for line in text.intervals:
            imgui.bullet()
            imgui.text_wrapped(line)
        for line in text.doubts:
            imgui.push_style_color(imgui.Col_.text, imgui.get_style_color_vec4(imgui.Col_.text_disabled))
            imgui.text_wrapped(line)
            imgui.pop_style_color()
    for rival in found.rivals:
        imgui.text_wrapped(f"can't be excluded: {' and '.join(rival)}")
    for bad in found.bad_captures:
        imgui.text_wrapped(f"left out: capture {bad.index}, {bad.why}")
