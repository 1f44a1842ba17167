"""Speckle: drawn on the image, figures follow it, the comparison of schemes by one key."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from holoview.viewer.app.panels.image import ImagePanel
from holoview.viewer.app.panels.speckle import SpecklePanel
from holoview.viewer.app.panels.view_settings import ViewPanel
from holoview.viewer.document import optimisation_job
from holoview.viewer.document.document import Document
from holoview.viewer.document.file_loader import target_from_pixels
from holoview.viewer.document.measurements import measure_region
from holoview.viewer.render.view_settings import NOW
from tests.gui.conftest import Gui, small_bench
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.gpu


@pytest.fixture
def gui(make_gui: Callable[..., Gui]) -> Gui:
    opened = make_gui(size=(800, 480), engine=True, panels=(ImagePanel, SpecklePanel))
    opened.draw_until_idle()
    return opened


def _drag(gui: Gui, start: tuple[float, float], end: tuple[float, float]) -> None:
    gui.drag(gui.item_position("image", *start), gui.item_position("image", *end))
    gui.draw_until_idle()


def test_a_region_is_drawn_on_the_image_and_its_figures_follow(gui: Gui) -> None:
    whole = gui.context.live_measurement.measurements.region
    assert whole.contrast == pytest.approx(
        measure_region(gui.context.side_renderers.xyz(NOW), gui.session.document.measured_region).contrast
    )
    gui.engine(lambda ctx: ctx.item_click("Speckle/Region"))
    assert gui.context.drag_tool == "region"
    _drag(gui, (0.4, 0.4), (0.6, 0.6))
    region = gui.session.view_settings.region
    assert region is not None and region != whole and gui.context.drag_tool == ""
    figures = gui.context.live_measurement.measurements
    assert figures.region.n_pixels == region[2] * region[3]
    assert figures.region.contrast == measure_region(gui.context.side_renderers.xyz(NOW), region).contrast
    gui.session.change("Gap", {"gap": 3e-3})
    gui.draw_until_idle()
    assert gui.context.live_measurement.measurements is not figures, "figures follow the image"
    gui.engine(lambda ctx: ctx.item_click("Speckle/Forget"))
    assert gui.session.view_settings.region is None
    gui.press_chord("Alt+Z")
    assert gui.session.view_settings.region == region


def test_with_a_target_its_structure_is_divided_out_and_fidelity_is_told(gui: Gui) -> None:
    assert gui.context.live_measurement.measurements.region.psnr_db is None
    gui.session.edit("Target", target_spec=target_from_pixels(np.full((64, 96, 3), 128, np.uint8)))
    assert gui.session.wait_until_idle(PATIENCE_S)
    gui.draw_until_idle()
    region = gui.context.live_measurement.measurements.region
    xyz = gui.context.side_renderers.xyz(NOW)
    expected = measure_region(xyz, gui.session.document.measured_region, gui.session.target_at())
    assert (region.psnr_db, region.delta_e) == (expected.psnr_db, expected.delta_e)
    assert region.psnr_db is not None and region.delta_e > 0


def test_the_curve_and_the_histogram_are_of_every_wavelength(gui: Gui) -> None:
    figures = gui.context.live_measurement.measurements
    assert len(figures.curve.measured) == 3
    assert figures.curve.measured[-1] == pytest.approx(figures.region.contrast, rel=1e-3), "all lasers together"
    assert figures.curve.measured[0] > figures.curve.measured[-1]
    assert figures.histogram.density.sum() > 0


def test_a_line_is_drawn_and_its_profile_plotted(gui: Gui) -> None:
    gui.press_chord("Shift+L")
    _drag(gui, (0.45, 0.5), (0.55, 0.5))
    profile, line = gui.context.live_measurement.measurements.profile, gui.session.view_settings.profile
    assert line is not None and profile.values.max() > 0
    pitch_m = gui.session.system.modulators[0].pitch_m / gui.session.system.sampling.upsample
    assert profile.distance_m[-1] == pytest.approx(np.hypot(line[2] - line[0], line[3] - line[1]) * pitch_m)


def test_a_region_is_entered_exactly(gui: Gui) -> None:
    def enter(ctx: Any) -> None:
        for number, value in enumerate((8, 9, 30, 20)):
            ctx.item_input_value(f"Speckle/x y w h/$${number}", value)

    gui.engine(enter)
    gui.draw_until_idle()
    assert gui.session.view_settings.region == (8, 9, 30, 20)


@pytest.mark.long
def test_one_key_shows_simultaneous_beside_holochrome_with_their_contrasts(gui: Gui) -> None:
    gui.press_chord("F5")
    assert gui.session.wait_until_idle(PATIENCE_S)
    gui.draw_until_idle()
    look = gui.session.view_settings
    assert look.compare == "side-by-side" and look.a.label.startswith("Simultaneous, 3 wavelengths: contrast 0.")
    assert look.b.label.startswith("HoloChrome, 8 wavelengths: contrast 0.")
    result = gui.app.panel(SpecklePanel).comparison
    assert result.right.contrast < result.left.contrast
    assert gui.draw_frames(2).std() > 20


def test_escape_ends_a_comparison_that_is_still_being_computed(
    make_gui: Callable[..., Gui], monkeypatch: pytest.MonkeyPatch
) -> None:
    gui, may_go_on = make_gui(panels=(ImagePanel, SpecklePanel, ViewPanel)), threading.Event()
    compute = optimisation_job._document_of_scheme

    def later(*arguments: Any) -> Document:
        assert may_go_on.wait(PATIENCE_S)
        return compute(*arguments)

    monkeypatch.setattr(optimisation_job, "_document_of_scheme", later)
    gui.draw_until_idle()
    before = gui.session.view_settings
    gui.press_chord("F5")
    (job,) = gui.session.jobs.active
    gui.press_chord("Escape")
    may_go_on.set()
    assert gui.session.wait_until_idle(PATIENCE_S)
    gui.draw_until_idle()
    assert job.status == "cancelled" and gui.session.view_settings == before


def test_with_an_eye_the_panel_speaks_of_the_retina_and_plots_contrast_by_the_pupil(
    make_gui: Callable[..., Gui],
) -> None:
    gui = make_gui(small_bench(shape=[16, 24], eye={}), panels=(ImagePanel, SpecklePanel), size=(900, 1000))
    gui.context.show_panel("Speckle")
    gui.draw_until_idle()
    measurements = gui.context.live_measurement.measurements
    assert measurements is not None and measurements.retinal is not None
    gui.click(gui.item_position("contrast by the pupil"))
    assert gui.context.retinal_curves.job is not None
    assert gui.session.wait_until_idle(PATIENCE_S)
    gui.draw_frames(3)
    curve = gui.context.retinal_curves.curve
    assert curve is not None and len(curve.contrasts) == 6
    assert "contrast by the pupil" in gui.context.item_rects
    gui.session.change("Eye", {"eye": None})
    gui.draw_until_idle()
    measurements = gui.context.live_measurement.measurements
    assert measurements is not None and measurements.retinal is None


def test_escape_drops_the_tool_before_it_ends_a_comparison(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(panels=(ImagePanel, SpecklePanel, ViewPanel))
    gui.draw_until_idle()
    gui.press_chord("W")
    gui.press_chord("Shift+L")
    assert gui.context.drag_tool == "line"
    gui.press_chord("Escape")
    assert gui.context.drag_tool == "" and gui.session.view_settings.compare == "wipe"
    gui.press_chord("Escape")
    assert gui.session.view_settings.compare == "off"
