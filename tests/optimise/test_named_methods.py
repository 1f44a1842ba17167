"""Double phase and Gerchberg–Saxton: what theory says about them, the adjoint they use, and what they refuse."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.special import jv

from holoview.holograms.optimise.hologram_job import RunOptions, optimise_hologram
from holoview.holograms.optimise.named_methods import (
    AlternatingProjections,
    chosen_lasers,
    double_phase,
    iterate_named,
)
from holoview.holograms.optimise.problem import Problem
from holoview.holograms.optimise.settings import Settings
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.light.optics.propagate import free_space_at
from holoview.util.errors import UserError

Bench = Callable[..., System]
Noise = Callable[..., torch.Tensor]

ONE_MODULATOR = {"modulators": [{"pitch": "8 um", "shape": [12, 16], "stroke": "825 nm"}], "gap": None}
ONE_LASER = {**ONE_MODULATOR, "wavelengths": ["532 nm"], "amplitudes": [[1.0]], "planes": ["2 mm"]}
UNITARY = {**ONE_LASER, "upsample": 1, "propagation": "periodic"}


def _stack(system: System) -> np.ndarray:
    return np.random.default_rng(7).uniform(0.0, 0.8, (len(system.planes_m), *make_plan(system).grid.shape, 3))


# --- double phase ----------------------------------------------------------------------------------------------------


def test_the_two_phases_have_the_field_as_their_mean(noise: Noise) -> None:
    modulus, phase = noise(0, 9, 14), 2 * math.pi * noise(1, 9, 14)
    field = torch.polar(modulus.double(), phase.double())
    upper = double_phase(field)
    lower = 2 * field.angle() - upper  # the other phase of each pixel
    mean = (torch.polar(torch.ones_like(upper), upper) + torch.polar(torch.ones_like(upper), lower)) / 2
    torch.testing.assert_close(mean, field / field.abs().max(), rtol=0, atol=1e-14)
    signs = (upper - field.angle()).sign()
    assert signs[0, 1] == signs[1, 0] == -1 and signs[1, 1] == signs[2, 0] == 1


def test_a_field_of_constant_modulus_keeps_its_phase(noise: Noise) -> None:
    phase = (2 * math.pi * noise(0, 8, 11)).double()
    shown = double_phase(torch.polar(torch.full_like(phase, 0.3), phase))
    # |U|/|U|max ≥ 1 − 4ε because cos² + sin² are rounded; arccos(1 − δ) ≤ √(2δ)·(1 + δ)
    error = torch.polar(torch.ones_like(phase), shown) - torch.polar(torch.ones_like(phase), phase)
    assert error.abs().max() <= 1.01 * math.sqrt(8 * np.finfo(float).eps)


def test_a_smooth_field_is_seen_behind_a_stop_of_half_the_order() -> None:
    """A = cos β with β = (1 + cos(2π·m·x/N))/2·α, so that the pattern is A + i·(−1)^(x + y)·sin β.

    The stop passes |k| < N/4. Jacobi and Anger: β's exponential has the harmonics m·n with coefficients |J_n(α/2)|, and
    cosine and sine of β no larger ones. Of A, the stop loses those with m·n ≥ N/4; of the rest, which the checkerboard
    displaces by N/2, it passes those with m·n > N/4. Each is at most 2·Σ_{n ≥ N/4m} |J_n|.
    """
    count, m, α = 64, 4, 1.0
    x = torch.arange(count, dtype=torch.float64)
    amplitude = torch.cos(α / 2 * (1 + torch.cos(2 * math.pi * m * x / count))).expand(count, count)
    pattern = torch.exp(1j * double_phase(amplitude.to(torch.complex128)))
    frequency = torch.fft.fftfreq(count).abs()
    passed = (frequency[:, None] < 0.25) & (frequency < 0.25)
    seen = torch.fft.ifft2(torch.fft.fft2(pattern) * passed)
    error = float((seen - amplitude / amplitude.max()).abs().max())
    bound = 4 * sum(abs(jv(n, α / 2)) for n in range(count // (4 * m), 60))
    assert error <= bound + 1e-12
    assert bound < 0.002


def test_the_field_at_the_pixels_is_the_adjoint_of_propagation(bench: Bench, noise: Noise) -> None:
    """⟨x, A p⟩ = ⟨A⁺x, p⟩ for every laser, in float64: the sums have some 10⁴ terms of modulus ≤ 1."""
    system = bench(source={"directions": [[0, 0], [0.01, -0.02]]}, **{"relay2.iris_na": 0.03})
    model = Problem(system, _stack(system), Settings(), double=True).model
    paths_m = noise(0, *system.drive_shape).double() * 825e-9
    shape = (len(model.lasers), model.source_count, *model.plan.grid.shape)
    x = torch.polar(noise(1, *shape).double(), 6 * noise(2, *shape).double())

    def compare(plane: int, rows: slice, fields: torch.Tensor) -> torch.Tensor:
        product = (x[:, :, rows].conj() * fields).sum(dim=(1, 2, 3))
        fields.copy_(x[:, :, rows].conj())
        return product

    model.forward(paths_m)
    parts = model.process_planes([1], compare, carry_back=True)[0]
    products = torch.stack(parts).sum(dim=0)
    λ = torch.tensor(system.wavelengths_m)[:, None, None]
    pixels = torch.exp(2j * math.pi * paths_m[0, 0] / λ)
    adjoint = (model.pixel_fields().conj() * pixels).sum(dim=(1, 2))
    torch.testing.assert_close(adjoint, products, rtol=1e-9, atol=1e-9)


def test_double_phase_shows_a_smooth_picture_at_its_wavelength(bench: Bench) -> None:
    """Behind a stop of half the order, light that stays is smooth: 76 dB. Random patterns show speckle of contrast 1.

    Speckle of mean s·T against T has a mean squared error of at least T²/2, with s = 1/2: 17 dB for T = 0.2.
    """
    modulators = [{"pitch": "8 um", "shape": [48, 64], "stroke": "825 nm"}]
    stops = {"relay2.iris_na": 532e-9 / (4 * 8e-6), "propagation": "periodic", "observer": "mono"}
    system = bench(**{**ONE_LASER, "modulators": modulators, **stops})
    rows, columns = make_plan(system).grid.shape
    y, x = np.ogrid[:rows, :columns]
    picture = 0.2 + 0.15 * np.cos(2 * np.pi * x / columns) * np.cos(2 * np.pi * y / rows)
    stack = np.repeat(picture[None, :, :, None], 3, axis=-1).astype(np.float32)
    (state,) = iterate_named("double-phase", system, stack, Settings())
    random = next(iter(iterate_named("gerchberg-saxton", system, stack, Settings())))
    assert state.iteration == state.iterations == 0
    assert state.psnr_db > 50
    assert random.psnr_db < 25


def test_each_frame_with_light_has_the_wavelength_that_looks_brightest(bench: Bench) -> None:
    system = bench(amplitudes=[[1.0, 0.0, 0.5], [1.0, 1.0, 1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    assert chosen_lasers(make_plan(system)) == [(0, 2), (1, 1), (3, 0)]
    (state,) = iterate_named("double-phase", system, _stack(system), Settings())
    assert state.best.drive[1, 0].any() and not state.best.drive[2].any()


# --- Gerchberg–Saxton ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "changes",
    [
        UNITARY,
        {},
        {**ONE_LASER, "relay2.iris_na": 0.03},
        {"source": {"directions": [[0, 0], [0.01, -0.02]]}, "relay2.square": "first order"},
        {"modulators": [{"pitch": "8 um", "shape": [12, 16], "stroke": "825 nm", "levels": 4}], "gap": None},
    ],
    ids=["unitary", "two modulators and planes, three lasers", "a stop", "sources and orders", "four levels"],
)
def test_the_amplitude_error_never_rises(changes: dict[str, Any], bench: Bench, noise: Noise) -> None:
    """Fienup 1982, section III. Errors are those of fields in float32, which lose some 1e-6 of their norm."""
    system = bench(**changes)
    projections = AlternatingProjections(Problem(system, _stack(system), Settings()))
    drive = projections.start(noise(0, *system.drive_shape).float())
    errors = []
    for _ in range(8):
        drive = projections.step(drive)
        errors.append(projections.error)
    assert all(after <= before * (1 + 1e-5) for before, after in pairwise(errors))
    assert system.modulators[0].levels is not None or errors[-1] < errors[0]


def test_where_propagation_is_unitary_a_step_is_gerchberg_and_saxtons(bench: Bench, noise: Noise) -> None:
    """One step by hand: FFT, the target's amplitude, FFT back, nearest of 256 levels."""
    system = bench(**UNITARY)
    stack = _stack(system)
    projections = AlternatingProjections(problem := Problem(system, stack, Settings()))
    start = projections.start(noise(0, *system.drive_shape).float())
    found = projections.step(start)[0, 0].double()
    plan = make_plan(system)
    transfer = plan.transfer(1, 0)
    ky, kx = (torch.from_numpy(np.fft.fftfreq(n, 1 / n)).long() for n in plan.grid.padded)
    h = free_space_at(transfer, ky, kx, torch.complex128)
    turns = 825e-9 / 532e-9
    field = torch.fft.ifft2(h * torch.fft.fft2(torch.exp(2j * math.pi * turns * start[0, 0].double())))
    channels = problem.objective.target.double()[0]
    mixture = torch.linalg.pinv(problem.objective.wavelength_channels.double().T)[0]
    target = torch.einsum("c,cyx->yx", mixture, channels).clamp(min=0).sqrt()
    wanted = torch.fft.ifft2(h.conj() * torch.fft.fft2(target * field / field.abs()))
    phasors = torch.exp(2j * math.pi * turns * torch.linspace(0, 1, 256).double())
    score = (wanted.conj()[..., None] * phasors).real
    chosen = torch.gather(score, 2, (found * 255).round().long()[..., None])[..., 0]
    assert ((score.amax(dim=2) - chosen) <= 1e-4 * wanted.abs().max()).all()


