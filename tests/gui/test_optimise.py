"""Optimising from the panel: started, followed, paused, kept, cancelled, undone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
import pytest
from imgui_bundle import imgui
from PIL import Image

import holoview as hv
from holoview.light.model.system import System
from holoview.viewer.app import app
from holoview.viewer.app.panels.files import FilesPanel
from holoview.viewer.app.panels.image import ImagePanel
from holoview.viewer.app.panels.optimise import OptimisePanel
from holoview.viewer.document import optimisation_job
from holoview.viewer.document.file_loader import target_from_pixels
from holoview.viewer.document.focus_edits import toggle_eye
from holoview.viewer.document.optimisation_job import (
    OptimisationJob,
    chosen_optimisation,
    last_optimisation,
    running_optimisation,
    start_live_optimisation,
)
from holoview.viewer.document.target_builder import TargetSpec
from holoview.viewer.render.progressive_renderer import ProgressiveRenderer
from holoview.viewer.render.view_settings import NOW
from tests.gui.conftest import Gui
from tests.patience import PATIENCE_S, wait_until

pytestmark = pytest.mark.gpu


@pytest.fixture
def gui(make_gui: Callable[..., Gui]) -> Gui:
    opened = make_gui(size=(800, 480), engine=True, panels=(ImagePanel, OptimisePanel))
    pixels = np.full((64, 96, 3), 90, np.uint8)
    pixels[16:48, 24:72] = 230
    opened.session.edit("Target", target_spec=target_from_pixels(pixels, "square"))
    opened.draw_until_idle()
    return opened


def _until(gui: Gui, condition: Callable[[], bool]) -> None:
    wait_until(condition, meanwhile=lambda: (gui.process_frames(), gui.app.compute_slice()), pause_s=0.0)


LONG = 100_000
"""[iterations] More than are done before somebody ends them, however long a busy machine takes for a click."""


def _choose(gui: Gui, **fields: Any) -> None:
    gui.session.choose_optimisation(replace(gui.session.optimisation_choices, **fields))


def _optimise(gui: Gui) -> None:
    """Optimises as is chosen, to the end."""
    gui.press_chord("Ctrl+Enter")
    _until(gui, lambda: last_optimisation(gui.session) is not None and running_optimisation(gui.session) is None)


def test_behind_a_quick_look_a_hint_stays_until_one_has_optimised(gui: Gui) -> None:
    assert not gui.context.wants_better_patterns
    gui.context.commands.run("Quick look")
    _until(gui, lambda: running_optimisation(gui.session) is None)
    gui.draw_frames(2)
    assert gui.context.wants_better_patterns and "better patterns" in gui.context.item_rects
    _choose(gui, iterations=1)
    _optimise(gui)
    assert not gui.context.wants_better_patterns
    gui.context.commands.run("Quick look")
    _until(gui, lambda: running_optimisation(gui.session) is None)
    assert not gui.context.wants_better_patterns


def test_optimise_is_followed_kept_and_taken_back(gui: Gui) -> None:
    old = gui.session.drive
    _choose(gui, iterations=LONG)
    gui.engine(lambda ctx: ctx.item_click("Optimise/Optimise##start"))
    job = running_optimisation(gui.session)
    assert job is not None
    _until(gui, lambda: job.latest is not None and gui.session.displayed_document.drive is not old)
    assert gui.session.drive is old, "the document changes only at the end"
    pause = partial(gui.engine, lambda ctx: ctx.item_click("Optimise/Pause"))
    wait_until(lambda: job.status == "paused", meanwhile=pause, pause_s=0.0)  # again where a busy screen moved it
    gui.engine(lambda ctx: ctx.item_click("Optimise/Keep"))
    _until(gui, lambda: not job.is_active)
    assert job.status == "done" and gui.session.drive is not old
    gui.press_chord("Ctrl+Z")
    assert gui.session.drive is old


def test_from_the_first_second_one_sees_the_target_and_what_is_prepared(
    make_gui: Callable[..., Gui], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl+Enter brings the panel to the front; the target is on the image until the first picture is."""
    gui = make_gui(size=(1024, 700))
    pixels = np.full((64, 96, 3), 90, np.uint8)
    pixels[16:48, 24:72] = 230
    gui.session.edit("Target", target_spec=target_from_pixels(pixels, "square"))
    gui.draw_until_idle()
    gui.context.show_panel("Files")
    gui.draw_frames(3)
    goes_on = Event()
    monkeypatch.setattr(OptimisationJob, "_seen_target", _held(goes_on, OptimisationJob._seen_target))
    _choose(gui, iterations=4)
    gui.press_chord("Ctrl+Enter")
    job = running_optimisation(gui.session)
    assert job is not None
    _until(gui, lambda: job.note == "building the target" and gui.session.target_at() is not None)
    gui.draw_frames(3)
    assert job.step.startswith("building the target … ") and job.step.endswith(" s")
    shown = gui.context.displayed_pixels()
    assert shown is not None
    middle, edge = shown[len(shown) // 2, shown.shape[1] // 2], shown[len(shown) // 2, 20]
    assert (middle.astype(int) - edge > 100).all(), "a bright square, which random patterns don't show"
    assert imgui.internal.find_window_by_name("Optimise").dock_node.visible_window.name == "Optimise", "in front"
    goes_on.set()
    _until(gui, lambda: not job.is_active)


def _held(goes_on: Event, function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, which begins when it may."""

    def hold(*arguments: Any) -> Any:
        assert goes_on.wait(PATIENCE_S)
        return function(*arguments)

    return hold


def test_cancel_leaves_the_old_patterns(gui: Gui) -> None:
    old = gui.session.drive
    _choose(gui, iterations=LONG)
    gui.press_chord("Ctrl+Enter")
    job = running_optimisation(gui.session)
    assert job is not None
    _until(gui, lambda: job.latest is not None)
    gui.engine(lambda ctx: ctx.item_click("Optimise/Cancel"))
    _until(gui, lambda: not job.is_active)
    assert job.status == "cancelled" and gui.session.drive is old


def test_what_is_chosen_is_what_is_done(gui: Gui) -> None:
    def choose(ctx: Any) -> None:
        ctx.set_ref("Optimise")
        ctx.combo_click("scheme/holochrome-8")
        ctx.combo_click("begin/smooth")
        ctx.item_input_value("iterations", 2)

    gui.engine(choose)
    plan = chosen_optimisation(gui.session.optimisation_choices, gui.session.system)
    assert (plan.scheme, plan.start_patterns, plan.settings.iterations) == ("holochrome-8", "smooth", 2)
    _optimise(gui)
    assert len(gui.session.system.wavelengths_m) == 8 and "2 iterations" in gui.session.document.origin


def test_the_pupil_is_drawn_anew_or_moved_over_a_grid_as_is_chosen(gui: Gui) -> None:
    toggle_eye(gui.session)
    gui.draw_until_idle()

    def draw_anew(ctx: Any) -> None:
        ctx.set_ref("Optimise")
        ctx.combo_click("pupil/drawn anew")
        ctx.item_input_value("places", 2)
        ctx.item_input_value("radius", 0.5)
        ctx.combo_click("colour error/ignore")
        ctx.item_input_value("iterations", 2)

    gui.engine(draw_anew)
    choices = gui.session.optimisation_choices
    assert (choices.pupils, choices.chromatic) == ("random:2:0.5mm", "ignore")
    _optimise(gui)
    assert "for pupils random:2:0.5mm, an eye without colour error" in gui.session.document.origin
    eye = gui.session.system.eye
    assert eye is not None and eye.chromatic, "the eye itself stays as it is"

    def move_over_a_grid(ctx: Any) -> None:
        ctx.set_ref("Optimise")
        ctx.combo_click("pupil/on a grid")
        ctx.item_input_value("spacing", 0.3)

    gui.engine(move_over_a_grid)
    assert gui.session.optimisation_choices.pupils == "3x3:0.3mm"
    gui.engine(lambda ctx: (ctx.set_ref("Optimise"), ctx.combo_click("pupil/where it is")))
    assert gui.session.optimisation_choices.pupils == ""


def test_without_an_eye_no_pupil_is_moved(gui: Gui) -> None:
    _choose(gui, iterations=1, pupils="3x3:0.3mm", chromatic="ignore")
    _optimise(gui)
    assert "optimised, 1 iterations" in gui.session.document.origin


@pytest.mark.long
def test_the_hologram_follows_the_newest_picture_of_a_folder(make_gui: Callable[..., Gui], tmp_path: Path) -> None:
    """Chosen in the dialog, watched in the panel, and kept."""
    gui = make_gui(size=(800, 480), engine=True, panels=(ImagePanel, OptimisePanel, FilesPanel))
    gui.app.panel(FilesPanel).dialog.folder = tmp_path
    gui.draw_until_idle()
    Image.fromarray(np.full((48, 64, 3), 200, np.uint8)).save(tmp_path / "a.png")
    _choose(gui, iterations=5)
    old = gui.session.drive
    gui.context.commands.run("Live target from a film or folder…")
    gui.draw_frames(2)
    gui.engine(lambda ctx: ctx.item_click("//Live target from a film or folder/This folder"))
    job = running_optimisation(gui.session)
    assert job is not None
    _until(gui, lambda: job.latest is not None)
    Image.fromarray(np.full((48, 64, 3), 30, np.uint8)).save(tmp_path / "b.png")
    _until(gui, lambda: len(job.progress) > 1 and gui.session.target_spec.source.source.endswith("b.png"))
    gui.draw_frames(2)
    gui.engine(lambda ctx: ctx.item_click("Optimise/Keep"))
    _until(gui, lambda: not job.is_active)
    assert job.status == "done" and gui.session.drive is not old


def test_the_camera_that_is_not_there_is_told(gui: Gui, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("av")
    monkeypatch.setattr("holoview.holograms.targets.live_pictures._LINUX", ("v4l2", "/dev/no-camera"))
    monkeypatch.setattr("holoview.holograms.targets.live_pictures._INPUTS", {})
    start_live_optimisation(gui.session, "camera")
    _until(gui, lambda: running_optimisation(gui.session) is None)
    assert "camera /dev/no-camera: can't be opened" in gui.last_message()


def test_brightness_of_the_target_is_one_step_of_undo(gui: Gui) -> None:
    gui.engine(lambda ctx: ctx.item_input_value("Optimise/brightness", 0.5))
    assert gui.session.target_spec.brightness == pytest.approx(0.5)
    gui.press_chord("Ctrl+Z")
    assert gui.session.target_spec.brightness == 1.0


def test_the_place_of_a_fields_target_is_one_step_of_undo(gui: Gui, tmp_path: Path) -> None:
    system = gui.session.system
    hv.as_field(hv.Hologram(hv.random_drive(system), system)).save(tmp_path / "wanted.safetensors")
    gui.context.loader.open_field_as_target(tmp_path / "wanted.safetensors")
    gui.draw_until_idle()
    gui.engine(lambda ctx: ctx.item_input_value("Optimise/at", 2.0))
    assert gui.session.target_spec.placement.at_m == pytest.approx(2e-3)
    gui.press_chord("Ctrl+Z")
    assert gui.session.target_spec.placement.at_m is None


def test_a_chain_of_elements_is_followed_kept_and_shown(make_gui: Callable[..., Gui]) -> None:
    """Its own pixels, grid and elements; the picture is that of the reference."""
    elements = (
        {"kind": "phase", "pitch": "8 um", "shape": [24, 32], "stroke": "700 nm"},
        {"kind": "space", "distance": "2 mm"},
        {"kind": "amplitude", "name": "coarse", "pitch": "32 um", "shape": [6, 8]},
    )
    system = System(["460 nm", "633 nm"], [[1.0, 1.0]], elements=elements, planes_m=[6e-3, 7e-3])
    gui = make_gui(system, size=(800, 480), panels=(ImagePanel, OptimisePanel))
    pixels = np.full((48, 64, 3), 90, np.uint8)
    pixels[12:36, 16:48] = 230
    gui.session.edit("Target", target_spec=target_from_pixels(pixels, "square"))
    gui.draw_until_idle()
    old = gui.session.drive
    _choose(gui, iterations=12)
    seen = []
    gui.press_chord("Ctrl+Enter")
    job = running_optimisation(gui.session)
    assert job is not None
    _until(gui, lambda: bool(seen.append(gui.session.displayed_document.drive)) or not job.is_active)
    assert job.status == "done" and gui.session.drive is not old
    assert job.progress[-1].best_psnr_db > job.progress[0].psnr_db
    gui.draw_until_idle()
    plane_m = gui.session.view_settings.plane_m
    known = hv.simulate(gui.session.system, dict(gui.session.drive), planes=[plane_m], backend="torch64").xyz[0]
    shown = gui.context.side_renderers.xyz(NOW)
    assert np.abs(shown - known).max() < 1e-4 * known.max()
    gui.press_chord("Ctrl+Z")
    assert gui.session.drive is old


def test_what_an_optimisation_needs_is_prepared_while_the_window_rests(
    make_gui: Callable[..., Gui], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Once, and only where there is a target: the optimiser is loaded, the target built."""
    loaded: list[None] = []
    monkeypatch.setattr(app, "load_optimiser", lambda: loaded.append(None))
    monkeypatch.setattr(ProgressiveRenderer, "poll_strategy", lambda self: None)  # nothing is searched for here
    gui = make_gui(panels=(ImagePanel,), tunes=True)
    gui.draw_until_idle()
    monkeypatch.setattr(app, "_PREPARES_AFTER_S", -1.0)
    gui.app.redraw_if_due()
    assert not loaded, "there is no target"
    spec = target_from_pixels(np.full((64, 96, 3), 90, np.uint8), "grey")
    gui.session.edit("Target", target_spec=spec)
    monkeypatch.setattr(app, "_PREPARES_AFTER_S", 1e9)
    gui.draw_until_idle()
    gui.app.redraw_if_due()
    assert not loaded, "the window doesn't rest"
    monkeypatch.setattr(app, "_PREPARES_AFTER_S", -1.0)
    for _ in range(2):
        gui.app.redraw_if_due()
        gui.draw_until_idle()
    wait_until(lambda: len(loaded) > 0)
    assert len(loaded) == 1
    assert gui.session.target_builder.built_stack(spec, gui.session.system) is not None


def test_a_target_that_the_window_builds_isnt_built_again(gui: Gui, monkeypatch: pytest.MonkeyPatch) -> None:
    built, goes_on, build = list[None](), Event(), TargetSpec.build

    def counted(*arguments: Any) -> Any:
        built.append(None)
        assert goes_on.wait(PATIENCE_S)
        return build(*arguments)

    monkeypatch.setattr(TargetSpec, "build", counted)
    monkeypatch.setattr(optimisation_job, "_LONGEST_WAIT_S", PATIENCE_S)
    gui.session.edit("Target", target_spec=target_from_pixels(np.full((64, 96, 3), 90, np.uint8), "grey"))
    gui.session.target_at()
    _choose(gui, iterations=1)
    gui.press_chord("Ctrl+Enter")
    job = running_optimisation(gui.session)
    assert job is not None
    _until(gui, lambda: job.note == "building the target" and len(built) > 0)
    goes_on.set()
    _until(gui, lambda: running_optimisation(gui.session) is None)
    assert job.status == "done" and len(built) == 1
