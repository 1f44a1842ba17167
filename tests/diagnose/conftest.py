"""Captures for tests of the parts (pictures of noise, no optics) and benches for those of the whole."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.patterns import pattern_roughness
from holoview.bench.captures.predictor import Predictor
from holoview.bench.captures.prepared_captures import prepare_captures
from holoview.bench.captures.virtual_measurement import AcquisitionSettings
from holoview.bench.captures.virtual_measurement import make_captures as measure
from holoview.bench.diagnose.capture_split import split_captures
from holoview.bench.diagnose.extended_model import PredictorWithKnownEffects
from holoview.bench.diagnose.search_context import (
    NeighbourVariances,
    PerThreadPredictor,
    SearchContext,
    equivalent_effects,
)
from holoview.bench.diagnose.worker_pool import WorkerPool
from holoview.light.model.bench_parts import Modulator, Relay
from holoview.light.model.effects.registry import EffectValues, listed_effects
from holoview.light.model.system import System
from tests.captures.conftest import SHAPE, pictures

MakeContext = Callable[..., SearchContext]

NOISE_CHI2 = 1 + 5.5 * (2 / (4 * 44 * 60)) ** 0.5
"""χ²/n that chance exceeds once in 50 million times: of the four held-out pictures of twelve of `small_system`."""


def small_system(modulators: int = 2, **changes: Any) -> System:
    """Modulators of 32 × 40 pixels and 16 levels, two wavelengths, one plane."""
    panel = Modulator(pitch_m=8e-6, shape=SHAPE, stroke_m=825e-9, levels=16)
    two = modulators == 2
    plain = System(
        wavelengths_m=np.array([450e-9, 600e-9]),
        amplitudes=np.ones((1, 2)),
        modulators=(panel,) * modulators,
        gap_m=1e-3 if two else None,
        planes_m=np.array([4e-3]),
        relay1=Relay(iris_na=0.03 if two else None),
        relay2=Relay(iris_na=0.03),
        observer="mono",
    )
    return plain.edit(changes) if changes else plain


@pytest.fixture
def make_captures() -> Callable[..., Captures]:
    """Pictures of random numbers."""
    return pictures


@pytest.fixture(scope="session")
def nominal() -> Captures:
    """A small session of a bench without faults."""
    return measure(small_system(), {}, AcquisitionSettings(captures_per_condition=6, seed=5))


@pytest.fixture(scope="session")
def context(nominal: Captures) -> SearchContext:
    """What a search would work with on these captures."""
    return make_context_of(nominal)


@pytest.fixture
def make_context() -> MakeContext:
    """What a search would work with on captures of a small session with faults {effect: {parameter: value}}."""
    return lambda faults=None: make_context_of(
        measure(small_system(), faults or {}, AcquisitionSettings(captures_per_condition=6, seed=5))
    )


def measure_at_one_exposure(system: System, faults: EffectValues, seed: int, each: int = 6) -> Captures:
    """Captures of one power and one exposure time, the longest that saturates hardly anything; noise by numpy."""
    nominal = measure(system, {}, AcquisitionSettings(captures_per_condition=each, seed=seed))
    count = len(nominal)
    nominal = replace(nominal, exposure_s=np.full(count, 0.05), power=np.ones(count))
    prediction, camera = Predictor(nominal)(np.arange(count), faults), nominal.camera
    light = prediction.signal.double().numpy()
    light *= 0.75 * (camera.saturation - camera.black_level) / np.quantile(light, 0.999, axis=(1, 2)).max()
    light += 0.0 if prediction.ambient is None else prediction.ambient.double().numpy()
    rng, gain = np.random.default_rng((seed, 1)), camera.electrons_per_count
    electrons = rng.poisson(gain * light) + camera.read_noise * rng.standard_normal(light.shape)
    counts = np.rint(electrons / gain + prediction.black_level)
    return replace(nominal, images=np.clip(counts, 0, camera.saturation).astype(np.uint16))


def make_context_of(captures: Captures) -> SearchContext:
    """What a search would work with on these captures."""
    effects, properties, data = dict(listed_effects()), captures.data_properties(), prepare_captures(captures)
    return SearchContext(
        data=data,
        system=captures.nominal_system(),
        effects=effects,
        split=split_captures(captures, pattern_roughness(captures)),
        predictor=PerThreadPredictor(partial(PredictorWithKnownEffects, captures=captures, known_values={})),
        workers=WorkerPool(1),
        variances=NeighbourVariances(data),
        equivalents=equivalent_effects(effects, properties),
    )