def test_it_beats_random_patterns_and_gives_a_hologram(bench: Bench) -> None:
    system = bench(**ONE_MODULATOR)
    stack = _stack(system).astype(np.float32)
    settings, options = Settings(iterations=20, seed=3), RunOptions(method="gerchberg-saxton")
    first = next(iter(iterate_named("gerchberg-saxton", system, stack, settings)))
    told: list[str] = []
    result = optimise_hologram(system, stack, settings, options, tell=told.append)
    assert result.state.iteration == 20
    assert result.state.loss < first.loss
    assert result.hologram.system.edit({"amplitudes": system.amplitudes}) == system
    assert any("Gerchberg" in text for text in told)


# --- what is refused -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["double-phase", "gerchberg-saxton"])
def test_options_of_other_methods_are_refused(method: str) -> None:
    options = RunOptions(method=method)
    options.check_method(Settings())
    for settings in (Settings(loss="srgb"), Settings(free=("patterns",)), Settings(eyebox=0.1), Settings(step_rad=1.0)):
        with pytest.raises(UserError, match=f"with --method {method}"):
            options.check_method(settings)
    with pytest.raises(UserError, match="--checkpoint"):
        replace(options, checkpoint=Path("c.safetensors")).check_method(Settings())


def test_a_closed_form_has_no_iterations() -> None:
    for settings in (Settings(iterations=3), Settings(seed=1), Settings(begin="smooth")):
        with pytest.raises(UserError, match="with --method double-phase"):
            RunOptions(method="double-phase").check_method(settings)
        RunOptions(method="gerchberg-saxton").check_method(settings)


def test_an_unknown_method_is_refused() -> None:
    with pytest.raises(UserError, match="adam, double-phase, gerchberg-saxton"):
        RunOptions(method="gs").check_method(Settings())


def test_effects_that_change_the_modulators_are_refused(bench: Bench) -> None:
    system = bench(effects={"crosstalk": {"sigma": 0.5}})
    with pytest.raises(UserError, match="effects that change the modulators' light"):
        next(iter(iterate_named("double-phase", system, _stack(system), Settings())))
