"""Residuals that are too small for the recorded noise are an inconsistency, whatever the noise looks like."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from holoview.bench.captures.predictor import Prediction
from holoview.bench.captures.prepared_captures import prepare_captures
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose.judge import Decision, NoiseCheck, Verdict, check_noise, limited_by_noise
from holoview.bench.diagnose.likelihood import Comparison
from holoview.bench.diagnose.pipeline import diagnose
from holoview.light.model.effects.registry import listed_effects
from tests.diagnose.conftest import SHAPE, pictures, small_system

COUNT = 4
SIZE = (COUNT, 2 * SHAPE[0], 2 * SHAPE[1])


class Flat:
    """Predicts the same light everywhere."""

    fields_requested = 0

    def __call__(self, indices: NDArray[np.intp], values: Mapping[str, Any], *, grad: bool = False) -> Prediction:
        return Prediction(torch.ones((len(indices), *SIZE[1:])), 64.0)


def _comparison(noise: NDArray[np.float64], recorded: float) -> Comparison:
    """Flat pictures of 1000 counts with this noise, of which the records state the variance."""
    images = np.rint(1064.0 + noise).astype(np.uint16)
    prepared = prepare_captures(pictures(COUNT, images=images))
    prepared = dataclasses.replace(prepared, usable=np.ones(SIZE, dtype=bool))
    return Comparison(Flat(), prepared, np.arange(COUNT), np.full(SIZE, recorded, dtype=np.float32))


def _white(rng: np.random.Generator) -> NDArray[np.float64]:
    return 16.0 * rng.standard_normal(SIZE)


def _correlated(rng: np.random.Generator) -> NDArray[np.float64]:
    """Of neighbours, as readout or a smoothing driver makes it; the variance stays."""
    noise = gaussian_filter(rng.standard_normal(SIZE), (0, 1, 1), mode="wrap")
    return np.asarray(16.0 * noise * np.sqrt(4 * np.pi))  # a Gaussian of σ = 1 leaves 1/(4πσ²) of the variance


def _long_tails(rng: np.random.Generator) -> NDArray[np.float64]:
    """Laplace's distribution, whose kurtosis is 6: squares scatter by √(5/2) of those of Gaussian noise."""
    return rng.laplace(scale=16.0 / np.sqrt(2), size=SIZE)


@pytest.mark.parametrize("draw", [_white, _correlated, _long_tails])
def test_noise_as_recorded_is_never_blamed(draw: Any) -> None:
    """Ten pictures, each blamed with a probability below 1e-7: the deficit of 0.02 that is allowed adds to 5 σ.

    The scatters are 0.010, 0.025 (correlated: √(2·2π/n)) and 0.016, of which 5 σ are 0.05, 0.12 and 0.08.
    """
    for seed in range(10):
        found = check_noise(_comparison(draw(np.random.default_rng(seed)), 256.0 + 1 / 12), {})
        assert not found.is_overstated
        assert found.least > 0.8


@pytest.mark.long
def test_the_chance_is_that_of_the_statistic() -> None:
    """White noise: χ²/n scatters by √(2/n), and each fitted gain takes 1/n. 500 pictures know a scatter to 3 %."""
    pixels = float(np.prod(SIZE))
    drawn = [
        check_noise(_comparison(_white(np.random.default_rng(seed)), 256.0 + 1 / 12), {}).chi2_per_pixel
        for seed in range(500)
    ]
    scatter = (2 / pixels) ** 0.5
    assert np.mean(drawn) == pytest.approx(1 - COUNT / pixels, abs=5 * scatter / 500**0.5)
    assert np.std(drawn) == pytest.approx(scatter, rel=5 * 0.032)


def test_noise_that_is_overstated_is_seen() -> None:
    """A tenth less than recorded; the least is 0.02 and 5 · √(2/20480) = 0.05 below 1."""
    found = check_noise(_comparison(_white(np.random.default_rng(1)) * 0.9**0.5, 256.0), {})
    assert found.is_overstated and 0.93 < found.least < 0.96


def test_a_dark_of_few_bits_is_no_proof() -> None:
    """Where noise is far below a count, every dark pixel reads the same, and rounding isn't noise."""
    assert check_noise(_comparison(np.zeros(SIZE), 0.1), {}) == NoiseCheck(1.0, 0.0)


@pytest.mark.parametrize("sigmas", [0.5, 1.5, 3.2])
def test_noise_that_ends_at_0_counts_is_not_overstated(sigmas: float) -> None:
    """In the dark of a camera whose black level is so many σ above 0 the variance is lower by 45, 11 and 0.2 %."""
    rng, black = np.random.default_rng(4), 16.0 * sigmas
    images = np.rint(np.maximum(black + _white(rng), 0.0)).astype(np.uint16)
    captures = pictures(COUNT, images=images)
    camera = dataclasses.replace(captures.camera, black_level=black)
    prepared = prepare_captures(dataclasses.replace(captures, camera=camera))
    prepared = dataclasses.replace(prepared, usable=np.ones(SIZE, dtype=bool))
    dark = Comparison(Flat(), prepared, np.arange(COUNT), np.full(SIZE, 256.0 + 1 / 12, dtype=np.float32))
    assert not check_noise(dark, {}).is_overstated


def test_overstated_noise_neither_clears_nor_explains() -> None:
    check, best = NoiseCheck(0.44, 0.95), None
    lowered = [limited_by_noise(Decision(v, best), check)[0].verdict for v in Verdict]
    assert Verdict.CONSISTENT not in lowered and Verdict.EXPLAINED not in lowered and Verdict.AMBIGUOUS not in lowered
    same, notes = limited_by_noise(Decision(Verdict.EXPLAINED, best), NoiseCheck(0.97, 0.95))
    assert same.verdict is Verdict.EXPLAINED and not notes


@pytest.mark.parametrize(
    "names", [("camera_gamma", "gap", "stroke"), pytest.param(None, marks=pytest.mark.explores, id="all")]
)
def test_a_file_with_half_the_electrons_per_count_is_not_consistent(names: tuple[str, ...] | None) -> None:
    captures = make_captures(small_system(), {}, AcquisitionSettings(captures_per_condition=6, seed=5))
    halved = dataclasses.replace(captures.camera, electrons_per_count=captures.camera.electrons_per_count / 2)
    effects = None if names is None else [listed_effects()[name] for name in names]
    found = diagnose(dataclasses.replace(captures, camera=halved), effects, free_maps=False)
    assert found.verdict is Verdict.UNEXPLAINED and not found.causes
    assert any(note.startswith("The noise is overstated") for note in found.notes)
