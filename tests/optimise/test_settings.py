"""Settings out of range are refused with what is expected."""

from __future__ import annotations

from typing import Any

import pytest

from holoview.holograms.optimise.settings import Settings
from holoview.util.errors import UserError


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"iterations": 0}, "iterations: 0; expected at least 1"),
        ({"iterations": -3}, "iterations: -3"),
        ({"iterations": 2.5}, "iterations: 2.5"),
        ({"step_rad": 0.0}, "step: 0.0; expected a positive phase step"),
        ({"step_rad": -1.0}, "step: -1.0"),
        ({"step_rad": float("nan")}, "step: nan"),
        ({"step_rad": float("inf")}, "step: inf"),
        ({"amplitudes_every": 0}, "amplitudes"),
        ({"betas": (0.9, 1.0)}, r"betas: \(0.9, 1.0\); expected numbers from 0 to below 1"),
        ({"betas": (-0.1, 0.9)}, "betas"),
        ({"eyebox": -1.0}, "eyebox: -1.0; expected a weight of 0 or more"),
        ({"eyebox": float("nan")}, "eyebox: nan"),
        ({"eyebox": float("inf")}, "eyebox: inf"),
        ({"free": ()}, "free: nothing; expected at least one of patterns, amplitudes, wavelengths"),
        ({"free": ("pattern",)}, 'free: "pattern"; expected patterns, amplitudes, wavelengths; did you mean patterns'),
        ({"begin": "rough"}, 'begin: "rough"; expected random or smooth'),
        ({"region": (-1, 0, 5, 5)}, "region"),
        ({"region": (0, 0, 0, 5)}, "region: .* expected x, y ≥ 0 and a width and height ≥ 1"),
        ({"plane_weights": (0.0, 0.0)}, "plane weights: .* expected numbers of 0 or more, one of them positive"),
        ({"plane_weights": (1.0, -1.0)}, "plane weights"),
        ({"plane_weights": (1.0, float("nan"))}, "plane weights"),
        ({"wavelength_range_m": (600e-9, 500e-9)}, "wavelength range: 600 to 500 nm"),
        ({"wavelength_range_m": (440.0, 660.0)}, "wavelength range"),
        ({"wavelength_range_m": (440e-9,)}, "wavelength range: .* expected 2 of them, each between 1 nm"),
        ({"loss": "beauty"}, 'loss: "beauty"; expected linear-srgb, srgb'),
        ({"seed": -1}, "seed: -1; expected a whole number from 0"),
        ({"wavelength_spacing_m": -1e-9}, "wavelength spacing: -1 nm is out of range"),
        ({"wavelength_step_m": 0.0}, "wavelength step: 0 nm is out of range"),
    ],
    ids=str,
)
def test_settings_that_make_no_sense_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError, match=message):
        Settings(**settings)


@pytest.mark.parametrize(
    ("loss", "observer", "name"),
    [(None, "eye", "linear-srgb"), (None, "cie1931", "linear-srgb"), (None, "mono", "mono"), ("xyz", "mono", "xyz")],
)
def test_the_loss_follows_the_observer_unless_it_is_named(loss: str | None, observer: str, name: str) -> None:
    assert Settings(loss=loss).loss_for(observer) == name
