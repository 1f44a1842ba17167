"""Controls of a rig: its state, the big switch that turns the lasers off, and the sections below it."""

from __future__ import annotations

from imgui_bundle import imgui

from holoview.app import theme
from holoview.app.context import AppContext
from holoview.app.file_dialog import FileDialog
from holoview.app.parameter_widgets import tooltip
from holoview.app.rig.sections import CaptureSection, DeviceSection, LaserSection, PatternSection
from holoview.experiment.live.rig_session import RigSession

_OFF_HEIGHT = 2.2  # of the switch that turns the lasers off, in lines
_RED = imgui.ImVec4(0.68, 0.10, 0.10, 1.0)
_BRIGHT_RED = imgui.ImVec4(0.85, 0.16, 0.14, 1.0)
_WHITE = imgui.ImVec4(1.0, 1.0, 1.0, 1.0)


class RigControls:
    """What the panel of an open rig shows. dialog: asks for files."""

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
        imgui.begin_child("rig sections")
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
        imgui.text_colored(theme.WARNING, rig.waiting)
    if rig.problem:
        imgui.push_style_color(imgui.Col_.text, theme.ERROR)
        imgui.text_wrapped(rig.problem)
        imgui.pop_style_color()
    is_stuck = rig.status == "failed" or bool(rig.waiting)
    if is_stuck and not context.is_read_only:
        if imgui.button("Connect again##rig", imgui.ImVec2(-1, 0)):
            rig.reconnect()
        context.record_item_rect("connect again")


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
        imgui.push_style_color(imgui.Col_.text, theme.ERROR)
        imgui.text_wrapped(rig.off_problem)
        imgui.pop_style_color()
    elif rig.is_switching_off:
        imgui.text_colored(theme.WARNING, "switching off…")
    elif rig.state.wavelength_m is None:
        imgui.text_disabled("all lasers are off")
    else:
        imgui.text(f"{rig.state.wavelength_m * 1e9:.0f} nm is on, power {rig.state.power:.3g}")
