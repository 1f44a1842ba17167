"""Light of the room adds counts in proportion to the exposure, whatever the lasers do, with its own shot noise."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
import torch

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import Predictor
from holoview.bench.captures.prepared_captures import prepare_captures
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose.likelihood import Comparison
from tests.diagnose.conftest import small_system

ROOM = {"ambient": {"level": 300.0, "slope_y": 100.0, "slope_x": -50.0}}
Make = Callable[..., Captures]


def test_counts_grow_with_the_exposure_and_not_with_the_power(make_session: Make) -> None:
    """Halfway between centre and edge, half the slope; slopes end at the pixels' centres half a pixel from the edge."""
    captures = make_session(3, exposure_s=np.array([0.5, 1.0, 1.0]), power=np.array([1.0, 1.0, 0.2]))
    found = Predictor(captures)(range(3), ROOM)
    assert found.ambient is not None and torch.equal(found.signal, Predictor(captures)(range(3)).signal)
    assert torch.equal(found.ambient[1], found.ambient[2]) and torch.equal(found.ambient[1], 2 * found.ambient[0])
    rows, columns = captures.shape
    picture = found.ambient[1].double()
    assert float(picture.mean()) == pytest.approx(300.0, rel=1e-6)
    assert float(picture[-1].mean()) == pytest.approx(300 + 100 * (1 - 1 / rows), rel=1e-6)
    assert float(picture[:, 0].mean()) == pytest.approx(300 + 50 * (1 - 1 / columns), rel=1e-6)


def test_light_is_never_negative(make_session: Make) -> None:
    found = Predictor(make_session(1))([0], {"ambient": {"level": 10.0, "slope_x": 100.0}}).ambient
    assert found is not None and float(found.min()) == 0.0 and float(found.max()) > 100


def test_measured_counts_have_it_with_its_shot_noise() -> None:
    """The first capture of both sessions has the same laser light, so that their difference is the room's."""
    settings, room_per_s = AcquisitionSettings(captures_per_condition=1, seed=4), 6e4
    sessions = (make_captures(small_system(), faults, settings) for faults in ({}, {"ambient": {"level": room_per_s}}))
    plain, lit = sessions
    black, electrons = lit.camera.black_level, lit.camera.electrons_per_count
    ratio = lit.exposure_s[0] / plain.exposure_s[0]
    lasers = (plain.images[0].astype(float) - black) * ratio
    added = lit.images[0].astype(float) - black - lasers
    room = room_per_s * lit.exposure_s[0]
    variance = (room + lasers.mean() * (1 + ratio)) / electrons
    assert ratio < 1 and room > 300
    assert added.mean() == pytest.approx(room, abs=5 * (variance / added.size) ** 0.5)
    assert added.var() == pytest.approx(variance, rel=0.1)  # of 5120 pixels: √(2/n) = 2 %; read noise adds 1 %


def test_a_comparison_subtracts_it_and_expects_its_counts(make_session: Make) -> None:
    """Pictures of the prediction itself with the room's light leave nothing, and their gain is the lasers'."""
    captures = make_session(2, exposure_s=np.array([0.5, 1.0]))
    predictor = Predictor(captures)
    prediction = predictor([0, 1], ROOM)
    assert prediction.ambient is not None
    scale = 1000 / float(prediction.signal.mean())
    counts = scale * prediction.signal + prediction.ambient + captures.camera.black_level
    exact = prepare_captures(dataclasses.replace(captures, images=np.full_like(captures.images, 500)))
    data = dataclasses.replace(exact, light=counts.numpy().astype(np.float32) - np.float32(64.0))
    comparison = Comparison(predictor, data, np.arange(2), np.ones(counts.shape, np.float32))
    fitted = comparison.fit_gains(ROOM)
    assert fitted.gain == pytest.approx([scale, scale], rel=1e-5)
    assert np.abs(fitted.residual).max() < 1e-2  # of some thousand counts in float32
    usable = comparison.weight > 0
    assert fitted.expected[usable] == pytest.approx(data.light[usable], rel=1e-4)
