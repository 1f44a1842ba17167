"""Several holograms in one viewer: a film strip, digits that switch at once, the shown one named, which is edited."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import holoview as hv
from holoview.holograms.metrics.fidelity import psnr_linear_srgb
from holoview.light.colour import xyz_to_linear_srgb
from holoview.viewer.app.panels.holograms import name_of, open_sides
from holoview.viewer.app.readout import describe_image
from holoview.viewer.render.view_settings import NOW, ComparisonSide
from tests.gui.conftest import Gui, small_bench
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.gpu


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    """Three holograms of different gaps."""
    paths = [tmp_path / f"{name}.safetensors" for name in ("first", "second", "third")]
    for number, path in enumerate(paths):
        system = small_bench(gap=(2 + number) * 1e-3)
        hv.Hologram(hv.random_drive(system, seed=number), system).save(path)
    return paths


@pytest.fixture
def gui(make_gui: Callable[..., Gui], files: list[Path]) -> Gui:
    gui = make_gui(size=(1100, 700))
    gui.context.loader.open(files[:1])
    assert gui.session.wait_until_idle(PATIENCE_S)
    gui.draw_until_idle()
    gui.context.loader.open_beside(files[1:])
    assert gui.session.wait_until_idle(PATIENCE_S)
    gui.draw_frames(4)
    gui.draw_until_idle()
    return gui


def _seen(gui: Gui) -> np.ndarray:
    gui.draw_until_idle()
    gui.draw_frames(2)
    pixels = gui.context.displayed_pixels()
    assert pixels is not None
    return pixels


def test_digits_switch_between_the_holograms_that_are_open(gui: Gui) -> None:
    assert [name_of(gui.context, side) for side in open_sides(gui.context)] == [
        f"{name}.safetensors" for name in ("first", "second", "third")
    ]
    pictures = {}
    for digit in "123":
        gui.press_chord(digit)
        assert not gui.context.is_busy, "all pictures are there: nothing is computed"
        pictures[digit] = _seen(gui)
    assert len({picture.tobytes() for picture in pictures.values()}) == 3
    gui.press_chord("1")
    assert np.array_equal(_seen(gui), pictures["1"])
    gui.press_chord("9")
    assert gui.session.view_settings.shown == NOW, "there are three"
    assert gui.session.view_settings.solo is None and not gui.session.can_redo


def test_the_shown_picture_is_that_of_the_file(gui: Gui, files: list[Path]) -> None:
    gui.press_chord("3")
    gui.draw_until_idle()
    hologram = hv.load_hologram(files[2])
    plane_m = gui.session.view_settings.plane_m
    expected = hv.simulate(hologram.system, hologram.drive, planes=[plane_m]).xyz[0]
    shown = gui.context.side_renderers.xyz(gui.session.view_settings.shown)
    np.testing.assert_allclose(shown, expected, atol=2e-4 * expected.max())
    first = gui.context.side_renderers.xyz(NOW)
    known = psnr_linear_srgb(xyz_to_linear_srgb(shown), xyz_to_linear_srgb(first)).mean_db
    gui.draw_frames(2)
    gui.draw_until_idle()
    assert f"PSNR to 1 {known:.1f} dB" in describe_image(gui.context) and "third" in describe_image(gui.context)


def test_one_key_goes_back_and_forth(gui: Gui) -> None:
    for chord in ("2", "3", "Q"):
        gui.press_chord(chord)
    assert gui.session.view_settings.shown.name == "second.safetensors"
    gui.press_chord("Q")
    assert gui.session.view_settings.shown.name == "third.safetensors"


def test_a_click_shows_and_a_double_click_edits(gui: Gui) -> None:
    drive = gui.session.drive
    gui.click(gui.item_position("hologram 2", 0.5, 0.7))
    assert gui.session.view_settings.shown.name == "second.safetensors"
    assert gui.session.drive is drive, "panels still edit the first one"
    gui.process_frames(60)  # else it would be a double click
    gui.click(gui.item_position("edit the shown one"))
    gui.draw_until_idle()
    assert gui.session.view_settings.shown == NOW and gui.session.system.gap_m == pytest.approx(3e-3)
    assert gui.session.document.title == "second.safetensors"
    assert set(gui.session.snapshots) == {"first.safetensors", "second.safetensors", "third.safetensors"}
    gui.press_chord("Ctrl+Z")
    assert gui.session.drive is drive, "one step of undo"


def test_the_difference_has_a_number(gui: Gui) -> None:
    gui.press_chord("2")
    gui.press_chord("Shift+D")
    gui.draw_until_idle()
    gui.draw_frames(3)
    gui.draw_until_idle()
    view = gui.session.view_settings
    assert (view.compare, view.a, view.b.name) == ("difference", NOW, "second.safetensors")
    assert "PSNR of A to B" in describe_image(gui.context)
    gui.press_chord("Escape")
    assert gui.session.view_settings.compare == "off" and gui.session.view_settings.shown.name == "second.safetensors"


def test_a_step_of_the_plane_is_followed_by_the_shown_one(gui: Gui) -> None:
    gui.press_chord("2")
    before = _seen(gui)
    gui.press_chord("PageDown")
    after = _seen(gui)
    assert not np.array_equal(before, after)
    hologram = gui.session.snapshots["second.safetensors"]
    plane_m = gui.session.view_settings.plane_m
    expected = hv.simulate(hologram.system, hologram.drive, planes=[plane_m]).xyz[0]
    shown = gui.context.side_renderers.xyz(ComparisonSide("snapshot", "second.safetensors"))
    np.testing.assert_allclose(shown, expected, atol=2e-4 * expected.max())


def test_lasers_keep_the_digits_while_one_hologram_is_open(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(size=(1100, 700))
    gui.draw_until_idle()
    gui.press_chord("2")
    assert gui.session.view_settings.solo == 1
    gui.press_chord("2")
    gui.press_chord("P")
    gui.press_chord("2")
    view = gui.session.view_settings
    assert view.solo is None and view.shown.kind == "snapshot"
    gui.press_chord("Alt+2")
    assert gui.session.view_settings.solo == 1
    gui.session.unpin(view.shown.name)
    assert gui.session.view_settings.shown == NOW


def test_files_of_one_name_are_both_kept(gui: Gui, files: list[Path], tmp_path: Path) -> None:
    other = tmp_path / "elsewhere"
    other.mkdir()
    (other / "second.safetensors").write_bytes(files[0].read_bytes())
    gui.context.loader.open_beside(other / "second.safetensors")
    assert gui.session.wait_until_idle(PATIENCE_S)
    assert list(gui.session.snapshots) == ["second.safetensors", "third.safetensors", "second.safetensors (2)"]


def test_a_picture_cant_be_opened_beside(gui: Gui, tmp_path: Path) -> None:
    from PIL import Image

    Image.new("RGB", (8, 8)).save(tmp_path / "picture.png")
    gui.context.loader.open_beside(tmp_path / "picture.png")
    assert gui.session.wait_until_idle(PATIENCE_S)
    assert "picture.png" in gui.last_message() and "expected" in gui.last_message() and len(gui.session.snapshots) == 2


@pytest.mark.long
def test_a_moment_without_light_leaves_the_panels_alive(make_gui: Callable[..., Gui]) -> None:
    """As an optimisation makes one that switches the only laser shown off; `make_gui` tells of panels that failed."""
    gui = make_gui(size=(1100, 700))
    gui.draw_until_idle()
    gui.session.pin("kept")
    gui.session.edit_view("Look", solo=0, has_legend=True, has_scale_bar=True, shown=ComparisonSide("snapshot", "kept"))
    for panel in ("Regions", "Holograms"):
        gui.context.show_panel(panel)
        gui.draw_frames(3)
        gui.draw_until_idle()
    document = gui.session.document
    dark = document.system.edit({"amplitudes": [0.0, 1.0, 1.0]})
    gui.session.set_preview(document, dataclasses.replace(document, system=dark))
    for panel in ("Regions", "Holograms"):
        gui.context.show_panel(panel)
        gui.draw_frames(5)
    gui.session.set_preview(None)
    gui.draw_until_idle()


def test_what_a_double_click_edits_is_what_is_seen(gui: Gui) -> None:
    for _ in range(2):
        gui.click(gui.item_position("hologram 3", 0.5, 0.7))
    gui.draw_until_idle()
    assert gui.session.document.title == "third.safetensors" and gui.session.system.gap_m == pytest.approx(4e-3)
    assert gui.session.view_settings.shown == NOW, "else the image wouldn't follow what is edited"
