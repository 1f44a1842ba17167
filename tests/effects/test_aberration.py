"""Defocus is a wrong gap or distance; every term is its coefficient r.m.s. and may depend on the wavelength.

Beyond the nominal iris the polynomials go on.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

import holoview as hv
from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import Predictor
from holoview.light.model.effects.hook_contexts import RelayContext
from holoview.light.model.effects.registry import get_effect

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]
SINE = torch.linspace(-0.03, 0.03, 401).double()


def _opd(number: int, wavelength_m: float, **values: float) -> torch.Tensor:
    """Optical path over the iris, from the pupil's phase (of less than half a wave)."""
    effect, at = (
        get_effect(f"aberration{number}"),
        RelayContext(number - 1, wavelength_m, SINE[:, None], SINE[None], 0.03),
    )
    pupil = effect.pupil(torch.ones(401, 401, dtype=torch.complex128), at, effect.parameter_values(values))
    return (pupil.angle() * wavelength_m / (2 * torch.pi))[at.radius <= 1]


@pytest.mark.parametrize(("number", "twin"), [(1, "gap"), (2, "distance")])
def test_defocus_is_a_wrong_distance(make_session: Make, predicted: Predicted, number: int, twin: str) -> None:
    captures, metres = make_session(1), 50e-6
    # −z·A/2 = c·√3·(2ρ² − 1) + piston with A = NA²·ρ²; the next order is A/4 = 2e-4 of it
    coefficient = -metres * 0.03**2 / (4 * 3**0.5)
    same = predicted(captures, {f"aberration{number}": {"z4": coefficient}})
    torch.testing.assert_close(same, predicted(captures, {twin: {f"{twin}_error": metres}}), rtol=1e-2, atol=1e-3)
    assert twin in get_effect(f"aberration{number}").degenerate_with


@pytest.mark.parametrize("number", [1, 2])
@pytest.mark.parametrize("noll", range(4, 12))
def test_a_term_is_its_coefficient_r_m_s(noll: int, number: int) -> None:
    assert float(_opd(number, 550e-9, **{f"z{noll}": 30e-9}).square().mean().sqrt()) == pytest.approx(30e-9, rel=0.01)


@pytest.mark.parametrize("number", [1, 2])
def test_a_slope_is_per_100_nm_from_550_nm(number: int) -> None:
    red, green = (_opd(number, λ, z6_slope=20e-9) for λ in (650e-9, 550e-9))
    torch.testing.assert_close(red, _opd(number, 650e-9, z6=20e-9))
    assert not bool(green.any())


WIDER = {"radius_error": 0.4, "decentre_y": 0.2, "decentre_x": -0.3}


def test_a_wider_iris_off_the_centre_shows_more_of_the_same_glass() -> None:
    """Against the angular spectrum in numpy, with astigmatism and coma as they stand in Noll's table.

    The relative L2 error was 30 % where the glass ended at the nominal iris.
    """
    astigmatism, coma = 250e-9, -200e-9
    system = hv.load("holochrome-8-1slm").edit(
        {
            "shape": [40, 48],
            "wavelengths": ["532 nm"],
            "amplitudes": [[1]],
            "planes": ["3 mm"],
            "relay2": {"iris_na": 0.02},
            "effects": {"iris2": WIDER, "aberration2": {"z6": astigmatism, "z8": coma}},
        }
    )
    drive = hv.random_drive(system, seed=1)
    found = hv.simulate(system, drive, backend="torch64").intensity[0, 0]
    λ, slm = 532e-9, system.modulators[0]
    field = np.exp(2j * np.pi * np.kron(drive[0, 0], np.ones((2, 2))) * slm.stroke_m / λ)
    padded = hv.make_plan(system).grid.padded
    y, x = (λ * np.fft.fftfreq(n, slm.pitch_m / 2) for n in padded)
    y, x = y[:, None], x[None, :]
    v, u = y / 0.02, x / 0.02  # in radii of the nominal iris
    noll6 = 6**0.5 * (u**2 - v**2)
    noll8 = 8**0.5 * (3 * (u**2 + v**2) - 2) * u
    waves = (astigmatism * noll6 + coma * noll8) / λ - 3e-3 / λ * (1 - np.sqrt(1 - y**2 - x**2))
    passes = (v - 0.2) ** 2 + (u + 0.3) ** 2 <= 1.4**2
    seen = np.fft.ifft2(np.fft.fft2(field, padded) * passes * np.exp(2j * np.pi * waves))[:80, :96]
    expected = np.abs(seen) ** 2
    assert np.linalg.norm(found - expected) < 1e-6 * np.linalg.norm(expected)


def test_the_glass_of_a_preset_is_that_of_the_effect_also_where_the_iris_is_wider(make_session: Make) -> None:
    """As executors and captures compute it; Zernike terms stay over the nominal iris."""
    system = make_session(1).nominal_system().edit({"effects": {"iris2": WIDER}})
    drive = hv.random_drive(system, seed=2)
    in_preset = system.edit({"relay2.aberration": {"Z7": "150 nm", "Z9": "80 nm"}})
    as_effect = system.edit({"effects": {"iris2": WIDER, "aberration2": {"z7": 150e-9, "z9": 80e-9}}})
    seen = [hv.simulate(s, drive, backend="torch64").intensity for s in (in_preset, as_effect)]
    np.testing.assert_allclose(*seen, rtol=0, atol=1e-12 * seen[0].max())
    captures = make_session(1, relay2=in_preset.relay2)
    predicted = Predictor(captures, double_precision=True)([0], {"iris2": WIDER}).signal[0].numpy()
    executed = hv.simulate(in_preset, captures.drive(0)[None], backend="torch64").intensity[0, 0]
    np.testing.assert_allclose(predicted, executed, rtol=0, atol=1e-9 * executed.max())
