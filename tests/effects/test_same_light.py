"""The light of a plane and a wavelength is the same whatever else is computed, with every effect."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import holoview as hv
from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import Predictor
from holoview.light.model.effects.effect import CAMERA_HOOKS
from holoview.light.model.effects.registry import listed_effects

Make = Callable[..., Captures]
SEEN = {name: effect for name, effect in listed_effects().items() if not effect.overrides("image")}
VALUES: dict[str, dict[str, Any]] = {
    "source_extent": {"radius": 2e-3},
    "slm1_fringes": {"path_y": 2e-6, "cos1": 0.1, "cos2": 0.1},  # the first laser's is that of a laser alone
    "slm2_fringes": {"path_y": 2e-6, "cos1": 0.1, "cos2": 0.1},
    "plane_errors": {"distances": (4e-3, 12e-3), "errors": (2e-4, -1e-4)},
}
TOLERANCE = 1e-12  # of the sums of two transforms in complex128, of the brightest sample


def _values(name: str) -> dict[str, Any]:
    effect = listed_effects()[name]
    return VALUES.get(name) or {p.name: p.nudged(1.0) for p in effect.parameters if not p.secondary}


def _bench(name: str, **changes: Any) -> hv.System:
    bench = {
        "shape": [48, 64] if name == "source_extent" else [20, 24],
        "wavelengths": ["450 nm", "630 nm"],
        "amplitudes": [[1, 1]],
        "planes": ["1 mm"],
        "relay1": {"iris_na": 0.045},
        "relay2": {"iris_na": 0.04},
        "effects": {name: _values(name)},
    }
    return hv.load("holochrome-8").edit({**bench, **changes})


@pytest.mark.parametrize("name", SEEN)
def test_of_a_plane_beside_others(name: str) -> None:
    system = _bench(name)
    drive = hv.random_drive(system, seed=3)
    alone = hv.simulate(system, drive, planes=["1 mm"], backend="torch64").intensity[0]
    beside = hv.simulate(system, drive, planes=["12 mm", "1 mm", "0.5 mm"], backend="torch64").intensity[1]
    np.testing.assert_allclose(alone, beside, rtol=0, atol=TOLERANCE * alone.max())


@pytest.mark.parametrize("name", SEEN)
@pytest.mark.parametrize(("number", "wavelength"), [(0, "450 nm"), (1, "630 nm")])
def test_of_a_wavelength_beside_others(name: str, number: int, wavelength: str) -> None:
    system = _bench(name)
    drive = hv.random_drive(system, seed=3)
    beside = hv.simulate(system, drive, backend="torch64").intensity[0]
    lines = len(beside) // 2  # second lines and broad ones are wavelengths of their own
    alone = hv.simulate(_bench(name, wavelengths=[wavelength], amplitudes=[[1]]), drive, backend="torch64").intensity[0]
    np.testing.assert_allclose(alone, beside[number * lines :][:lines], rtol=0, atol=TOLERANCE * alone.max())


def test_a_dc_block_wider_than_the_first_order_of_one_wavelength_leaves_the_others_theirs() -> None:
    """At the corners of the first order are 450 nm/(√2·8 µm) = 39.8 mrad, and 55.7 mrad at 630 nm."""
    block = {"relay2": {"square": "first order"}, "effects": {"dc_block": {"radius": "45 mrad"}}}
    system = _bench("dc_block", **block)
    drive = hv.random_drive(system, seed=3)
    beside = hv.simulate(system, drive, backend="torch64").intensity[0]
    red = _bench("dc_block", **block, wavelengths=["630 nm"], amplitudes=[[1]])
    alone = hv.simulate(red, drive, backend="torch64").intensity[0, 0]
    assert not beside[0].any() and alone.max() > 0
    np.testing.assert_allclose(alone, beside[1], rtol=0, atol=TOLERANCE * alone.max())


@pytest.mark.parametrize("name", [n for n, e in SEEN.items() if n != "settling"])
def test_of_a_capture_beside_others(name: str, make_session: Make) -> None:
    """Captures of two wavelengths in two planes, and pictures of all at once but for effects of the camera."""
    λ, z = (a.ravel() for a in np.meshgrid([450e-9, 630e-9], [4e-3, 12e-3], indexing="ij"))
    levels = np.repeat(make_session(1).levels, 4, axis=0)
    captures = make_session(4, levels=levels, wavelength_m=λ, distance_m=z)
    effects = {name: _values(name)}
    signals = Predictor(captures, double_precision=True)(range(4), effects).signal.numpy()
    for k in (0, 3):
        fewer = captures.subset([k])
        alone = Predictor(fewer, double_precision=True)([0], effects).signal[0].numpy()
        np.testing.assert_allclose(alone, signals[k], rtol=0, atol=TOLERANCE * alone.max())
    if not any(listed_effects()[name].overrides(hook) for hook in CAMERA_HOOKS):
        system = captures.nominal_system([450e-9, 630e-9], [4e-3, 12e-3]).edit({"effects": effects})
        stack = hv.simulate(system, captures.drive(0)[None], backend="torch64").intensity
        seen = stack.reshape(2, 2, -1, *stack.shape[2:]).sum(axis=2).transpose(1, 0, 2, 3).reshape(signals.shape)
        np.testing.assert_allclose(signals, seen * captures.power[0], rtol=0, atol=1e-9 * seen.max())
