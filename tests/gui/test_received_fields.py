"""Fields that other programs send are shown in the viewer, and what the user has set stays."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
import torch

import holoview as hv
from holoview.holograms.fields.exchange import announced_listener, push
from holoview.light.colour import fitting_stops
from holoview.util.errors import UserError
from holoview.viewer.app.panels.image import ImagePanel
from tests.gui.conftest import Gui

pytestmark = pytest.mark.gpu

SHAPE = (32, 48)
KNOWN = {"pitch": "8 um", "wavelengths": "532 nm", "distance": "5 mm"}


@pytest.fixture
def gui(make_gui: Callable[..., Gui], tmp_path, monkeypatch) -> Iterator[Gui]:
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA", "HOME"):
        monkeypatch.setenv(name, str(tmp_path))
    opened = make_gui(size=(640, 400), panels=(ImagePanel,))
    opened.context.received_fields.listen()
    yield opened


def _wave(turns: float) -> np.ndarray:
    """A tilted plane wave, turns along x over the field."""
    return np.exp(2j * np.pi * turns * np.arange(SHAPE[1]) / SHAPE[1]) * np.ones(SHAPE)


def test_a_field_is_shown_and_the_next_takes_its_place(gui: Gui) -> None:
    push(_wave(1), "run", **KNOWN)
    gui.draw_until_idle()
    assert gui.session.system.is_field
    assert np.allclose(gui.session.document.drive[0, 0], _wave(1), atol=1e-6)
    assert gui.session.view_settings.plane_m == 5e-3
    steps = len(gui.session.history)
    gui.session.edit_view("Focal plane", plane_m=7e-3)
    push(_wave(2), "run", **KNOWN)
    gui.draw_until_idle()
    assert np.allclose(gui.session.document.drive[0, 0], _wave(2), atol=1e-6)
    assert gui.session.view_settings.plane_m == 7e-3
    assert len(gui.session.history) == steps


def test_the_first_field_of_a_program_doesn_t_wait_for_another_image(gui: Gui) -> None:
    assert gui.context.side_renderers.is_busy
    push(_wave(1), "run", **KNOWN)
    gui.draw_frames(2)
    assert gui.session.system.is_field


def test_a_field_of_another_size_is_another_document(gui: Gui) -> None:
    push(_wave(1), "run", **KNOWN)
    gui.draw_until_idle()
    push(_wave(1)[::2, ::2], "run", **KNOWN)
    gui.draw_until_idle()
    assert gui.session.system.modulators[0].shape == (16, 24)
    gui.session.undo()
    assert gui.session.system.modulators[0].shape == SHAPE


def test_the_first_field_is_shown_with_an_exposure_that_fits_it(gui: Gui) -> None:
    """A spot on a dark ground, far beyond white at the exposure 0; the next field keeps what the user has set."""
    spot = np.full(SHAPE, 0.05, complex)
    spot[14:18, 20:24] = 1
    near = KNOWN | {"distance": "0.1 mm"}
    push(spot, "run", **near)
    gui.draw_until_idle()
    field = hv.load_field(spot, **near)
    fitting = fitting_stops(hv.simulate(field, backend="torch").xyz)
    assert abs(gui.session.view_settings.exposure_stops - fitting) < 0.006  # it is rounded to hundredths
    assert gui.session.view_settings.exposure_stops < -2
    gui.session.edit_view("Exposure", exposure_stops=-1.0)
    push(spot[::-1], "run", **near)
    gui.draw_until_idle()
    assert gui.session.view_settings.exposure_stops == -1.0


def test_of_fields_that_come_too_fast_the_newest_is_shown(gui: Gui) -> None:
    for turns in range(5):
        push(_wave(turns), "run", **KNOWN)
    gui.draw_until_idle()
    assert np.allclose(gui.session.document.drive[0, 0], _wave(4), atol=1e-6)


def test_a_field_that_no_bench_shows_is_refused_where_it_was_sent(gui: Gui) -> None:
    before = gui.session.document
    with pytest.raises(UserError, match="from -2 m to 2 m"):
        push(_wave(1), "far", **KNOWN | {"distance": "3 m"})
    gui.draw_until_idle()
    assert gui.session.document is before


def test_the_viewer_takes_its_announcement_back(gui: Gui) -> None:
    assert announced_listener()
    gui.app.close()
    with pytest.raises(UserError, match="no viewer listens"):
        push(_wave(1), **KNOWN)


# --- the recipes of docs/push.md --------------------------------------------------------------------------------------


def test_a_loop_of_torch_shows_its_iterations(gui: Gui) -> None:
    phase = torch.zeros(SHAPE, requires_grad=True)
    for _ in range(2):
        field = torch.exp(1j * phase)
        (field.real - 0.5).square().sum().backward()
        with torch.no_grad():
            phase += 0.1
        push(field, "torch", **KNOWN)
    gui.draw_until_idle()
    assert np.allclose(gui.session.document.drive[0, 0], field.detach().numpy(), atol=1e-6)


def test_slmsuite_shows_the_field_behind_its_modulator(gui: Gui) -> None:
    algorithms: Any = pytest.importorskip("slmsuite.holography.algorithms")
    logging.disable()
    try:
        hologram = algorithms.Hologram(np.ones((32, 64)))
        hologram.optimize("GS", maxiter=2, verbose=False)
    finally:
        logging.disable(logging.NOTSET)
    push(np.exp(1j * hologram.get_phase()), "slmsuite", **KNOWN)
    gui.draw_until_idle()
    assert gui.session.document.drive.shape == (1, 1, 32, 64)
