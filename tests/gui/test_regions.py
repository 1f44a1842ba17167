"""Several regions in the window: drawn, chosen, named and typed; lines; images beside each other; copied and saved."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from holoview.viewer.app.panels.image import ImagePanel
from holoview.viewer.app.panels.regions import RegionsPanel
from holoview.viewer.app.panels.speckle import SpecklePanel
from holoview.viewer.document.measurements import measure_region
from holoview.viewer.document.region_table import HEADINGS
from holoview.viewer.render.view_settings import NOW, ComparisonSide
from tests.gui.conftest import Gui

pytestmark = pytest.mark.gpu
_KEPT = ComparisonSide("snapshot", "kept")


@pytest.fixture
def gui(make_gui: Callable[..., Gui]) -> Gui:
    opened = make_gui(size=(1100, 700))
    opened.draw_until_idle()
    return opened


def _draw(gui: Gui, start: tuple[float, float], end: tuple[float, float], tool: str = "Shift+R") -> None:
    gui.press_chord(tool)
    gui.drag(gui.item_position("image", *start), gui.item_position("image", *end))
    gui.draw_until_idle()


def _draw_two(gui: Gui) -> None:
    _draw(gui, (0.2, 0.4), (0.4, 0.6))
    _draw(gui, (0.6, 0.4), (0.7, 0.5))
    gui.draw_frames(4)
    gui.draw_until_idle()


def _type_into(gui: Gui, item: str, text: str) -> None:
    gui.click(gui.item_position(item, 0.3))
    gui.press_chord("Ctrl+A")
    gui.type_text(text)
    gui.press_chord("Enter")
    gui.draw_until_idle()


def test_two_regions_are_drawn_and_the_table_opens(gui: Gui) -> None:
    _draw_two(gui)
    regions = gui.session.view_settings.regions
    assert [of.name for of in regions] == ["A", "B"] and gui.session.view_settings.region_name == "B"
    assert "table of regions" in gui.context.item_rects
    rows = gui.context.live_measurement.measurements.rows
    xyz = gui.context.side_renderers.xyz(NOW)
    assert [row.metrics.contrast for row in rows] == [measure_region(xyz, of.region).contrast for of in regions]
    gui.press_chord("Alt+Z")
    assert [of.name for of in gui.session.view_settings.regions] == ["A"], "each is a step of the look"
    assert not gui.session.can_undo


def test_a_click_into_a_region_chooses_it_and_delete_forgets_it(gui: Gui) -> None:
    _draw_two(gui)
    a = gui.session.view_settings.regions[0].region
    middle = gui.app.panel(ImagePanel).picture.to_screen(a[0] + a[2] / 2, a[1] + a[3] / 2)
    gui.click((middle.x, middle.y))
    gui.draw_until_idle()
    assert gui.session.view_settings.region == a
    measurements = gui.context.live_measurement.measurements
    assert measurements.region is measurements.rows[0].metrics, "histogram and curve are those of the chosen one"
    gui.press_chord("Delete")
    assert [of.name for of in gui.session.view_settings.regions] == ["B"]


def test_names_and_numbers_are_typed(gui: Gui) -> None:
    _draw_two(gui)
    _type_into(gui, "name of region A", "sky")
    assert {of.name for of in gui.session.view_settings.regions} == {"B", "sky"}
    _type_into(gui, "name of region sky", "B")
    assert {of.name for of in gui.session.view_settings.regions} == {"B", "sky"}
    assert "isn't taken" in gui.last_message()
    left, top, _, bottom = gui.context.item_rects["place of region B"]
    gui.click((left + 20, (top + bottom) / 2))
    gui.press_chord("Ctrl+A")
    gui.type_text("7")
    gui.press_chord("Enter")
    gui.draw_until_idle()
    assert gui.session.view_settings.region_name == "B" and gui.session.view_settings.region[0] == 7


@pytest.mark.long
def test_what_was_typed_is_kept_as_the_field_is_left_and_dropped_by_escape(gui: Gui) -> None:
    """While it is typed, the figures of the table are computed anew."""
    _draw_two(gui)
    for leave, name in ((lambda: gui.press_chord("Escape"), "A"), (lambda: gui.click((320, 100)), "sky")):
        gui.click(gui.item_position("name of region A"))
        gui.press_chord("Ctrl+A")
        gui.type_text("sky")
        gui.session.edit_view("Plane", plane_m=gui.session.document.view_settings.plane_m * 1.01)
        gui.draw_until_idle()
        leave()
        gui.draw_frames(2)
        assert {of.name for of in gui.session.view_settings.regions} == {"B", name}


def test_the_table_is_copied_and_saved(gui: Gui, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _draw_two(gui)
    copied: list[str] = []
    monkeypatch.setattr("holoview.viewer.app.panels.regions.imgui.set_clipboard_text", copied.append)
    gui.click(gui.item_position("regions: copy"))
    assert len(copied) == 1 and len(copied[0].splitlines()) == 3
    gui.click(gui.item_position("regions: save"))
    gui.draw_frames(6)
    gui.press_chord("Ctrl+A")
    gui.type_text(str(tmp_path / "table.csv"))
    gui.press_chord("Enter")
    gui.draw_frames(4)
    with (tmp_path / "table.csv").open(newline="") as file:
        lines = list(csv.DictReader(file))
    assert [line["region"] for line in lines] == ["A", "B"] and tuple(lines[0]) == HEADINGS
    assert "regions written" in gui.last_message()


def test_regions_and_lines_are_linked_between_images(gui: Gui) -> None:
    """A region is drawn in the right image, and is that of both; a drag that leaves its image ends at its edge."""
    gui.session.pin("kept")
    gui.session.change("Gap", {"gap": 3e-3})
    gui.session.edit_view("Side by side", compare="side-by-side", b=_KEPT)
    gui.draw_until_idle()
    _draw(gui, (0.6, 0.45), (0.7, 0.55))
    _draw(gui, (0.8, 0.45), (0.99, 0.55))
    _, columns = gui.session.document.image_shape
    a, b = (of.region for of in gui.session.view_settings.regions)
    assert abs(a[0] - 0.2 * columns) <= 2 and abs(a[2] - 0.2 * columns) <= 3, "fractions of half the panel's width"
    assert b[0] + b[2] <= columns
    _draw(gui, (0.55, 0.5), (0.2, 0.5), "Shift+L")
    assert gui.session.view_settings.profile[2] == 0, "the left edge of the right image"
    gui.context.show_panel("Regions")
    gui.draw_frames(4)
    gui.draw_until_idle()
    figures = gui.context.live_measurement.measurements
    assert [(row.image, row.name) for row in figures.rows] == [
        (name, of) for name in (gui.session.document.title, "kept") for of in "AB"
    ]
    kept = gui.context.side_renderers.xyz(_KEPT)
    assert figures.rows[2].metrics.contrast == measure_region(kept, a).contrast
    assert [profile.image for profile in figures.profiles] == [gui.session.document.title, "kept"]
    assert figures.profiles[1].values.shape[1] == 4


def test_marks_are_drawn_in_both_images(gui: Gui) -> None:
    gui.session.pin("kept")
    dark = {"exposure_stops": -30.0}
    gui.session.edit_view("Side by side", compare="side-by-side", b=_KEPT, region=(20, 30, 60, 40), **dark)
    gui.draw_until_idle()
    pixels = gui.draw_frames(3).astype(int)
    left, top, right, bottom = (round(edge) for edge in gui.context.item_rects["image"])
    is_yellow = (pixels[..., 0] > 200) & (pixels[..., 1] > 170) & (pixels[..., 2] < 140)
    middle = (left + right) // 2
    halves = [is_yellow[top:bottom, left:middle].sum(), is_yellow[top:bottom, middle:right].sum()]
    assert halves[0] > 100 and abs(halves[0] - halves[1]) < 0.1 * halves[0]


def test_a_scale_bar_and_a_legend_are_seen_and_saved(gui: Gui, tmp_path: Path) -> None:
    gui.context.show_panel("Regions")
    gui.draw_frames(4)
    plain = gui.draw_until_idle().astype(int)
    for box in ("scale bar", "legend"):
        gui.click(gui.item_position(box, 0.2))
    gui.draw_until_idle()
    assert gui.session.view_settings.has_scale_bar and gui.session.view_settings.has_legend
    left, top, right, bottom = (round(edge) for edge in gui.context.item_rects["image"])
    changed = np.any(np.abs(gui.draw_frames(3).astype(int) - plain) > 8, axis=2)[top:bottom, left:right]
    assert changed[-90:, :200].sum() > 500 and not changed[:-120].any(), "at the lower left, and nowhere else"
    gui.press_chord("Ctrl+E")
    gui.draw_frames(6)
    gui.press_chord("Ctrl+A")
    gui.type_text(str(tmp_path / "view.png"))
    gui.press_chord("Enter")
    gui.draw_frames(4)
    rows, columns = gui.session.document.image_shape
    with Image.open(tmp_path / "view.png") as saved:
        assert saved.size[0] >= columns and saved.size[1] > rows, "below the picture"


def test_alt_drags_ten_times_finer_and_arrow_keys_step(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(size=(1100, 700))
    gui.context.show_panel("View")
    gui.draw_until_idle()
    left, top, right, bottom = gui.context.item_rects["exposure"]
    y, middle = (top + bottom) / 2, (left + right) / 2

    def stops() -> float:
        return gui.session.view_settings.exposure_stops

    gui.session.edit_view("Exposure", exposure_stops=1.0)
    gui.draw_frames(2)
    gui.hold_keys(("Alt",))
    gui.drag((middle - 60, y), (middle - 20, y))
    gui.release_keys(("Alt",))
    assert stops() - 1.0 == pytest.approx(0.1 * 16 * 40 / (right - left), rel=0.7), "a plain drag of 40 px goes ten"
    gui.move((middle, y))
    gui.draw_frames(3)
    before = stops()
    gui.press_chord("Up")
    assert stops() == pytest.approx(before + 16 / 200)
    gui.press_chord("Shift+Down")
    assert stops() == pytest.approx(before + 16 / 200 - 16 / 20)
    gui.press_chord("Alt+Up")
    assert stops() == pytest.approx(before + 16 / 200 - 16 / 20 + 16 / 2000)


def test_panels_alone_draw_the_profile(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(size=(900, 1200), panels=(ImagePanel, SpecklePanel, RegionsPanel))
    gui.context.show_panel("Regions")
    gui.session.edit_view("Line", profile=(2.0, 2.0, 40.0, 20.0))
    gui.draw_until_idle()
    _type_into(gui, "line", "5")
    assert 5.0 in gui.session.view_settings.profile
    assert not any(guarded.failure for guarded in gui.app.panels)
