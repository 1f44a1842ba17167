"""Several holograms in one viewer: the first is edited, the others lie beside it, and a number tells the difference."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import holoview as hv
from holoview.holograms.metrics.fidelity import psnr_linear_srgb
from holoview.light.colour import xyz_to_linear_srgb
from holoview.light.model import preset
from holoview.viewer.app.readout import describe_image
from tests.gui.conftest import Gui, small_bench
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.gpu


@pytest.mark.long
def test_two_holograms_are_shown_side_by_side_with_their_difference(
    make_gui: Callable[..., Gui], tmp_path: Path
) -> None:
    system = small_bench()
    files = [tmp_path / "first.safetensors", tmp_path / "second.safetensors"]
    for seed, file in enumerate(files):
        hv.Hologram(hv.random_drive(system, seed=seed), system).save(file)
    gui = make_gui(size=(800, 480))
    gui.context.loader.open(files)
    assert gui.session.wait_until_idle(PATIENCE_S)
    gui.draw_until_idle()
    view = gui.session.view_settings
    assert view.compare == "side-by-side" and view.b.label == "second.safetensors"
    assert gui.session.document.path == files[0] and gui.app.window.title == "first.safetensors – holoview"
    gui.draw_frames(3)
    gui.draw_until_idle()
    seen = [hv.simulate(system, hv.random_drive(system, seed=seed), planes=[view.plane_m]).xyz[0] for seed in (0, 1)]
    a, b = (xyz_to_linear_srgb(xyz) for xyz in seen)
    expected = psnr_linear_srgb(a, b).mean_db
    assert f"PSNR of A to B {expected:.1f} dB" in _readout(gui)
    gui.press_chord("D")
    gui.draw_until_idle()
    assert gui.session.view_settings.compare == "difference" and f"{expected:.1f} dB" in _readout(gui)


def test_equal_holograms_are_said_to_be_equal(make_gui: Callable[..., Gui], tmp_path: Path) -> None:
    system, files = small_bench(), [tmp_path / "first.safetensors", tmp_path / "second.safetensors"]
    for file in files:
        hv.Hologram(hv.random_drive(system, seed=0), system).save(file)
    gui = make_gui(size=(800, 480))
    gui.context.loader.open(files)
    assert gui.session.wait_until_idle(PATIENCE_S)
    gui.draw_until_idle()
    gui.draw_frames(3)
    gui.draw_until_idle()
    assert "A and B are equal" in _readout(gui)
    gui.press_chord("Escape")
    gui.press_chord("2")
    gui.draw_until_idle()
    gui.draw_frames(3)
    gui.draw_until_idle()
    assert "equal to 1" in _readout(gui)


def test_benches_of_different_sizes_have_no_number(make_gui: Callable[..., Gui], tmp_path: Path) -> None:
    files = [tmp_path / "small.toml", tmp_path / "smaller.toml"]
    for file, shape in zip(files, ([64, 96], [32, 48]), strict=True):
        preset.save(small_bench(shape=shape), file)
    gui = make_gui(size=(800, 480))
    gui.context.loader.open(files)
    assert gui.session.wait_until_idle(PATIENCE_S)
    gui.draw_until_idle()
    gui.draw_frames(3)
    assert gui.session.view_settings.b.label == "smaller" and "PSNR of A" not in _readout(gui)


def _readout(gui: Gui) -> str:
    return describe_image(gui.context)
