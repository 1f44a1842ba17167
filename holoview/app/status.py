"""The status bar: the adapter, limits of the model, durations of frames, progress of rendering and jobs."""

from __future__ import annotations

from imgui_bundle import imgui

from holoview.app import theme
from holoview.app.context import AppContext
from holoview.app.parameter_widgets import tooltip


def draw_status(context: AppContext) -> None:
    """Draws the status bar, with details as tooltips."""
    info, renderer = context.device.info, context.side_renderers.now
    imgui.text(info.name)
    tooltip(info.label)
    if info.is_cpu:
        imgui.same_line()
        imgui.text_colored(theme.WARNING, "software")
        tooltip("Shaders run on the processor: a GPU's driver wasn't found, or --adapter chose this one.")
    _draw_limits(context)
    parts = [f"full frame {_ms(renderer.update_s)}"] if renderer.update_s else []
    parts += [f"quick {_ms(renderer.quick_s)}"] if renderer.quick_s else []
    parts += [f"window {_ms(context.window.draw_s)}"]
    imgui.same_line(spacing=20)
    imgui.text_disabled("  ·  ".join(parts))
    tooltip("Time of the last full frame, of the last quick one, and of drawing this window (processor's part).")
    if renderer.is_busy:
        imgui.same_line(spacing=20)
        text = "quick view" if renderer.picture is not None and renderer.picture.is_quick else "computing"
        imgui.push_style_var(imgui.StyleVar_.frame_padding, imgui.ImVec2(6, 0))
        imgui.progress_bar(renderer.progress, imgui.ImVec2(110, imgui.get_text_line_height()), text)
        imgui.pop_style_var()
        tooltip("A cheaper image is shown at once; the full one follows when your hand rests.")
    if context.session.save_problem:
        imgui.same_line(spacing=20)
        imgui.text_colored(theme.ERROR, "not saved")
        tooltip(f"{context.session.save_problem}. It is tried again every few seconds.")
    for job in context.session.jobs.active:
        imgui.same_line(spacing=20)
        imgui.text(f"{job.title} {job.fraction:.0%}")


def _draw_limits(context: AppContext) -> None:
    """Says that the model isn't true of the bench, and in a tooltip in what respect."""
    limits = context.limit_notes
    notes = limits.known if imgui.is_any_item_active() else limits.notes()  # milliseconds for each new bench
    if not notes:
        return
    imgui.same_line(spacing=20)
    text = notes[0].split(":")[0] if len(notes) == 1 else f"{len(notes)} limits of the model"
    imgui.text_colored(theme.WARNING, text)
    context.record_item_rect("limits")
    tooltip("The picture isn't true in this respect:\n\n" + "\n\n".join(notes))


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.0f} ms" if seconds < 10 else f"{seconds:.1f} s"
