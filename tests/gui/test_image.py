"""The image: what is seen of it, zoom and pan about the pointer, the values under it, two sides of a comparison."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import holoview as hv
from holoview.light.colour import srgb_encode, xyz_to_linear_srgb
from holoview.viewer.app.panels.image import ImagePanel
from holoview.viewer.app.readout import describe_pixel
from holoview.viewer.document.file_loader import target_from_pixels
from holoview.viewer.render.tone_mapping import colour_map, compose_comparison, tone_map
from holoview.viewer.render.view_settings import NOW, ComparisonSide, ViewSettings
from tests.gui.conftest import Gui, small_bench
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.gpu

ONE_TO_ONE = {"zoom": 1.0, "centre": (0.5, 0.5)}
LEVEL = 1  # of 255: powers in f32 beside float64


def _shown(gui: Gui) -> tuple[np.ndarray, tuple[int, int]]:
    """The panel's pixels of the image, and its corner in them."""
    frame = gui.app.panel(ImagePanel).picture.visible_area
    left, top = (round(value) for value in frame.to_pixel(0.0, 0.0))
    rows, columns = gui.session.document.image_shape
    return gui.context.displayed_pixels()[top : top + rows, left : left + columns], (left, top)


LOOKS: tuple[dict[str, Any], ...] = (
    {},
    {"exposure_stops": -1.5, "gamma": 1.3},
    {"low": 0.1, "high": 0.7},
    {"channel": "luminance"},
    {"channel": "M", "false_colour": "cubehelix"},
    {"channel": "X", "false_colour": "hue", "exposure_stops": 0.5},
    {"solo": 1},
    {"exposure_stops": 2.0},
    {"exposure_stops": 2.0, "keeps_hue": False},
)


def test_one_to_one_the_panel_shows_what_the_reference_makes_of_xyz(gui: Gui) -> None:
    plain = gui.session.view_settings
    for look in LOOKS:
        gui.session.edit("Look", view_settings=plain.with_(**ONE_TO_ONE, **look))
        gui.draw_until_idle()
        seen, _ = _shown(gui)
        expected = tone_map(gui.context.side_renderers.xyz(NOW), gui.session.view_settings)
        assert seen.shape == expected.shape
        table = colour_map(look.get("false_colour") or "grey").astype(int)
        step = LEVEL * np.abs(np.diff(table, axis=0)).max()
        assert np.abs(seen.astype(int) - expected).max() <= step, look


