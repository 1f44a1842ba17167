"""The panels of a rig: its controls, the diagnosis that follows its captures, and the pictures of its camera."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from imgui_bundle import imgui

from holoview.viewer.app.context import AppContext
from holoview.viewer.app.file_dialog import FileDialog, FileRequest
from holoview.viewer.app.panel import Panel

if TYPE_CHECKING:
    from holoview.viewer.app.rig_controls import CameraPanes, RigControls


_PANELS = ("Rig", "Rig diagnosis", "Camera")


class RigPanel(Panel):
    """Controls the devices of a rig; in a viewer to look at, it only shows what they do."""

    title = "Rig"
    dock = "Left"
    starts_open = False

    def __init__(self) -> None:
        self._controls: RigControls | None = None
        self._drawn = ("", "")

    def set_up(self, context: AppContext) -> None:
        """Adds the commands, which a viewer to look at doesn't have."""
        self.dialog = FileDialog(context.session, "Rig files")
        context.overlays.append(self.dialog)
        if not context.is_read_only:
            help = "The devices of a bench: rig.toml."
            context.commands.add("File", "Open a rig…", lambda: self._ask_rig(context), help=help)
            self._add_commands(context)

    def _add_commands(self, context: AppContext) -> None:
        add = partial(context.commands.add, "Rig", is_enabled=lambda: context.opened_rig is not None)
        off = "All lasers, at once, whatever the devices do; ends a plan."
        add("Lasers off", lambda: context.rig.lasers_off(), "F9", off, is_urgent=True)
        add("Take a capture", lambda: self.controls.captures.take(context), "F8", "As the devices are set.")
        levels = "To the modulators, in their levels."
        add("Send the viewer's pattern", lambda: self.controls.patterns.send_drive(context), "F7", levels)
        add("Live camera", lambda: context.rig.set_live(not context.rig.is_live), "", "Pictures all the time.")
        add("Run the default plan", lambda: context.rig.run_plan(None), "", "Captures of every laser and plane.")
        add("Diagnose the captures", lambda: context.rig.diagnose(), "", "What is wrong with the bench.")
        add("Bench of the rig", lambda: self.controls.patterns.take_bench(context), "", "The viewer shows it.")
        add("Connect again", lambda: context.rig.reconnect(), "", "Closes and opens the devices, lasers off.")
        add("Close the rig", lambda: context.rig.close_rig(), "", "Lasers off, devices closed.")

    @property
    def controls(self) -> RigControls:
        """The contents of the panel of an open rig."""
        if self._controls is None:
            from holoview.viewer.app.rig_controls import RigControls  # slow start: most sessions open no rig

            self._controls = RigControls(self.dialog)
        return self._controls

    def has_changed(self, context: AppContext) -> bool:
        """Whether the time that has been waited for a device has, or what is said of the lasers."""
        rig = context.opened_rig
        return rig is not None and self._drawn != (rig.waiting, rig.off_problem)

    def draw(self, context: AppContext) -> None:
        """Draws the controls, or how a rig is opened."""
        rig = context.opened_rig
        if rig is not None:
            self._drawn = (rig.waiting, rig.off_problem)
            self.controls.draw(context, rig)
            return
        imgui.text_wrapped("No rig is open. A rig is a bench whose devices rig.toml describes.")
        if not context.is_read_only and imgui.button("Open a rig…##rig", imgui.ImVec2(-1, 0)):
            self._ask_rig(context)

    def _ask_rig(self, context: AppContext) -> None:
        self.dialog.ask(FileRequest("Open a rig", (".toml",), lambda path: open_rig(context, path)))


def open_rig(context: AppContext, path: Path) -> None:
    """Opens a rig and shows its panels. Raises UserError for a wrong description."""
    context.rig.open(path)
    for title in _PANELS:
        context.show_panel(title)


class RigDiagnosisPanel(Panel):
    """Shows what the captures of a rig say of its bench."""

    title = "Rig diagnosis"
    dock = "Low right"
    starts_open = False

    def draw(self, context: AppContext) -> None:
        """Draws the diagnosis of an open rig."""
        rig = context.opened_rig
        if rig is None:
            imgui.text_disabled("No rig is open.")
            return
        from holoview.viewer.app.rig_controls import draw_live_diagnosis  # slow start: most sessions open no rig

        draw_live_diagnosis(context, rig)


class CameraPanel(Panel):
    """Shows what the camera sees and what it should see. view: both pictures, once a rig was open; None before."""

    title = "Camera"
    dock = "Centre"
    starts_open = False
    flags = imgui.WindowFlags_.no_scrollbar | imgui.WindowFlags_.no_scroll_with_mouse

    def __init__(self) -> None:
        self.view: CameraPanes | None = None

    def draw(self, context: AppContext) -> None:
        """Draws the pictures of an open rig."""
        if context.opened_rig is None:
            imgui.text_disabled("No rig is open.")
            return
        if self.view is None:
            from holoview.viewer.app.rig_controls import CameraPanes  # slow start: most sessions open no rig

            self.view = CameraPanes(context)
        self.view.draw(context)
