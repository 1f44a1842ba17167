"""The cursor, the sections through it, and the panel that says where its light comes from."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from holoview.light.engine.point_light import point_steps, section_steps
from holoview.light.model.system import System
from holoview.viewer.app.panels.image import ImagePanel
from holoview.viewer.app.panels.point import PointPanel, SectionsPanel
from holoview.viewer.document.focus_edits import focus_range_m
from holoview.viewer.render.point_probe import SECTION_PLANES
from tests.gui.conftest import Gui, small_bench

pytestmark = pytest.mark.gpu


@pytest.fixture
def gui(make_gui: Callable[..., Gui]) -> Gui:
    opened = make_gui(small_bench(), (700, 900), panels=(SectionsPanel, PointPanel, ImagePanel))
    opened.context.show_panel("Point")
    opened.draw_until_idle()
    opened.context.show_panel("Sections")
    opened.draw_until_idle()
    return opened


@pytest.mark.long
def test_ctrl_click_places_the_cursor_and_a_drag_moves_it(gui: Gui) -> None:
    gui.session.edit_view("Look", zoom=1.0)
    gui.draw_until_idle()
    gui.hold_keys(("Control",))
    gui.click(gui.item_position("image", 0.4, 0.5))
    gui.draw_until_idle()
    first = gui.session.view_settings.cursor
    assert first is not None
    gui.drag(gui.item_position("image", 0.4, 0.5), gui.item_position("image", 0.6, 0.5))
    gui.release_keys(("Control",))
    gui.draw_until_idle()
    cursor = gui.session.view_settings.cursor
    assert cursor is not None and cursor[0] > first[0] + 20 and abs(cursor[1] - first[1]) <= 1
    assert gui.session.view_settings.centre == (0.5, 0.5)  # the image wasn't moved


@pytest.mark.long
def test_a_click_in_a_section_moves_the_plane_and_the_cursor(gui: Gui) -> None:
    session = gui.session
    rows, columns = session.document.image_shape
    low_m, high_m = focus_range_m(session.system)
    gui.click(gui.item_position("section x-z", 0.25, 0.75))
    gui.draw_until_idle()
    item = gui.context.item_rects["section x-z"]
    step = (high_m - low_m) / (item[2] - item[0])  # of the plane, for a screen pixel
    assert session.view_settings.plane_m == pytest.approx(low_m + 0.25 * (high_m - low_m), abs=2 * step)
    assert session.view_settings.cursor == pytest.approx((0.75 * columns, rows // 2), abs=3)
    gui.click(gui.item_position("section y-z", 0.75, 0.25))
    gui.draw_until_idle()
    assert session.view_settings.cursor == pytest.approx((0.75 * columns, 0.25 * rows), abs=3)


@pytest.mark.long
def test_sections_and_point_follow_edits(gui: Gui) -> None:
    session, probe = gui.session, gui.context.point_probe
    session.change("Gap", {"gap": "3 mm"})
    session.edit_view("Cursor", cursor=(20, 10))
    gui.draw_until_idle()
    gui.context.show_panel("Point")
    gui.draw_until_idle()
    low_m, high_m = focus_range_m(session.system)
    planes_m = np.linspace(low_m, high_m, SECTION_PLANES)
    *_, sections = section_steps(session.system, session.drive, planes_m, (10, 20), range(3))
    seen = probe.sections
    assert seen is not None and seen.share == 1.0 and seen.place == (10, 20)
    shown = gui.context.device.download(seen.xz.buffer, np.float32, (*seen.xz.shape, 4))[..., :3]
    np.testing.assert_array_equal(shown, np.swapaxes(sections.xz, 0, 1))
    *_, light = point_steps(session.system, session.drive, session.view_settings.plane_m, (10, 20), range(3))
    assert probe.point is not None and probe.point.light.share == 1.0
    np.testing.assert_array_equal(probe.point.light.xyz, light.xyz)


def test_the_origin_of_the_light_of_a_chain_is_shown_by_its_modulators(make_gui: Callable[..., Gui]) -> None:
    pixels = {"pitch": 8e-6, "shape": (24, 32)}
    elements = (
        {"kind": "phase", "stroke": 7e-7, **pixels},
        {"kind": "space", "distance": 1e-3},
        {"kind": "mask", "pattern": "random", "stroke": 5e-7, **pixels},
        {"kind": "amplitude", **pixels},
        {"kind": "complex", **pixels},
    )
    system = System([532e-9], [[1.0]], elements=elements, planes_m=[5e-3])
    gui = make_gui(system, (700, 900), panels=(PointPanel, ImagePanel))
    gui.context.show_panel("Point")
    gui.draw_until_idle()
    point = gui.context.point_probe.point
    assert point is not None and point.light.share == 1.0
    drawn = [name for name in gui.context.item_rects if name.startswith("point areas")]
    assert drawn == ["point areas 1", "point areas 2", "point areas 3"]  # the mask shows no pattern


def test_the_window_of_the_local_spectrum_can_be_chosen(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(small_bench(), (700, 900), panels=(PointPanel, ImagePanel), engine=True)
    gui.context.show_panel("Point")
    gui.draw_until_idle()

    def choose(ctx: Any) -> None:
        ctx.set_ref("Point")
        ctx.combo_click("window/128 samples")

    gui.engine(choose)
    gui.draw_until_idle()
    point = gui.context.point_probe.point
    assert point is not None and point.light.window == 128 and point.directions.shape == (128, 128)
    assert point.frequency_at(0.5, 0.5) == (0.0, 0.0)
    assert point.frequency_at(0.0, 0.5)[1] == pytest.approx(-1 / (2 * 4e-6))
