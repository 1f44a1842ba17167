"""The panel of sweeps: started by its button, points clicked on the curve or reached by the arrows beside it."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from holoview.evidence.sweep.in_viewer import sweep_document
from holoview.viewer.app.panels.image import ImagePanel
from holoview.viewer.app.panels.sweep import SweepPanel
from holoview.viewer.document.sweeper import SweepRequest
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
    gui.click(gui.item_position("curve of the sweep", 0.95, 0.5))  # right of all other points
    gui.draw_until_idle()
    assert gui.session.system.gap_m == pytest.approx(3e-3)
    gui.click(gui.item_position("point before"))
    gui.draw_until_idle()
    assert panel.chosen == 1 and gui.session.system.gap_m == pytest.approx(2e-3)
    gui.session.undo()
    assert gui.session.system.gap_m == before


def test_the_button_sweeps_what_the_bench_offers(gui: Gui) -> None:
    gui.click(gui.item_position("start the sweep"))
    assert gui.session.wait_until_idle()
    gui.draw_until_idle()
    assert gui.last_message() == ""
    gui.item_position("curve of the sweep")  # is drawn
