"""Commands and buttons for the path of the pupil: record, play, forget, open, save, export."""

from __future__ import annotations

from imgui_bundle import imgui

from holoview.app import theme
from holoview.app.context import AppContext
from holoview.app.parameter_widgets import tooltip

_RECORD, _PLAY, _FORGET = "Record the pupil", "Play the path", "Forget the path"
_FILES = {"Open…": "Open…", "Save…": "Save pupil path…", "Animate…": "Save path animation…"}
"""Commands of the buttons for files."""
_HELP = {
    _RECORD: "Keeps where the pupil is, its diameter and its focus, while you change them; again: ends the recording.",
    _PLAY: "Moves the pupil along its path; again: stops it there.",
    _FORGET: "Removes the path of the pupil.",
    "Open…": "A path as it is saved here: a table of times and places (CSV).",
    "Save pupil path…": "Times, places, diameters and accommodations, as a table (CSV).",
    "Save path animation…": "What the eye sees along the path, as an animated PNG, a GIF or an MP4.",
}


def add_path_commands(context: AppContext) -> None:
    """Adds the commands of the path to the menu of the eye."""
    motion = context.pupil_motion
    actions = {
        _RECORD: lambda: motion.stop() if motion.state == "recording" else motion.record(),
        _PLAY: lambda: motion.stop() if motion.state == "playing" else motion.play(),
        _FORGET: lambda: _forget(context),
    }
    for name, action in actions.items():
        context.commands.add(name, action, "Eye", help=_HELP[name])


def draw_path_controls(context: AppContext) -> None:
    """Draws the buttons of the path, and what there is of it."""
    imgui.separator_text("path of the pupil")
    motion, has_path = context.pupil_motion, context.session.view_settings.pupil_path is not None
    width = (imgui.get_content_region_avail().x - 2 * imgui.get_style().item_spacing.x) / 3
    is_recording, is_playing = motion.state == "recording", motion.state == "playing"
    _button(context, "Stop##record" if is_recording else "Record", _RECORD, width, is_on=is_recording)
    imgui.same_line()
    _button(context, "Stop##play" if is_playing else "Play", _PLAY, width, is_on=is_playing, is_enabled=has_path)
    imgui.same_line()
    _button(context, "Forget", _FORGET, width, is_enabled=has_path)
    for number, (label, command) in enumerate(_FILES.items()):
        if number > 0:
            imgui.same_line()
        _button(context, f"{label}##path", command, width, is_enabled=has_path or number == 0)
    imgui.text_disabled(_status(context))


def _button(
    context: AppContext,
    label: str,
    command: str,
    width: float,
    *,
    is_on: bool = False,
    is_enabled: bool = True,
) -> None:
    if is_on:
        imgui.push_style_color(imgui.Col_.button, theme.ACCENT)
    imgui.begin_disabled(not is_enabled)
    clicked = imgui.button(label, imgui.ImVec2(width, 0))
    imgui.end_disabled()
    if is_on:
        imgui.pop_style_color()
    context.record_item_rect(command)
    tooltip(_HELP[command])
    if clicked:
        context.attempt(context.commands.run, command)


def _status(context: AppContext) -> str:
    motion, path = context.pupil_motion, context.session.view_settings.pupil_path
    if motion.state == "recording":
        return f"recording, {motion.elapsed_s:.1f} s: drag the pupil"
    if path is None:
        return "none yet: record, and drag the pupil"
    if motion.state == "playing":
        return f"playing, {min(motion.elapsed_s, path.duration_s):.1f} of {path.duration_s:.1f} s"
    return f"{path.duration_s:.1f} s, {len(path.times_s)} points"


def _forget(context: AppContext) -> None:
    context.pupil_motion.stop()
    context.session.edit_view("Forget the path", pupil_path=None)
