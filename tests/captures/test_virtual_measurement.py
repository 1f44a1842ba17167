"""Virtual captures: exposed as a laboratory would, noisy as the camera is, and jittered as asked."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

import holoview as hv
from holoview.bench.captures import Captures
from holoview.bench.captures.predictor import Predictor
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, Nuisances, make_captures
from holoview.light.model.bench_parts import Relay
from holoview.light.model.system import System
from holoview.util.errors import UserError


def _system(**changes: Any) -> System:
    small = {"shape": [32, 40], "planes": ["3 mm"], "relay1.iris_na": 0.03, "relay2.iris_na": 0.03}
    lasers = {"wavelengths": ["450 nm", "600 nm"], "amplitudes": [[1, 1]], "observer": "mono"}
    return hv.load("holochrome-8-open").edit({**small, **lasers, **changes})


def _chi2(captures: Captures, effects: dict[str, dict[str, float]], finer: int = 1) -> np.ndarray[Any, Any]:
    """χ² a pixel of each capture, its gain fitted."""
    prediction = Predictor(captures, finer=finer)(range(len(captures)), effects)
    found = []
    for image, signal in zip(captures.images, prediction.signal.double().numpy(), strict=True):
        valid = image < captures.camera.saturation
        seen, expected = image[valid] - prediction.black_level, signal[valid]
        expected = expected * (expected @ seen) / (expected @ expected)
        found.append(np.mean((seen - expected) ** 2 / captures.camera.noise_variance(expected)))
    return np.array(found)


SCATTER = 5 * (2 / (64 * 80)) ** 0.5
"""Five standard deviations of χ²/n over the pixels of a picture."""


@pytest.mark.parametrize(
    "effects",
    [{}, {"gap": {"gap_error": 1e-4}}, {"crosstalk": {"sigma": 0.4}, "camera_black": {"black": 30.0}}],
    ids=["none", "gap", "two"],
)
def test_the_effects_explain_the_pictures_to_their_noise(effects: dict[str, dict[str, float]]) -> None:
    captures = make_captures(_system(), effects, AcquisitionSettings(captures_per_condition=4))
    assert _chi2(captures, effects) == pytest.approx(np.ones(8), abs=SCATTER)
    if effects:
        assert _chi2(captures, {}).max() > 2


def test_effects_of_the_preset_are_there_and_not_in_the_nominal_bench() -> None:
    system = _system().edit({"effects.gap.gap_error": 1e-4})
    captures = make_captures(system, {}, AcquisitionSettings(captures_per_condition=1))
    assert captures.gap_m == _system().gap_m
    assert _chi2(captures, {"gap": {"gap_error": 1e-4}}) == pytest.approx(np.ones(2), abs=SCATTER)


@pytest.mark.parametrize("square", ["first order", "first order at 550 nm", 0.031])
def test_a_bench_with_square_and_displaced_stops_is_measured(square: float | str) -> None:
    stops = {"relay1.square": square, "relay2": {"square": square, "centre_na": [0.002, -0.004]}}
    system, effects = _system(**stops), {"gap": {"gap_error": 1e-4}}
    captures = make_captures(system, effects, AcquisitionSettings(captures_per_condition=4))
    assert (captures.relay1, captures.relay2) == (system.relay1, system.relay2)
    assert _chi2(captures, effects) == pytest.approx(np.ones(8), abs=SCATTER)
    round_ones = dataclasses.replace(captures, relay2=Relay(iris_na=0.031))
    assert _chi2(round_ones, effects).max() > 20


def test_pictures_are_well_exposed_and_each_wavelength_has_its_own_scale() -> None:
    captures = make_captures(_system(), {}, AcquisitionSettings(captures_per_condition=8))
    bright = np.quantile(captures.images, 0.999, axis=(1, 2))
    assert np.all(bright > 0.6 * 4095) and np.all(bright < 0.95 * 4095)
    assert np.all((captures.power >= 0.5) & (captures.power <= 1.0)) and len(np.unique(captures.power)) > 8
    light = Predictor(captures)(range(16)).signal.mean(dim=(1, 2)).double().numpy()
    scale = (captures.images.mean(axis=(1, 2)) - 64) / light
    for same in (scale[:8], scale[8:]):
        assert same == pytest.approx(np.full(8, same.mean()), rel=5e-3)  # of the shot noise
    assert scale[0] != pytest.approx(scale[-1], rel=0.02)


@pytest.mark.parametrize(
    ("nuisances", "least"),
    [
        (Nuisances(prnu=0.05), 2.0),
        (Nuisances(camera_jitter_m=1e-6), 2.0),
        (Nuisances(wavelength_jitter_m=0.3e-9), 1.2),
    ],
    ids=["prnu", "camera", "wavelength"],
)
def test_what_varies_is_beyond_the_noise(nuisances: Nuisances, least: float) -> None:
    assert (
        _chi2(
            make_captures(_system(), {}, AcquisitionSettings(captures_per_condition=4, nuisances=nuisances)), {}
        ).max()
        > least
    )


def test_exposure_jitter_is_all_in_the_gain() -> None:
    captures = make_captures(
        _system(), {}, AcquisitionSettings(captures_per_condition=8, nuisances=Nuisances(exposure_jitter=0.05))
    )
    assert _chi2(captures, {}) == pytest.approx(np.ones(16), abs=SCATTER)
    light = Predictor(captures)(range(16)).signal.mean(dim=(1, 2)).double().numpy()
    scale = ((captures.images.mean(axis=(1, 2)) - 64) / light)[:8]
    assert 0.02 < scale.std() / scale.mean() < 0.1


def test_finer_data_need_the_finer_model() -> None:
    captures = make_captures(_system(), {}, AcquisitionSettings(captures_per_condition=4, finer=2))
    assert _chi2(captures, {}, finer=2) == pytest.approx(np.ones(8), abs=SCATTER)
    assert _chi2(captures, {}).max() > 20


def test_a_fourier_bench_is_measured_too() -> None:
    one = _system(**{"modulators": _system().modulators[:1], "gap": None, "relay1.iris_na": None})
    settings = AcquisitionSettings(
        captures_per_condition=2, focal_length_m=0.2, camera_pitch_m=10e-6, camera_shape=(61, 81)
    )
    captures = make_captures(one, {"distance": {"distance_error": 1e-3}}, settings)
    assert captures.is_fourier and captures.shape == (61, 81) and not captures.distance_m.any()
    found = _chi2(captures, {"distance": {"distance_error": 1e-3}})
    assert found == pytest.approx(np.ones(4), abs=5 * (2 / (61 * 81)) ** 0.5)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"relay2.dc_block_na": 0.001}, "relay2: has more than stops"),
        ({"source": {"directions": [[0, 0.01]]}}, "source: isn't a single wave"),
        ({"levels": [0, 0.3, 1.0]}, "levels: aren't equal steps"),
    ],
)
def test_a_nominal_bench_that_a_file_cant_hold_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(UserError, match=words):
        make_captures(_system(**changes), {}, AcquisitionSettings(captures_per_condition=1))


def test_a_bench_without_light_is_told() -> None:
    dark = dataclasses.replace(AcquisitionSettings(captures_per_condition=1), black_level=4094.9)
    with pytest.raises(UserError, match="no light reaches the camera"):
        make_captures(_system(), {"camera_black": {"black": 10.0}}, dark)
