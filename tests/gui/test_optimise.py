"""Optimising from the panel: started, followed, paused, kept, cancelled, undone."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from holoview.app.panels.image import ImagePanel
from holoview.app.panels.optimise import OptimisePanel
from holoview.session.file_reader import target_from_pixels
from holoview.session.optimisation_job import last_optimisation, running_optimisation
from tests.gui.conftest import Gui

pytestmark = pytest.mark.gpu


@pytest.fixture
def gui(make_gui: Callable[..., Gui]) -> Gui:
    opened = make_gui(size=(800, 480), engine=True, panels=(ImagePanel, OptimisePanel))
    pixels = np.full((64, 96, 3), 90, np.uint8)
    pixels[16:48, 24:72] = 230
    opened.session.edit("Target", target_spec=target_from_pixels(pixels, "square"))
    opened.draw_until_idle()
    return opened


def _until(gui: Gui, condition: Callable[[], bool], timeout_s: float = 60.0) -> None:
    until = time.monotonic() + timeout_s
    while not condition():
        gui.draw_frames()
        gui.app.compute_slice()
        assert time.monotonic() < until, "waited too long"


def test_optimise_is_followed_kept_and_taken_back(gui: Gui) -> None:
    old = gui.session.drive
    gui.app.panel(OptimisePanel).iterations = 5000
    gui.engine(lambda ctx: ctx.item_click("Optimise/Optimise##start"))
    job = running_optimisation(gui.session)
    assert job is not None
    _until(gui, lambda: job.latest is not None and gui.session.displayed_document.drive is not old)
    assert gui.session.drive is old, "the document changes only at the end"
    gui.engine(lambda ctx: ctx.item_click("Optimise/Pause"))
    assert job.status == "paused"
    gui.engine(lambda ctx: ctx.item_click("Optimise/Keep"))
    _until(gui, lambda: not job.is_active)
    assert job.status == "done" and gui.session.drive is not old
    gui.press_chord("Ctrl+Z")
    assert gui.session.drive is old


def test_cancel_leaves_the_old_patterns(gui: Gui) -> None:
    old = gui.session.drive
    gui.app.panel(OptimisePanel).iterations = 5000
    gui.press_chord("Ctrl+Enter")
    job = running_optimisation(gui.session)
    assert job is not None
    _until(gui, lambda: job.latest is not None)
    gui.engine(lambda ctx: ctx.item_click("Optimise/Cancel"))
    _until(gui, lambda: not job.is_active)
    assert job.status == "cancelled" and gui.session.drive is old


def test_what_is_chosen_is_what_is_done(gui: Gui) -> None:
    panel = gui.app.panel(OptimisePanel)

    def choose(ctx: Any) -> None:
        ctx.set_ref("Optimise")
        ctx.combo_click("scheme/holochrome-8")
        ctx.combo_click("begin/smooth")
        ctx.item_input_value("iterations", 2)

    gui.engine(choose)
    plan = panel.request()
    assert (plan.scheme, plan.start_patterns, plan.settings.iterations) == ("holochrome-8", "smooth", 2)
    gui.press_chord("Ctrl+Enter")
    _until(gui, lambda: last_optimisation(gui.session) is not None and running_optimisation(gui.session) is None)
    assert len(gui.session.system.wavelengths_m) == 8 and "2 iterations" in gui.session.document.origin


def test_brightness_of_the_target_is_one_step_of_undo(gui: Gui) -> None:
    gui.engine(lambda ctx: ctx.item_input_value("Optimise/brightness", 0.5))
    assert gui.session.target_spec.brightness == pytest.approx(0.5)
    gui.press_chord("Ctrl+Z")
    assert gui.session.target_spec.brightness == 1.0
