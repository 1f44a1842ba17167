"""Panels: parameters, lasers, focal plane, look; commands and keys; a panel that fails."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from imgui_bundle import hello_imgui, imgui

from holoview import load
from holoview.light.model import preset
from holoview.light.model.bench_parts import Relay
from holoview.light.model.stops import SquareStop
from holoview.viewer.app import window
from holoview.viewer.app.panel import Panel
from holoview.viewer.app.panels import ALL
from holoview.viewer.app.panels.focus import FocusPanel
from holoview.viewer.app.theme import THEMES
from holoview.viewer.document import document
from holoview.viewer.render.view_settings import NOW, ComparisonSide
from tests.gui.conftest import Gui, small_bench
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.gpu


# --- bench ----------------------------------------------------------------------------------------------------------


def test_dragging_a_slider_is_one_step_of_undo_and_can_be_undone(gui: Gui) -> None:
    steps, before = len(gui.session.history), gui.session.system.gap_m
    gui.drag(gui.item_position("gap", 0.2), gui.item_position("gap", 0.5), steps=8)
    assert gui.session.system.gap_m > before
    assert len(gui.session.history) == steps + 1
    gui.press_chord("Ctrl+Z")
    assert gui.session.system.gap_m == before
    gui.press_chord("Ctrl+Shift+Z")
    assert gui.session.system.gap_m > before


@pytest.mark.long
def test_a_drag_a_held_key_and_a_sweep_are_one_step_each_on_a_machine_of_any_speed(
    gui: Gui, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(document, "MERGE_WITHIN_S", -1.0)  # as if each frame took longer
    steps, planes = len(gui.session.history), [gui.session.view_settings.plane_m]
    gui.drag(gui.item_position("gap", 0.2), gui.item_position("gap", 0.5), steps=8)
    assert len(gui.session.history) == steps + 1
    gui.drag(gui.item_position("gap", 0.5), gui.item_position("gap", 0.3), steps=8)
    assert len(gui.session.history) == steps + 2
    gui.drag(gui.item_position("plane", 0.2), gui.item_position("plane", 0.5), steps=8)
    planes.append(gui.session.view_settings.plane_m)
    gui.drag(gui.item_position("plane", 0.5), gui.item_position("plane", 0.3), steps=8)
    planes.append(gui.session.view_settings.plane_m)
    gui.hold_keys(("ArrowRight",))
    gui.draw_frames(40)
    gui.release_keys(("ArrowRight",))
    planes.append(gui.session.view_settings.plane_m)
    gui.press_chord("Space")
    gui.draw_frames(10)
    gui.press_chord("Space")
    assert len(gui.session.history) == steps + 2, "looks are none of its steps"
    for plane_m in reversed(planes):
        assert gui.session.look_back() is not None and gui.session.view_settings.plane_m == plane_m
    assert not gui.session.can_look_back


def test_a_script_does_the_same_where_no_frame_is_in_time(gui: Gui, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(window, "_UNSEEN_S", -1.0)  # each drawing processes one step of the input
    before = gui.session.system.gap_m
    gui.click(gui.item_position("gap", 0.5))
    assert gui.session.system.gap_m != before and not gui.app.window.has_pending_input
    gui.press_chord("Ctrl+Z")
    assert gui.session.system.gap_m == before


def test_a_right_click_resets_a_slider(gui: Gui) -> None:
    before = gui.session.system.gap_m
    gui.drag(gui.item_position("gap", 0.2), gui.item_position("gap", 0.5))
    gui.click(gui.item_position("gap", 0.3), button=2)
    assert gui.session.system.gap_m == before


def test_ctrl_and_click_take_an_exact_value(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(engine=True)
    gui.engine(lambda ctx: ctx.item_input_value("**/gap", 3.21))
    assert gui.session.system.gap_m == pytest.approx(3.21e-3)


def test_what_is_impossible_is_told_and_changes_nothing(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(engine=True)
    before = gui.session.system
    gui.engine(lambda ctx: ctx.item_input_value("**/gap", -5.0))
    assert gui.session.system == before
    assert "out of range" in gui.last_message()


def test_every_group_of_parameters_opens(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(engine=True, size=(900, 700))
    headers = ("Modulators", "Source", "Relay 2 (to the focal plane)", "Simulation")

    def open_all(ctx: Any) -> None:
        ctx.set_ref("Bench")
        for header in headers:
            ctx.item_open(header)

    gui.engine(open_all)
    assert {"modulators.stroke", "relay2.iris_na", "sampling.upsample"} <= set(gui.context.item_rects)


def test_an_iris_and_an_aberration_are_switched_on_and_off(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(engine=True, size=(900, 700))

    def script(ctx: Any) -> None:
        ctx.set_ref("Bench")
        ctx.item_open("Relay 2 (to the focal plane)")
        ctx.item_click("**/##iris NA on")
        ctx.item_click("**/Add a term##aberration")

    gui.engine(script)
    relay = gui.session.system.relay2
    assert relay.iris_na is not None and relay.aberration_m[0][0] == 4


@pytest.mark.long
def test_a_square_stop_is_chosen_sized_and_moved(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(small_bench(relay2={}), engine=True, size=(900, 700))
    steps, kinds = len(gui.session.history), ("none", "first order", "first order at one wavelength", "aperture")

    def choose(kind: str) -> None:
        def script(ctx: Any) -> None:
            ctx.item_click("Bench/relay2.square/square stop")
            ctx.item_click(f"//$FOCUSED/$${kinds.index(kind)}/{kind}")

        gui.engine(script)

    def enter(name: str, value: float) -> Callable[[Any], None]:
        return lambda ctx: ctx.item_input_value(f"Bench/**/{name}", value)

    def stops() -> Relay:
        return gui.session.system.relay2

    gui.engine(lambda ctx: ctx.item_open("Bench/Relay 2 (to the focal plane)"))
    choose("first order")
    assert stops() == Relay(square="first order") and len(gui.session.history) == steps + 1
    assert gui.session.history[-1].label == "Square stop"
    choose("first order at one wavelength")
    assert stops() == Relay(square="first order at 550 nm")
    gui.engine(enter("at", 620.0))
    gui.engine(enter("width", 1.2))
    assert stops() == Relay(square="1.2 first order at 620 nm")
    gui.engine(enter("centre x", 0.004))
    assert stops().centre_na == (0.0, 0.004) and gui.session.history[-1].label == "Centre of the stops"
    choose("aperture")
    assert stops().square == SquareStop(half_side_na=1.2 * 620e-9 / (2 * gui.session.system.modulators[0].pitch_m))
    gui.engine(enter("half side NA", 0.025))
    assert stops() == Relay(square=0.025, centre_na=(0.0, 0.004))
    gui.engine(enter("half side NA", 2.0))
    assert stops().square == SquareStop(half_side_na=0.025) and "out of range" in gui.last_message()
    choose("none")
    assert stops().square is not None and "without an iris or a square stop" in gui.last_message()
    gui.engine(enter("centre x", 0.0))
    choose("none")
    assert stops() == Relay() and "relay2.centre_na" in gui.context.item_rects
    gui.press_chord("Ctrl+Z")
    assert stops() == Relay(square=0.025)


def test_sliders_of_a_centre_are_there_only_beside_a_stop(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(small_bench(relay2={}), engine=True, size=(900, 700))
    gui.engine(lambda ctx: ctx.item_open("Bench/Relay 2 (to the focal plane)"))
    for relay, has_one in (
        ({}, False),
        ({"iris_na": 0.02}, True),
        ({"dc_block_na": 1e-3}, False),
        ({"square": 0.02}, True),
    ):
        gui.session.change("Relay", {"relay2": relay})
        gui.context.item_rects.clear()
        gui.draw_frames(2)
        assert ("relay2.centre_na" in gui.context.item_rects) is has_one
        assert "relay2.square" in gui.context.item_rects


# --- lasers ---------------------------------------------------------------------------------------------------------


def test_dragging_a_peak_changes_wavelength_and_power(gui: Gui) -> None:
    before = gui.session.system
    x, y = gui.item_position("laser 1")
    gui.drag((x, y), (x + 12, y + 15))
    after = gui.session.system
    assert after.wavelengths_m[1] > before.wavelengths_m[1]
    assert after.amplitudes[0, 1] < before.amplitudes[0, 1]
    assert np.array_equal(after.wavelengths_m[[0, 2]], before.wavelengths_m[[0, 2]])


def test_lasers_are_added_balanced_soloed_and_removed(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(engine=True, size=(900, 700))
    gui.engine(lambda ctx: ctx.item_click("Lasers/Add"))
    assert len(gui.session.system.wavelengths_m) == 4
    gui.press_chord("2")
    assert gui.session.view_settings.solo == 1
    assert np.count_nonzero(gui.session.displayed_document.system.amplitudes) == 1
    gui.press_chord("0")
    assert gui.session.view_settings.solo is None
    gui.click(gui.item_position("remove 3"))
    assert len(gui.session.system.wavelengths_m) == 3


def test_lasers_are_entered_exactly_muted_and_taken_from_a_preset(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(engine=True, size=(900, 700))
    gui.engine(lambda ctx: ctx.item_input_value("Lasers/**/$$0/##nm", 471.5))
    assert gui.session.system.wavelengths_m[0] == pytest.approx(471.5e-9)
    gui.engine(lambda ctx: ctx.item_click("Lasers/**/$$1/M"))
    assert gui.session.view_settings.muted == {1}
    assert np.count_nonzero(gui.session.displayed_document.system.amplitudes) == 2

    def take(ctx: Any) -> None:
        ctx.set_ref("Lasers")
        ctx.combo_click("##set/holochrome-8")

    gui.engine(take)
    assert np.array_equal(gui.session.system.wavelengths_m, load("holochrome-8").wavelengths_m)


def test_frames_have_patterns_of_their_own(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(engine=True, size=(900, 700))
    gui.engine(lambda ctx: ctx.item_input_value("Bench/**/frames", 3))
    assert gui.session.system.frames == 3 and len(gui.session.drive) == 3
    gui.context.commands.run("Random patterns")
    drive = gui.session.drive
    assert not np.array_equal(drive[0], drive[1])
    gui.context.commands.run("Random patterns")
    assert not np.array_equal(gui.session.drive, drive)
    gui.press_chord("Ctrl+Z")
    assert gui.session.drive is drive


# --- focal plane ----------------------------------------------------------------------------------------------------


def test_the_focal_plane_is_scrubbed_by_slider_keys_and_thumbnails(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(size=(900, 700))
    gui.draw_until_idle()
    gui.drag(gui.item_position("plane", 0.5), gui.item_position("plane", 0.8))
    dragged = gui.session.view_settings.plane_m
    assert dragged > 10e-3
    gui.press_chord("Left")
    assert gui.session.view_settings.plane_m < dragged
    gui.press_chord("PageUp")
    assert gui.session.view_settings.plane_m in gui.session.system.planes_m
    gui.click(gui.item_position("plane 9 mm"))
    assert gui.session.view_settings.plane_m == pytest.approx(9e-3)


def test_play_goes_through_the_stack_until_it_is_stopped(gui: Gui) -> None:
    gui.press_chord("Space")
    assert gui.app.panel(FocusPanel).is_playing
    gui.draw_frames(3)
    first = gui.session.view_settings.plane_m
    gui.draw_frames(3)
    assert gui.session.view_settings.plane_m != first
    gui.press_chord("Space")
    assert not gui.app.panel(FocusPanel).is_playing


# --- look -----------------------------------------------------------------------------------------------------------


def test_keys_change_the_look(gui: Gui) -> None:
    changes = {
        "E": ("exposure_stops", 0.25),
        "R": ("exposure_stops", 0.0),
        "Shift+E": ("exposure_stops", -0.25),
        "W": ("compare", "wipe"),
        "D": ("compare", "difference"),
        "Escape": ("compare", "off"),
        "C": ("channel", "luminance"),
        "G": ("page", "planes"),
        "Z": ("zoom", 1.0),
        "F": ("zoom", 0.0),
    }
    for key, (field, value) in changes.items():
        gui.press_chord(key)
        assert getattr(gui.session.view_settings, field) == value, key


@pytest.mark.parametrize("place", ["menu", "list"])
def test_an_open_menu_has_the_keys_and_escape_closes_it_first(make_gui: Callable[..., Gui], place: str) -> None:
    gui = make_gui(size=(900, 900))
    gui.session.edit_view("Compare", compare="wipe")
    gui.context.show_panel("View")
    gui.draw_frames(3)
    gui.click((12.0, 8.0) if place == "menu" else gui.item_position("page"))

    def open_menus() -> int:
        return len(imgui.get_current_context().open_popup_stack)

    assert open_menus() == 1
    gui.press_chord("E")
    assert gui.session.view_settings.exposure_stops == 0 and open_menus() == 1
    gui.press_chord("Escape")
    assert gui.session.view_settings.compare == "wipe" and open_menus() == 0
    gui.press_chord("Escape")
    assert gui.session.view_settings.compare == "off"


def test_the_sheet_of_keys_has_the_keys(gui: Gui) -> None:
    gui.press_chord("F1")
    gui.press_chord("E")
    gui.press_chord("G")
    assert (gui.session.view_settings.exposure_stops, gui.session.view_settings.page) == (0.0, "image")
    gui.press_chord("F1")
    gui.press_chord("E")
    assert gui.session.view_settings.exposure_stops == 0.25


@pytest.mark.long
def test_a_comparison_of_schemes_and_escape_bring_everything_back(gui: Gui) -> None:
    gui.session.change("Gap", {"gap": 5e-3})
    gui.press_chord("Ctrl+Z")
    gui.session.edit_view("Page", page="phase")
    before = gui.session.view_settings
    gui.press_chord("F5")
    assert gui.session.wait_until_idle(PATIENCE_S)
    assert gui.session.view_settings.compare == "side-by-side" and gui.session.view_settings.page == "image"
    gui.press_chord("Escape")
    assert gui.session.view_settings == before
    gui.press_chord("Ctrl+Y")
    assert gui.session.system.gap_m == 5e-3
    gui.press_chord("Alt+Z")
    assert gui.session.view_settings.compare == "side-by-side"


def test_exposure_has_a_slider(gui: Gui) -> None:
    gui.context.show_panel("View")
    gui.draw_frames(3)
    gui.drag(gui.item_position("exposure", 0.5), gui.item_position("exposure", 0.7))
    assert gui.session.view_settings.exposure_stops > 1
    gui.press_chord("R")
    assert gui.session.view_settings.exposure_stops == 0


def test_pinning_keeps_the_present_state(gui: Gui) -> None:
    gui.press_chord("P")
    assert list(gui.session.snapshots) == ["Snapshot 1"]


def test_a_snapshot_is_renamed_in_its_field_and_still_compared_with(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(size=(900, 900))
    first, second = gui.session.pin(), gui.session.pin()
    gui.session.edit_view("Compare", b=ComparisonSide("snapshot", first))
    gui.context.show_panel("View")
    gui.draw_frames(3)

    def enter(name: str, typed: str, last_key: str) -> list[str]:
        gui.click(gui.item_position(f"snapshot {name}"))
        gui.press_chord("Ctrl+A")
        gui.type_text(typed)
        gui.press_chord(last_key)
        return list(gui.session.snapshots)

    assert enter(first, "before", "Enter") == ["before", second]
    assert gui.session.view_settings.b == ComparisonSide("snapshot", "before")
    assert enter(second, "nothing", "Escape") == ["before", second]
    assert enter(second, " Target ", "Tab") == ["before", "Target"]
    assert gui.last_message() == ""
    assert enter("Target", "before", "Enter") == ["before", "Target"]
    assert "isn't taken" in gui.last_message()


def test_a_snapshot_is_forgotten_by_its_button(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(size=(900, 900))
    kept, gone = gui.session.pin(), gui.session.pin()
    gui.session.edit_view("Compare", a=ComparisonSide("snapshot", gone), b=ComparisonSide("snapshot", kept))
    gui.context.show_panel("View")
    gui.draw_frames(3)
    gui.click(gui.item_position(f"forget {gone}"))
    assert list(gui.session.snapshots) == [kept]
    assert (gui.session.view_settings.a, gui.session.view_settings.b) == (NOW, ComparisonSide("snapshot", kept))


# --- the app --------------------------------------------------------------------------------------------------------


def test_no_key_has_two_meanings_at_once_and_every_menu_has_some(gui: Gui) -> None:
    """The digits are those of lasers, or of holograms while several are open."""
    names = {command.name for command in gui.context.commands if not command.shares_keys}
    for sharing in ("Solo a laser", "Show a hologram"):
        found = [c for c in gui.context.commands if c.name in names or (c.shares_keys and c.is_enabled())]
        codes = [chord.code for command in found for chord in command.keys]
        assert len(codes) == len(set(codes)) and sharing in {command.name for command in found}
        gui.press_chord("P")
    assert {"File", "Edit", "Image", "Compare", "Help"} <= {command.group for command in gui.context.commands}


def test_the_palette_finds_and_runs_a_command(gui: Gui) -> None:
    gui.press_chord("Ctrl+P")
    gui.draw_frames(2)
    gui.type_text("wipe")
    assert [command.name for command in gui.context.help_overlay.matches()] == ["Compare: wipe"]
    gui.press_chord("Enter")
    assert gui.session.view_settings.compare == "wipe"
    assert gui.context.help_overlay.page == ""


def test_the_palette_has_what_menus_draw_themselves(gui: Gui) -> None:
    """Themes, sizes of text, panels, presets and the layout."""
    names = {command.name for command in gui.context.help_overlay.matches()}
    assert {*(f"{name} theme" for name in THEMES), "Original layout", "Text size 150%"} <= names
    assert {f"Open {name}" for name in preset.names()} <= names
    assert {f"Show {each.panel.title}" for each in gui.app.panels} <= names
    for theme in ("Light", "Dark"):
        gui.press_chord("Ctrl+P")
        gui.draw_frames(2)
        gui.type_text(f"{theme.lower()} theme")
        gui.press_chord("Enter")
        assert gui.context.theme == theme


def test_keys_typed_into_a_field_are_no_commands(gui: Gui) -> None:
    gui.press_chord("Ctrl+P")
    gui.draw_frames(2)
    gui.type_text("w")
    gui.press_chord("W")
    assert gui.session.view_settings.compare == "off"


class _Broken(Panel):
    title = "Broken"
    dock = "Left"
    fails = False

    def draw(self, app: Any) -> None:
        imgui.begin_child("inner")
        imgui.push_id("some")
        if self.fails:
            raise ValueError("boom")
        imgui.pop_id()
        imgui.end_child()


def test_a_failing_panel_shows_its_error_and_the_rest_goes_on(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(panels=(*ALL, _Broken))
    broken = next(guarded for guarded in gui.app.panels if isinstance(guarded.panel, _Broken))
    broken.panel.fails = True
    gui.context.show_panel("Broken")
    gui.draw_frames(5)
    assert isinstance(broken.failure, ValueError)
    assert "boom" in gui.last_message()
    before = gui.session.view_settings.plane_m
    gui.press_chord("Right")
    assert gui.session.view_settings.plane_m > before
    broken.failure = None
    broken.panel.fails = False
    gui.draw_frames(3)
    assert broken.failure is None


@pytest.mark.parametrize(
    "preset",
    [
        pytest.param("time-sequential", marks=pytest.mark.long),
        pytest.param("multisource-3x3", marks=pytest.mark.long),
        "holochrome-8-1slm",
    ],
)
def test_other_benches_are_shown_too(make_gui: Callable[..., Gui], preset: str) -> None:
    gui = make_gui(load(preset).edit({"shape": [32, 48]}))
    gui.draw_until_idle()
    assert gui.context.side_renderers.now.is_fresh
    assert gui.context.side_renderers.xyz(gui.session.view_settings.a).shape == (64, 96, 3)


def test_an_edit_while_the_image_is_computed_drops_what_is_stale(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(small_bench())
    gui.app.compute_slice()
    for plane_m in (9.1e-3, 9.2e-3, 9.3e-3):
        gui.session.edit_view("Plane", plane_m=plane_m)
        gui.app.compute_slice()
    gui.draw_until_idle()
    assert gui.context.side_renderers.now.full_scene.plane_m == 9.3e-3
    lights = gui.context.side_renderers.now.full_renderer.dispatch_counts["light"]
    assert lights == 3  # the first rows of each laser, once: planes share them


def test_a_key_that_is_held_goes_on_without_further_events(gui: Gui) -> None:
    gui.hold_keys(("ArrowRight",))
    first = gui.session.view_settings.plane_m
    gui.draw_frames(40)
    assert gui.context.commands.is_repeating()
    assert gui.session.view_settings.plane_m > first
    gui.release_keys(("ArrowRight",))
    assert not gui.context.commands.is_repeating()


def test_a_moment_after_the_last_event_frames_are_due_for_tooltips(gui: Gui) -> None:
    gui.move(gui.item_position("gap"))
    time.sleep(0.75)
    assert gui.app.window.needs_redraw()
    assert not gui.app.window.needs_redraw()
    gui.session.messages.post("something happened")
    assert gui.app.toasts.has_changed()
    gui.draw_frames(2)
    assert not gui.app.toasts.has_changed()


def test_the_original_layout_opens_what_was_closed_and_closes_the_rest(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(size=(1024, 700))
    windows = {of.label: of for of in hello_imgui.get_runner_params().docking_params.dockable_windows}
    gui.draw_frames(3)
    windows["Effects"].is_visible, windows["Sweep"].is_visible = False, True
    gui.draw_frames(3)
    gui.context.commands.run("Original layout")
    gui.draw_frames(3)
    assert windows["Effects"].is_visible and not windows["Sweep"].is_visible


def test_a_click_on_a_tab_that_isnt_in_front_never_closes_its_panel(make_gui: Callable[..., Gui]) -> None:
    """Wherever on it: its cross is there once it is in front."""
    gui = make_gui(size=(1280, 800))
    gui.draw_frames(3)
    bar = imgui.internal.find_window_by_name("Eye").dock_node.tab_bar
    tab = next(tab for tab in bar.tabs if tab.window is not None and tab.window.name == "Eye")
    gui.click((bar.bar_rect.min.x + tab.offset + tab.width - 12, bar.bar_rect.min.y + 10))
    gui.draw_frames(3)
    windows = {of.label: of for of in hello_imgui.get_runner_params().docking_params.dockable_windows}
    assert windows["Eye"].is_visible
    assert imgui.internal.find_window_by_name("Eye").dock_node.visible_window.name == "Eye"
