"""Defocus is a wrong gap or distance; every term is its coefficient r.m.s. and may depend on the wavelength."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

from holoview.captures.dataset import Captures
from holoview.model.effects.hook_contexts import RelayContext
from holoview.model.effects.registry import get_effect

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
