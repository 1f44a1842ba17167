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

import holoview as hv
from holoview.holograms.optimise.driven_element import ElementLight, make_driven, transmission_of
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
    errors = _errors(system, noise(0, *system.drive_shape).float().numpy())
    assert all(after <= before * (1 + 1e-5) for before, after in pairwise(errors))
    assert system.modulators[0].levels is not None or errors[-1] < errors[0]


def _errors(system: System, start: Any, name: str = "", steps: int = 8) -> list[float]:
    """The errors of some steps in which a modulator is driven."""
    driven = make_driven(system, _stack(system), Settings(), start, "cpu", name)
    projections, errors = AlternatingProjections(driven), []
    drive = projections.start(driven.start)
    for _ in range(steps):
        drive = projections.step(drive)
        errors.append(projections.error)
    return errors


def test_where_propagation_is_unitary_a_step_is_gerchberg_and_saxtons(bench: Bench, noise: Noise) -> None:
    """One step by hand: FFT, the target's amplitude, FFT back, nearest of 256 levels."""
    system = bench(**UNITARY)
    stack = _stack(system)
    driven = make_driven(system, stack, Settings(), noise(0, *system.drive_shape).float().numpy(), "cpu", "")
    problem, projections = driven.problem, AlternatingProjections(driven)
    start = projections.start(driven.start)
    found = projections.step(start)[0].double()
    plan = make_plan(system)
    transfer = plan.transfer(1, 0)
    ky, kx = (torch.from_numpy(np.fft.fftfreq(n, 1 / n)).long() for n in plan.grid.padded)
    h = free_space_at(transfer, ky, kx, torch.complex128)
    turns = 825e-9 / 532e-9
    field = torch.fft.ifft2(h * torch.fft.fft2(torch.exp(2j * math.pi * turns * start[0].double())))
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


# --- any modulator ----------------------------------------------------------------------------------------------------

_PIXELS = {"pitch": "8 um", "shape": [12, 16]}
_WAY = {"kind": "space", "distance": "0.5 mm", "square": "first order"}
_PHASE = _PIXELS | {"kind": "phase", "stroke": "825 nm", "name": "slm"}
CHAINS: dict[str, tuple[str, list[dict[str, Any]]]] = {
    "a phase modulator before an amplitude modulator": ("slm", [_PHASE, _WAY, _PIXELS | {"kind": "amplitude"}]),
    "an amplitude modulator behind it": (
        "coarse",
        [_PHASE, _WAY, {"kind": "amplitude", "name": "coarse", "pitch": "16 um", "shape": [4, 6]}],
    ),
    "amplitudes of levels": ("bits", [_PHASE, _WAY, _PIXELS | {"kind": "amplitude", "name": "bits", "levels": 2}]),
    "a complex modulator": ("both", [_PHASE, _PIXELS | {"kind": "complex", "name": "both", "stroke": "600 nm"}]),
    "behind a lens and a mask, off the axis": (
        "slm",
        [
            {"kind": "lens", "focal_length": "20 mm"},
            {"kind": "mask", "pattern": "random", "stroke": "500 nm", **_PIXELS},
            _WAY,
            _PHASE | {"offset": ["8 um", "-16 um"]},
        ],
    ),
    "in a Fourier plane": ("slm", [_PIXELS | {"kind": "complex"}, {"kind": "fourier", "focal_length": "1 mm"}, _PHASE]),
    "a mask that frames share": ("slm", [_PIXELS | {"kind": "amplitude"}, _WAY, _PHASE | {"shared": True}]),
}


def _of_elements(elements: list[dict[str, Any]], **keys: Any) -> System:
    lasers, planes_m = [[1.0, 0.7], [0.0, 1.0]], [2e-3, 3e-3]
    return System([532e-9, 580e-9], lasers, elements=elements, planes_m=planes_m, observer="eye").with_(**keys)


@pytest.mark.parametrize("name", CHAINS)
def test_the_light_of_an_element_and_its_adjoint(name: str, noise: Noise) -> None:
    """|A p|² is what a simulation shows, and ⟨x, A p⟩ = ⟨A⁺x, p⟩; both in complex128, of some 10³ terms."""
    own, elements = CHAINS[name]
    system = _of_elements(elements)
    driven = make_driven(system, _stack(system), Settings(seed=3), hv.random_drive(system), "cpu", own)
    plan, number = driven.light.plan, driven.light.number
    light = ElementLight(plan, hv.random_drive(system), number, driven.element, driven.lasers, double=True)
    pixels = [
        transmission_of(driven.element, driven.start[driven.frame_of(f)], float(system.wavelengths_m[λ]))
        for f, λ in driven.lasers
    ]
    light.show(torch.stack(pixels))
    shape = (len(driven.lasers), 1, *plan.grid.shape)
    x = torch.polar(noise(1, *shape).double(), 6 * noise(2, *shape).double())
    fields: list[torch.Tensor] = []

    def compare(plane: int, rows: slice, at_plane: torch.Tensor) -> None:
        fields.append(at_plane.clone())
        at_plane.copy_(x.conj())

    light.process_planes([1], compare, carry_back=True)
    products = (x.conj() * fields[0]).sum(dim=(1, 2, 3))
    torch.testing.assert_close(
        (light.pixel_fields().conj() * torch.stack(pixels)).sum(dim=(1, 2)), products, rtol=1e-11, atol=1e-11
    )
    drives = hv.random_drive(system) | {own: driven.start.numpy()}
    seen = hv.simulate(system, drives, backend="torch64").intensity[1]
    weights = plan.weights
    for λ in range(2):
        total = sum(
            weights[f, λ] * fields[0][i, 0].abs().square().numpy() for i, (f, n) in enumerate(driven.lasers) if n == λ
        )
        np.testing.assert_allclose(total, seen[λ], rtol=0, atol=1e-11 * seen.max())