def test_smaller_than_one_to_one_a_pixel_is_the_mean_light_of_what_it_covers(gui: Gui) -> None:
    gui.session.edit_view("Look", zoom=0.5, centre=(0.5, 0.5))
    gui.draw_until_idle()
    frame = gui.app.panel(ImagePanel).picture.visible_area
    left, top = (round(value) for value in frame.to_pixel(0.0, 0.0))
    rows, columns = (side // 2 for side in gui.session.document.image_shape)
    xyz = gui.context.side_renderers.xyz(NOW)
    means = xyz.reshape(rows, 2, columns, 2, 3).mean(axis=(1, 3))
    seen = gui.context.displayed_pixels()[top : top + rows, left : left + columns]
    assert np.abs(seen.astype(int) - tone_map(means, gui.session.view_settings)).max() <= LEVEL


def test_the_wheel_zooms_about_the_pointer(gui: Gui) -> None:
    panel, at = gui.app.panel(ImagePanel), gui.item_position("image", 0.3, 0.6)
    corner = gui.item_position("image", 0, 0)
    before = panel.picture.visible_area.to_image(at[0] - corner[0], at[1] - corner[1])
    a_pixel = max(panel.picture.visible_area.step)  # corners of the image are on whole pixels
    gui.wheel(at, 3)
    assert gui.session.view_settings.zoom > 1.5
    after = panel.picture.visible_area.to_image(at[0] - corner[0], at[1] - corner[1])
    assert after == pytest.approx(before, abs=a_pixel)
    gui.press_chord("F")
    assert gui.session.view_settings.zoom == 0


def test_dragging_pans_and_is_no_step_of_undo(gui: Gui) -> None:
    steps = len(gui.session.history)
    gui.wheel(gui.item_position("image"), 4)
    before, zoom = gui.session.view_settings.centre, gui.session.view_settings.zoom
    gui.drag(gui.item_position("image", 0.5, 0.5), gui.item_position("image", 0.4, 0.5))
    left, _, right, _ = gui.context.item_rects["image"]
    moved = 0.1 * (right - left) / zoom / gui.session.document.image_shape[1]
    assert gui.session.view_settings.centre[0] - before[0] == pytest.approx(moved, rel=0.15)  # whole pixels
    assert len(gui.session.history) == steps


def test_ctrl_and_the_wheel_change_the_focal_plane(gui: Gui) -> None:
    before = gui.session.view_settings.plane_m
    gui.wheel(gui.item_position("image"), 2, "Control")
    assert gui.session.view_settings.plane_m > before
    assert gui.session.view_settings.zoom == 0


def test_shift_and_drag_draw_a_region(gui: Gui) -> None:
    gui.hold_keys(("Shift",))
    gui.drag(gui.item_position("image", 0.4, 0.4), gui.item_position("image", 0.6, 0.6))
    gui.release_keys(("Shift",))
    x, y, width, height = gui.session.view_settings.region
    rows, columns = gui.session.document.image_shape
    assert 0 < x < columns / 2 < x + width < columns
    assert 0 < y < rows / 2 < y + height < rows
    assert gui.context.drag_tool == ""


def test_the_values_under_the_pointer_are_those_of_the_image(gui: Gui) -> None:
    gui.move(gui.item_position("image", 0.5, 0.5))
    gui.draw_frames(2)
    rows, columns = gui.session.document.image_shape
    line = describe_pixel(gui.context, columns // 2, rows // 2)
    x, y, z = gui.context.side_renderers.xyz(NOW)[rows // 2, columns // 2]
    assert f"XYZ {x:.3f}  {y:.3f}  {z:.3f}" in line
    intensity = gui.context.side_renderers.now.intensities()[:, rows // 2, columns // 2]
    assert intensity.shape == (3,) and np.all(intensity > 0)


def test_lasers_are_summed_over_their_lines(make_gui: Callable[..., Gui]) -> None:
    effects = {"second_line": {"share": 0.3, "offset": "6 nm"}, "wavelength_offset": {"offset": "5 nm"}}
    gui = make_gui(small_bench(effects=effects), (700, 900), panels=(ImagePanel,))
    gui.draw_until_idle()
    now, xyz = gui.context.side_renderers.now, gui.context.side_renderers.xyz(NOW)
    intensities, luminances = now.intensities(), now.luminances()
    assert xyz is not None and intensities is not None and luminances is not None
    view = hv.simulate(gui.session.system, gui.session.drive, [gui.session.view_settings.plane_m], backend="torch64")
    by_laser = view.intensity[0].reshape(3, 2, *xyz.shape[:2]).sum(axis=1)
    # float32: as for whole frames (tests/parity)
    assert np.linalg.norm(intensities - by_laser) <= 2e-6 * np.linalg.norm(by_laser)
    assert np.linalg.norm(luminances.sum(axis=0) - xyz[..., 1]) <= 2e-6 * np.linalg.norm(xyz[..., 1])


# --- comparison -----------------------------------------------------------------------------------------------------


@pytest.fixture
def pinned(gui: Gui) -> Gui:
    """A viewer in which A is now and B a snapshot of another plane."""
    name = gui.session.pin()
    gui.session.change("Gap", {"gap": "4 mm"})
    gui.session.edit_view("Look", b=ComparisonSide("snapshot", name), **ONE_TO_ONE)
    gui.draw_until_idle()
    return gui


def _both(gui: Gui) -> tuple[np.ndarray, np.ndarray]:
    look: ViewSettings = gui.session.view_settings
    a, b = gui.context.side_renderers.xyz(look.a), gui.context.side_renderers.xyz(look.b)
    assert np.abs(a - b).mean() > 0.01
    return tone_map(a, look).astype(int), tone_map(b, look).astype(int)


def test_wipe_shows_a_left_of_the_line_and_b_right_of_it(pinned: Gui) -> None:
    pinned.session.edit_view("Wipe", compare="wipe", wipe=0.5)
    pinned.draw_until_idle()
    seen, (left, _) = _shown(pinned)
    a, b = _both(pinned)
    middle = round(pinned.app.panel(ImagePanel).picture.visible_area.size[0] / 2) - left
    assert np.abs(seen[:, : middle - 2] - a[:, : middle - 2]).max() <= LEVEL
    assert np.abs(seen[:, middle + 2 :] - b[:, middle + 2 :]).max() <= LEVEL


def test_the_wipe_follows_the_hand(pinned: Gui) -> None:
    pinned.session.edit_view("Wipe", compare="wipe", wipe=0.5)
    pinned.draw_until_idle()
    pinned.drag(pinned.item_position("image", 0.5, 0.5), pinned.item_position("image", 0.25, 0.5))
    assert pinned.session.view_settings.wipe == pytest.approx(0.25, abs=0.02)


def test_b_is_shown_while_its_key_is_held(pinned: Gui) -> None:
    pinned.session.edit_view("Hold", compare="hold")
    pinned.draw_until_idle()
    a, b = _both(pinned)
    assert np.abs(_shown(pinned)[0] - a).max() <= LEVEL
    pinned.hold_keys(("b",))
    pinned.draw_frames(2)
    assert np.abs(_shown(pinned)[0] - b).max() <= LEVEL
    pinned.release_keys(("b",))
    assert np.abs(_shown(pinned)[0] - a).max() <= LEVEL


def test_a_difference_acts_on_exposed_channels(pinned: Gui) -> None:
    pinned.session.edit_view("Difference", compare="difference", exposure_stops=-2.0)
    pinned.draw_until_idle()
    look = pinned.session.view_settings
    a, b = pinned.context.side_renderers.xyz(look.a), pinned.context.side_renderers.xyz(look.b)
    difference = np.abs(xyz_to_linear_srgb(a - b)) * 2.0**look.exposure_stops
    expected = np.rint(255 * srgb_encode(np.clip(difference, 0, 1)))
    assert np.abs(_shown(pinned)[0] - expected).max() <= LEVEL
    assert np.abs(compose_comparison(a, b, look) - expected).max() <= LEVEL, "and so it is saved"


def test_side_by_side_shows_the_same_part_of_both(pinned: Gui) -> None:
    pinned.session.edit_view("Sides", compare="side-by-side", zoom=0.5)
    pinned.draw_until_idle()
    frame, seen = pinned.app.panel(ImagePanel).picture.visible_area, pinned.context.displayed_pixels().astype(int)
    left, top = (round(value) for value in frame.to_pixel(0.0, 0.0))
    rows, columns = (side // 2 for side in pinned.session.document.image_shape)
    half = frame.size[0] // 2
    a, b = (
        tone_map(
            pinned.context.side_renderers.xyz(side).reshape(rows, 2, columns, 2, 3).mean(axis=(1, 3)),
            pinned.session.view_settings,
        )
        for side in (pinned.session.view_settings.a, pinned.session.view_settings.b)
    )
    assert np.abs(seen[top : top + rows, left : left + columns] - a).max() <= LEVEL
    assert np.abs(seen[top : top + rows, half + left + 1 : half + left + columns] - b[:, 1:]).max() <= LEVEL


def test_another_preset_can_be_a_side(gui: Gui) -> None:
    gui.session.edit_view("Preset", b=ComparisonSide("preset", "simultaneous"), compare="wipe", **ONE_TO_ONE)
    gui.draw_until_idle()
    a, b = _both(gui)
    assert a.shape == b.shape


# --- other pages ----------------------------------------------------------------------------------------------------


def _paged(gui: Gui, page: str) -> np.ndarray:
    gui.session.edit_view("Page", page=page, **ONE_TO_ONE)
    gui.draw_until_idle()
    return _shown(gui)[0]


def test_the_phase_page_shows_a_pattern_as_turns_of_hue(gui: Gui) -> None:
    seen = _paged(gui, "phase")[:64, :96]
    system, drive = gui.session.system, gui.session.drive
    waves = system.modulators[0].stroke_m / np.sort(system.wavelengths_m)[1]
    gui.session.edit_view("Look", zoom=1.0)
    turns = (drive[0, 0] * waves) % 1.0
    expected = colour_map("hue")[np.rint(255 * turns).astype(int)].astype(int)
    frame = gui.app.panel(ImagePanel).picture.visible_area
    left, top = (round(value) for value in frame.to_pixel(0.0, 0.0))
    seen = gui.context.displayed_pixels()[top : top + 64, left : left + 96].astype(int)
    assert np.median(np.abs(seen - expected)) <= LEVEL


def test_the_spectrum_page_shows_where_light_leaves_to(gui: Gui) -> None:
    gui.session.change("Iris", {"relay2.iris_na": 0.01})
    gui.session.edit_view("Page", page="spectrum")
    gui.draw_until_idle()
    seen = gui.context.displayed_pixels()
    rows, columns = seen.shape[:2]
    centre = seen[rows // 2 - 5 : rows // 2 + 5, columns // 2 - 5 : columns // 2 + 5]
    left, top = (round(value) for value in gui.app.panel(ImagePanel).picture.visible_area.to_pixel(0.0, 0.0))
    corner = seen[top + 2 : top + 12, left + 2 : left + 12]
    assert centre.mean() > 60 and corner.mean() < 5, "the iris is open in the middle"


def test_the_target_page_shows_what_is_wanted(gui: Gui) -> None:
    red = np.zeros((64, 96, 3), np.uint8)
    red[..., 0] = 200
    gui.session.edit("Target", target_spec=target_from_pixels(red))
    assert gui.session.wait_until_idle(PATIENCE_S)
    seen = _paged(gui, "target")
    assert np.median(seen.reshape(-1, 3), axis=0) == pytest.approx([200, 0, 0], abs=LEVEL)
    line = describe_pixel(gui.context, 96, 64)
    assert line.startswith("x 96  y 64   RGB 0.5") and " I " not in line, line


def test_the_contact_sheet_has_every_plane_and_a_click_goes_to_one(gui: Gui) -> None:
    gui.press_chord("G")
    gui.draw_until_idle()
    x0, y0, x1, y1 = (round(value) for value in gui.context.item_rects["sheet 9 mm"])
    assert gui.draw_frames(2)[y0 + 20 : y1, x0:x1].std() > 20
    assert {f"sheet {z} mm" for z in ("9", "9.5", "10", "10.5", "11")} <= set(gui.context.item_rects)
    gui.click(gui.item_position("sheet 10.5 mm"))
    assert gui.session.view_settings.plane_m == pytest.approx(10.5e-3) and gui.session.view_settings.page == "image"
