"""The scores in the line below the image: PSNR, and the chosen one beside it."""

from __future__ import annotations

import sys
from threading import Event

import numpy as np
import pytest

from holoview.holograms.metrics.perceptual import flip, ms_ssim
from holoview.light.colour import xyz_to_linear_srgb
from holoview.viewer.app.readout import describe_image
from holoview.viewer.document.file_loader import target_from_pixels
from holoview.viewer.document.target_builder import _TargetRequest
from holoview.viewer.render.view_settings import NOW
from tests.gui.conftest import Gui
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.gpu


@pytest.fixture
def scored(gui: Gui) -> Gui:
    """A viewer of a hologram with a target."""
    gui.session.edit("Target", target_spec=target_from_pixels(np.full((64, 96, 3), 128, np.uint8)))
    gui.draw_until_idle()
    return gui


def _light(gui: Gui) -> tuple[np.ndarray, np.ndarray]:
    target = gui.session.target_at()
    assert target is not None, gui.last_message()
    return xyz_to_linear_srgb(gui.context.side_renderers.xyz(NOW)), target


def test_a_command_puts_a_score_beside_the_psnr(scored: Gui) -> None:
    assert describe_image(scored.context).endswith(" dB")
    scored.context.commands.run("Score: MS-SSIM")
    scored.draw_until_idle()
    assert describe_image(scored.context).endswith(f" dB   MS-SSIM {ms_ssim(*_light(scored)).mean:.3f}")
    scored.context.commands.run("Score: PSNR alone")
    assert describe_image(scored.context).endswith(" dB")


def test_the_line_says_that_the_target_is_still_being_built(gui: Gui, monkeypatch: pytest.MonkeyPatch) -> None:
    begin, build = Event(), _TargetRequest.build
    monkeypatch.setattr(_TargetRequest, "build", lambda request: begin.wait(PATIENCE_S) and build(request))
    gui.draw_until_idle()
    assert "PSNR" not in describe_image(gui.context)
    gui.session.edit("Target", target_spec=target_from_pixels(np.full((64, 96, 3), 128, np.uint8)))
    gui.draw_frames(3)
    assert describe_image(gui.context).endswith("   PSNR follows")
    begin.set()
    assert gui.session.wait_until_idle(PATIENCE_S)
    gui.draw_until_idle()
    assert describe_image(gui.context).endswith(" dB")


def test_the_visual_angle_follows_the_eyepiece(scored: Gui) -> None:
    scored.context.commands.run("Score: FLIP")
    for eyepiece, density in (("40 mm", 174.533), ("25 mm", 109.083)):  # π/180·f/(4 µm)
        scored.session.change("Eye", {"eye": {"eyepiece": eyepiece, "pupil": "3 mm"}})
        scored.draw_until_idle()
        assert describe_image(scored.context).endswith(f" FLIP {flip(*_light(scored), density).mean:.3f}")


def test_a_click_takes_the_next_score_that_is_installed(scored: Gui, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pycvvdp", None)
    seen = []
    for _ in range(3):
        scored.click(scored.item_position("scores"))
        seen.append(scored.session.view_settings.score)
    assert seen == ["ms_ssim", "flip", ""]


def test_a_score_that_is_not_installed_is_said_with_its_remedy(scored: Gui, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pycvvdp", None)
    scored.context.commands.run("Score: ColorVideoVDP")
    scored.draw_until_idle()
    assert "holoview[perceptual]" in scored.last_message()
    assert describe_image(scored.context).endswith(" dB")
