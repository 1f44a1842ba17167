"""An animation that is opened: as a film, or its first picture."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from holoview.light.colour import srgb_decode
from holoview.viewer.document.optimisation_job import LiveOptimisationJob, running_optimisation
from tests.gui.conftest import Gui
from tests.patience import PATIENCE_S, wait_until

pytestmark = pytest.mark.gpu


@pytest.fixture
def film(tmp_path: Path) -> Path:
    """Three pictures of even greys, 96 × 64."""
    first, *others = (Image.fromarray(np.full((64, 96, 3), code, np.uint8)) for code in (60, 120, 180))
    first.save(tmp_path / "film.gif", save_all=True, append_images=others, duration=50)
    return tmp_path / "film.gif"


@pytest.fixture
def gui(make_gui: Callable[..., Gui], film: Path) -> Gui:
    gui = make_gui(size=(1100, 700), engine=True)
    gui.context.loader.open(film)
    assert gui.session.wait_until_idle(PATIENCE_S)
    gui.draw_until_idle()
    gui.draw_frames(3)
    return gui


@pytest.mark.long
def test_its_first_picture_is_the_target_at_once(gui: Gui) -> None:
    assert gui.context.loader.animation is not None and gui.context.loader.animation.pictures == 3
    assert gui.session.target_at() == pytest.approx(srgb_decode(60 / 255), abs=0.01)
    gui.context.loader.optimises_new_targets = True
    assert running_optimisation(gui.session) is None, "nothing is optimised before the answer"
    gui.engine(lambda ctx: ctx.item_click("Animation/Its first picture"))
    assert gui.context.loader.animation is None
    job = running_optimisation(gui.session)
    assert job is not None and not isinstance(job, LiveOptimisationJob)
    job.cancel()
    assert gui.session.wait_until_idle(PATIENCE_S)


def test_as_a_film_the_hologram_follows_its_pictures(gui: Gui) -> None:
    gui.engine(lambda ctx: ctx.item_click("Animation/As a film"))
    assert gui.context.loader.animation is None
    job = running_optimisation(gui.session)
    assert isinstance(job, LiveOptimisationJob)
    wait_until(lambda: job.latest is not None or not job.is_active, gui.session.poll)
    assert job.is_active, gui.last_message()
    job.cancel()
    assert gui.session.wait_until_idle(PATIENCE_S)


def test_another_file_ends_the_question(gui: Gui, tmp_path: Path) -> None:
    Image.new("RGB", (96, 64), (9, 9, 9)).save(tmp_path / "still.png")
    gui.context.loader.open(tmp_path / "still.png")
    assert gui.session.wait_until_idle(PATIENCE_S)
    assert gui.context.loader.animation is None
