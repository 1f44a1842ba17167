"""The panel of the diagnosis that follows a rig's captures."""

from __future__ import annotations

from imgui_bundle import imgui

from holoview.app.context import AppContext
from holoview.app.panel import Panel


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
        from holoview.app.rig.controls import draw_live_diagnosis  # slow start: most sessions open no rig

        draw_live_diagnosis(context, rig)
