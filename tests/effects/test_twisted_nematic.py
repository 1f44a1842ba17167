"""The amplitude follows the phase: orders of a grating in closed form, and a twisted cell between polarisers."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.polynomial import Legendre
from numpy.typing import NDArray

import holoview as hv
from holoview.light.model.effects.hook_contexts import ModulatorContext
from holoview.light.model.effects.registry import get_effect
from holoview.light.optics.torch_effects import TorchEffects

λ = 532e-9
CURVE = {"slope": -0.35, "bow": 0.2, "bend": 0.1}


def _transmission(share: NDArray[np.float64], upsample: int = 1, **more: dict[str, float]) -> NDArray[np.complex128]:
    at = ModulatorContext(0, λ, λ, 36e-6, share.shape, upsample)
    effects = TorchEffects({"twisted_nematic": CURVE, **more})
    return effects.modulator_transmission(torch.from_numpy(share), at, torch.complex128).numpy()


def test_the_amplitude_is_the_legendre_series_of_the_share() -> None:
    share = np.linspace(0, 1, 21)[None]
    expected = Legendre([1, CURVE["slope"], CURVE["bow"], CURVE["bend"]])(2 * share - 1)
    found = _transmission(share)
    np.testing.assert_allclose(found, expected * np.exp(2j * np.pi * share), rtol=1e-12)


def test_a_static_wavefront_changes_no_amplitude() -> None:
    """The cell's state sets it, not the flatness of the glass; nor does a map of samples."""
    share = np.random.default_rng(2).random((6, 8))
    plain, bent = _transmission(share), _transmission(share, 2, slm_flatness={"z5_1": 2e-7}, crosstalk={"sigma": 0.3})
    np.testing.assert_allclose(np.abs(bent), np.kron(np.abs(plain), np.ones((2, 2))), rtol=1e-12)


def test_orders_of_a_binary_grating() -> None:
    """Levels 0 and s of equal width: A(0) + A(s)·e^iφ in the zero order, A(0) − A(s)·e^iφ in the odd ones."""
    share = np.tile(np.repeat([0.0, 0.6], 4), 3)[None]
    orders = np.fft.fft(_transmission(share)[0]) / 24
    a, b = Legendre([1, CURVE["slope"], CURVE["bow"], CURVE["bend"]])(np.array([-1.0, 0.2])) / 2
    turned = b * np.exp(2j * np.pi * 0.6)
    assert abs(orders[0]) == pytest.approx(abs(a + turned), rel=1e-12)
    envelope = abs(sum(np.exp(-2j * np.pi * k / 8) for k in range(4))) / 4  # of bars of four samples
    assert abs(orders[3]) == pytest.approx(abs(a - turned) * envelope, rel=1e-12)


@pytest.mark.parametrize(("polariser", "analyser"), [(30.0, -20.0), (70.0, 10.0), (20.0, 15.0)])
def test_a_twisted_cell_between_polarisers_is_described(polariser: float, analyser: float) -> None:
    """Lu and Saleh's Jones matrix of a cell with a twist of α = 90° and a retardation 2β that the voltage takes from
    1.2 π towards 0: e^−iβ·R(−α)·(cos γ − i·β/γ·σ_z sin γ + i·α/γ·σ_y sin γ), γ² = α² + β². The effect's three numbers
    hold its amplitude against its own phase to 4 % of the mean, where that phase grows steadily."""
    α, (p, a) = np.pi / 2, np.radians([polariser, analyser])
    field = []
    for β in np.linspace(0.6 * np.pi, 0.0, 61):
        γ = np.hypot(α, β)
        c, s = np.cos(γ), np.sin(γ) / γ
        cell = np.exp(-1j * β) * np.array([[c - 1j * β * s, α * s], [-α * s, c + 1j * β * s]])
        rotated = np.array([[np.cos(α), -np.sin(α)], [np.sin(α), np.cos(α)]]) @ cell
        field.append(np.array([np.cos(a), np.sin(a)]) @ rotated @ np.array([np.cos(p), np.sin(p)]))
    phase = np.unwrap(np.angle(field))
    assert (np.diff(phase) > 0).all()
    share, amplitude = (phase - phase[0]) / np.ptp(phase), np.abs(field)
    curve = Legendre.fit(share, amplitude, 3, domain=[0, 1])
    mean, *relative = curve.coef / curve.coef[0]
    effect = get_effect("twisted_nematic")
    values = dict(zip(("slope", "bow", "bend"), map(float, relative), strict=True))
    assert all(p.parse(values[p.name], "") == values[p.name] for p in effect.parameters)
    at = ModulatorContext(0, λ, λ, 36e-6, (1, 61), 1, shown=torch.from_numpy(share)[None])
    found = effect.transmission(torch.ones(1, 61).to(torch.complex128), at, effect.parameter_values(values))
    assert mean == 1 and np.abs(found.numpy()[0].real - amplitude / curve.coef[0]).max() < 0.04


def test_it_is_rendered_and_told() -> None:
    system = hv.load("holochrome-8").edit({"shape": [12, 16], "effects": {"twisted_nematic": CURVE}})
    drive = np.random.default_rng(0).random(system.drive_shape)
    plain = hv.simulate(system.edit({"effects": {}}), drive, backend="torch64").intensity
    assert not np.allclose(plain, hv.simulate(system, drive, backend="torch64").intensity, rtol=1e-3)
    assert "by -0.35 from its mean" in get_effect("twisted_nematic").format_finding(system, CURVE)
