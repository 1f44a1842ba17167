"""The panel of the eye: its pupil in the eyebox, its focus in dioptres, and which wavelength it sees in which plane."""

from __future__ import annotations

from imgui_bundle import imgui

from holoview.app.context import AppContext
from holoview.app.eye_widgets import add_path_commands, draw_focus_graph, draw_path_controls, draw_pupil_map
from holoview.app.panel import Panel
from holoview.app.parameter_widgets import WidgetEdit, draw_fields, number_field, tooltip
from holoview.document.focus import (
    PUPIL_RANGE_M,
    dioptres_of,
    eye_of,
    focus_at,
    focus_range_m,
    plane_of,
    pupil_diameter_m,
    toggle_chromatic,
    toggle_eye,
)
from holoview.model.eye import AUTO, PUPIL, PUPIL_PLACE, VERGENCE, Eye, Prescription
from holoview.model.fields import fields_by_key
from holoview.render.view_settings import ACHROMATIC, NOW

_BY_HAND = ("pupil", "pupil_y", "pupil_x", "accommodation", "infinity")
_ALL_BUT_CHROMATIC = tuple(key for key in fields_by_key(Eye) if key != "chromatic")


class EyePanel(Panel):
    """Edits the eye of the system."""

    title = "Eye"
    dock = "Left"

    def set_up(self, context: AppContext) -> None:
        add, session = context.commands.add, context.session
        add("Eye", lambda: toggle_eye(session), "Eye", "Y", "Puts an eye behind an eyepiece, or takes it away.")
        add(
            "Chromatic aberration",
            lambda: toggle_chromatic(session),
            "Eye",
            "Shift+Y",
            "Switches the colour error of the eye, to see what it does.",
        )
        add(
            "Compare without colour error",
            lambda: _compare_achromatic(context),
            "Eye",
            "A",
            "The eye beside the same eye without chromatic aberration; again: one image.",
        )
        add_path_commands(context)
        add("Eyebox", lambda: context.edit_view("Page", page="spectrum"), "Eye", help="The eyebox with the pupil.")

    def draw(self, context: AppContext) -> None:
        system = context.session.system
        changed, _ = imgui.checkbox("an eye behind an eyepiece", system.eye is not None)
        context.record_item_rect("eye")
        tooltip("Shows what reaches the retina instead of the light in a focal plane.")
        if changed:
            context.attempt(toggle_eye, context.session)
        if system.eye is None:
            return
        imgui.push_item_width(imgui.get_content_region_avail().x * 0.56)
        self._draw_focus(context)
        draw_pupil_map(context)
        _draw_pupil(context, system.eye)
        draw_path_controls(context)
        imgui.separator_text("focus of the wavelengths")
        draw_fields(context, system.eye, Eye(), "eye.", without=_ALL_BUT_CHROMATIC)
        draw_focus_graph(context)
        if imgui.collapsing_header("Eyepiece and retina"):
            hidden = () if system.eye.pupil_m == AUTO else ("luminance", "age")
            draw_fields(context, system.eye, Eye(), "eye.", without=(*_BY_HAND, "chromatic", *hidden))
        if imgui.collapsing_header("Prescription"):
            draw_fields(context, system.eye.prescription, Prescription(), "eye.prescription.")
        imgui.pop_item_width()

    def _draw_focus(self, context: AppContext) -> None:
        """Draws the accommodation, which moves the focal plane."""
        session = context.session
        span = [dioptres_of(session.system, z) for z in focus_range_m(session.system)]
        now = dioptres_of(session.system, session.view_settings.plane_m)
        doc = "Dioptres at which the eye is focused at its reference wavelength: 0 is infinity, 4 is 25 cm."
        edited = number_field("accommodation", VERGENCE, now, 0.0, doc, (span[0], span[1]))
        context.record_item_rect("accommodation")
        if edited is not None:
            context.attempt(focus_at, session, plane_of(session.system, edited.value))
            if not edited.is_held:
                session.end_gesture()


def _compare_achromatic(context: AppContext) -> None:
    """Compares with an eye without chromatic aberration in the mode of the last comparison, or ends that."""
    session, view = context.session, context.session.view_settings
    eye_of(session.system)
    if view.compare != "off" and (view.a, view.b) == (NOW, ACHROMATIC):
        context.edit_view("No comparison", compare="off")
        return
    compare = "wipe" if view.compare == "off" else view.compare
    context.edit_view("Compare", page="image", a=NOW, b=ACHROMATIC, compare=compare)


def _draw_pupil(context: AppContext, eye: Eye) -> None:
    system = context.session.system
    is_auto = eye.pupil_m == AUTO
    changed, wants_auto = imgui.checkbox("auto", is_auto)
    tooltip("A pupil that follows from luminance, field and age (Watson & Yellott 2012).")
    if changed:
        context.change("Pupil", "eye.pupil", AUTO if wants_auto else pupil_diameter_m(system))
    imgui.same_line()
    if is_auto:
        imgui.text(f"pupil {pupil_diameter_m(system) * 1e3:.2f} mm")
    else:
        imgui.set_next_item_width(imgui.get_content_region_avail().x * 0.62)
        _apply(
            context,
            "Pupil",
            "eye.pupil",
            number_field("pupil", PUPIL, pupil_diameter_m(system), 3e-3, "Diameter of the pupil.", PUPIL_RANGE_M),
        )
    context.record_item_rect("eye.pupil")
    for key, value in (("pupil_y", eye.pupil_y_m), ("pupil_x", eye.pupil_x_m)):
        doc = "Place of the pupil in the eyebox: " + ("downwards." if key == "pupil_y" else "to the right.")
        _apply(
            context,
            "Pupil",
            f"eye.{key}",
            number_field(key.replace("_", " "), PUPIL_PLACE, value, 0.0, doc, (-4e-3, 4e-3)),
        )
        context.record_item_rect(f"eye.{key}")


def _apply(context: AppContext, label: str, key: str, edited: WidgetEdit | None) -> None:
    if edited is not None:
        context.change(label, key, edited.value, is_held=edited.is_held)
