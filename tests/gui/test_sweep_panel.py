"""The panel of sweeps: started by its button, points clicked on the curve or reached by the arrows beside it."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from imgui_bundle import imgui

from holoview.evidence.sweep.in_viewer import sweep_document
from holoview.util.progress import ProgressCallback
from holoview.viewer.app.panels.image import ImagePanel
from holoview.viewer.app.panels.sweep import SweepPanel
from holoview.viewer.document.document import Document
from holoview.viewer.document.file_loader import target_from_pixels
from holoview.viewer.document.sweeper import SweepRequest, SweptCurve, SweptPoint
from holoview.viewer.render.view_settings import NOW, ComparisonSide
from tests.gui.conftest import Gui, small_bench

pytestmark = pytest.mark.gpu


@pytest.fixture
def gui(make_gui: Callable[..., Gui]) -> Gui:
    opened = make_gui(small_bench(), (1100, 700), panels=(ImagePanel, SweepPanel))
    opened.session.sweeper = sweep_document
    opened.context.commands.run("Sweep a parameter")
    opened.draw_until_idle()
    return opened


def test_a_click_on_a_point_shows_it_and_the_arrows_go_on(gui: Gui) -> None:
    panel = gui.app.panel(SweepPanel)
    panel.start(gui.context, SweepRequest("gap=1mm,2mm,3mm", "light"))
    assert gui.session.wait_until_idle()
    gui.draw_until_idle()
    before = gui.session.system.gap_m
    gui.session.edit_view("Shown", shown=ComparisonSide("snapshot", gui.session.pin()))
    gui.click(gui.item_position("curve of the sweep", 0.95, 0.5))  # right of all other points
    gui.draw_until_idle()
    assert gui.session.system.gap_m == pytest.approx(3e-3)
    assert gui.session.view_settings.shown == NOW, "not the hologram that was looked at before"
    gui.click(gui.item_position("point before"))
    gui.draw_until_idle()
    assert panel.chosen == 1 and gui.session.system.gap_m == pytest.approx(2e-3)
    gui.session.undo()
    assert gui.session.system.gap_m == before


def test_points_that_are_withheld_leave_the_others_and_say_so(gui: Gui, monkeypatch: pytest.MonkeyPatch) -> None:
    def sweep(document: Document, request: SweepRequest, report: ProgressCallback, show: Callable[..., None]) -> None:
        found = [(1.0, 0.4), (2.0, math.nan), (3.0, 0.6)]
        bench = document.system
        points = [SweptPoint(f"gap = {x:g} mm", x, y, 0.1 * y, bench.with_(gap=f"{x} mm"), None) for x, y in found]
        show(SweptCurve("gap (mm)", tuple(points)))

    texts: list[str] = []
    monkeypatch.setattr(imgui, "text_wrapped", texts.append)
    panel, gui.session.sweeper = gui.app.panel(SweepPanel), sweep
    panel.start(gui.context, SweepRequest("gap=1mm,2mm,3mm", "contrast"))
    assert gui.session.wait_until_idle()
    for across, expected, says in ((0.3, 0, "0.4 ± 0.04"), (0.6, 1, "withheld"), (0.95, 2, "0.6 ± 0.06")):
        gui.draw_until_idle()
        gui.click(gui.item_position("curve of the sweep", across, 0.5))
        texts.clear()
        gui.draw_until_idle()
        assert panel.chosen == expected
        assert f"gap = {expected + 1} mm: {says}" in texts
    assert any(text.startswith("1 of 3 points: withheld") for text in texts)


def test_the_button_sweeps_what_the_bench_offers(gui: Gui) -> None:
    gui.click(gui.item_position("start the sweep"))
    assert gui.session.wait_until_idle()
    gui.draw_until_idle()
    assert gui.last_message() == ""
    gui.item_position("curve of the sweep")  # is drawn


def test_the_first_measure_is_one_that_is_known_everywhere(gui: Gui) -> None:
    """Beside a target the PSNR, as its contrast is withheld where the target isn't shown; else the contrast."""
    asked: list[SweepRequest] = []
    panel = gui.app.panel(SweepPanel)
    for spec, measure in ((None, "contrast"), (target_from_pixels(np.full((64, 96, 3), 90, np.uint8)), "psnr")):
        panel._measure = ""
        gui.session.edit("Target", target_spec=spec)
        gui.draw_until_idle()
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(panel, "start", lambda context, request: asked.append(request))
            gui.click(gui.item_position("start the sweep"))
        assert asked[-1].measure == measure