def test_the_first_modulator_by_derivatives_is_that_by_hand(noise: Noise) -> None:
    """A⁺x at both modulators of the short form: of a chain that is equal to it, and of the adjoint by hand."""
    gap, last = _WAY, {"kind": "space", "iris_na": 0.03}
    twins = [
        System(
            [532e-9],
            [[1.0]],
            elements=[_PHASE | {"shared": is_shared}, gap, _PHASE | {"name": "second", "shared": is_shared}, last],
            planes_m=[2e-3],
        )
        for is_shared in (False, True)
    ]
    short, chain = twins
    assert chain.is_chain and not short.is_chain
    drive = noise(0, *short.drive_shape).double()
    model = Problem(short, _stack(short), Settings(), double=True).model
    shape = (1, 1, *model.plan.grid.shape)
    x = torch.polar(noise(1, *shape).double(), 6 * noise(2, *shape).double())
    model.forward(drive * 825e-9)
    carrier = model.carrier().conj()

    def take_by_hand(plane: int, rows: slice, fields: torch.Tensor) -> None:
        fields.copy_(x[:, :, rows].conj() * carrier[rows])

    model.process_planes([0], take_by_hand, carry_back=True)
    names = ("slm", "second")
    patterns = {name: drive[:, i].numpy() for i, name in enumerate(names)}
    light = ElementLight(make_plan(chain), patterns, 0, chain.elements[0], [(0, 0)], double=True)
    light.show(transmission_of(chain.elements[0], drive[:, 0], 532e-9))
    light.process_planes([0], lambda plane, rows, fields: fields.copy_(x.conj()), carry_back=True)
    by_hand = model.pixel_fields()
    torch.testing.assert_close(light.pixel_fields(), by_hand, rtol=0, atol=1e-11 * float(by_hand.abs().max()))


@pytest.mark.parametrize("name", CHAINS)
def test_the_amplitude_error_of_an_element_never_rises(name: str) -> None:
    own, elements = CHAINS[name]
    errors = _errors(_of_elements(elements), None, own)
    assert all(after <= before * (1 + 1e-5) for before, after in pairwise(errors))
    assert errors[-1] < errors[0] or name == "amplitudes of levels"  # a step shorter than half a level changes nothing


def test_the_second_modulator_of_the_short_form_is_driven(bench: Bench, noise: Noise) -> None:
    system = bench()
    assert len(system.modulators) == 2
    start, second = noise(0, *system.drive_shape).float().numpy(), system.element_names[2]
    errors = _errors(system, start, second)
    assert all(after <= before * (1 + 1e-5) for before, after in pairwise(errors)) and errors[-1] < errors[0]
    *_, last = iterate_named("gerchberg-saxton", system, _stack(system), Settings(iterations=2), start, element=second)
    assert np.array_equal(last.best.drive[:, 0], start[:, 0])
    assert not np.array_equal(last.best.drive[:, 1], start[:, 1])


def test_double_phase_of_a_modulator_behind_an_amplitude_modulator_shows_a_smooth_picture() -> None:
    """As at its wavelength alone, behind a stop of half the order, with light of even amplitude on it."""
    pixels = {"pitch": "8 um", "shape": [48, 64]}
    stop = {"kind": "space", "iris_na": 532e-9 / (4 * 8e-6)}
    elements = [pixels | {"kind": "amplitude"}, pixels | {"kind": "phase", "stroke": "825 nm", "name": "slm"}, stop]
    system = System([532e-9], [[1.0]], elements=elements, planes_m=[2e-3], observer="mono").with_(
        propagation="periodic"
    )
    rows, columns = make_plan(system).grid.shape
    y, x = np.ogrid[:rows, :columns]
    picture = 0.2 + 0.15 * np.cos(2 * np.pi * x / columns) * np.cos(2 * np.pi * y / rows)
    stack = np.repeat(picture[None, :, :, None], 3, axis=-1).astype(np.float32)
    (state,) = iterate_named("double-phase", system, stack, Settings(), element="slm")
    assert state.psnr_db > 50
    assert state.light == pytest.approx(
        float(hv.simulate(state.best).intensity.mean() / state.best.system.amplitudes.sum()), rel=1e-3
    )


def test_what_cannot_be_driven_is_a_sentence() -> None:
    system = _of_elements(CHAINS["an amplitude modulator behind it"][1])
    for method, name, words in (
        ("double-phase", "coarse", "of kind amplitude; expected a phase modulator"),
        ("gerchberg-saxton", "space", "of kind space; expected slm, coarse"),
        ("gerchberg-saxton", "slmm", "slm, coarse"),
    ):
        with pytest.raises(UserError, match=words):
            next(iter(iterate_named(method, system, _stack(system), Settings(), element=name)))
    with pytest.raises(UserError, match="adam drives all modulators"):
        RunOptions(modulator="slm").check_method(Settings())
    leaky = system.edit({"effects": {"leakage": {"element": "coarse", "amplitude": 0.2}}})
    with pytest.raises(UserError, match="effects that change the modulators' light"):
        next(iter(iterate_named("gerchberg-saxton", leaky, _stack(leaky), Settings(), element="coarse")))


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
