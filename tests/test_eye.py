"""What an eye sees, against an independent program in float64, thin lenses, and analytic optics."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

import holoview as hv
from holoview.light.engine.torch_executor import TorchExecutor, TorchField
from holoview.light.model.plan import Plan
from holoview.light.optics.frame_inputs import FrameInputs

F = 40e-3
PITCH, UPSAMPLE = 8e-6, 2
WAVELENGTHS = np.array([460e-9, 550e-9, 640e-9])


def _bench(**eye: Any) -> hv.System:
    """One modulator of 40 × 48 pixels, whose plane is at infinity; the grid is 160 × 192 samples."""
    modulator = hv.Modulator(PITCH, (40, 48), 800e-9)
    return hv.System(
        WAVELENGTHS, [[1.0, 1.0, 1.0]], (modulator,), planes_m=[2e-3], eye={"infinity": 0.0, "eyepiece": F} | eye
    )


# --- an independent program -----------------------------------------------------------------------------------------


def _spectrum(system: hv.System, drive: NDArray[Any], λ: float) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Spectrum of the padded field behind the modulator, and its spatial frequencies (y, 1) and (1, x)."""
    field = np.exp(2j * np.pi * np.kron(drive, np.ones((UPSAMPLE, UPSAMPLE))) * 800e-9 / λ)
    padded = np.zeros((160, 192), complex)
    padded[40:120, 48:144] = field
    frequencies = [np.fft.fftfreq(n, PITCH / UPSAMPLE) for n in padded.shape]
    return np.fft.fft2(padded), frequencies[0][:, None], frequencies[1][None, :]


def _refraction(λ: float) -> float:
    nm = λ * 1e9
    return 1.68524 - 633.46 / (nm - 214.102)


def _pupil(u_y: NDArray[Any], u_x: NDArray[Any], λ: float, d: float, y: float, x: float) -> NDArray[Any]:
    return np.hypot(λ * F * u_y - y, λ * F * u_x - x) <= d / 2


def _cut_out(spectrum: NDArray[Any]) -> NDArray[Any]:
    return np.abs(np.fft.ifft2(spectrum)[40:120, 48:144]) ** 2


def _relative(found: NDArray[Any], expected: NDArray[Any]) -> float:
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


@pytest.mark.parametrize(
    ("backend", "tolerance"), [("torch64", 1e-9), pytest.param("wgpu", 1e-6, marks=pytest.mark.gpu)]
)
def test_the_retinal_image_is_that_of_an_independent_program(backend: str, tolerance: float, request: Any) -> None:
    """Exact propagation to z_λ = f²·[A − (Rx(λ) − Rx(λ₀))] and a decentred pupil; 1e-6 is what f32 gives elsewhere."""
    if backend == "wgpu":
        request.getfixturevalue("device")
    d, y, x, dioptres = 1.6e-3, 0.3e-3, -0.2e-3, (1.25, 2.0)
    system = _bench(pupil=d, pupil_y=y, pupil_x=x, accommodation=dioptres)
    drive = hv.random_drive(system, seed=5)
    view = hv.simulate(system, drive, backend=backend)
    assert view.planes_m.shape == (2, 3) and view.accommodation_dpt == pytest.approx(dioptres)
    for i, A in enumerate(dioptres):
        for j, λ in enumerate(WAVELENGTHS):
            z = F**2 * (A - (_refraction(λ) - _refraction(550e-9)))
            assert view.planes_m[i, j] == pytest.approx(z, rel=1e-12)
            spectrum, u_y, u_x = _spectrum(system, drive[0, 0], λ)
            sine2 = λ**2 * (u_y**2 + u_x**2)
            assert sine2.max() < 1  # no wave is evanescent, and the band limit lies beyond the pupil
            expected = _cut_out(
                spectrum * np.exp(2j * np.pi * z / λ * np.sqrt(1 - sine2)) * _pupil(u_y, u_x, λ, d, y, x)
            )
            assert _relative(view.intensity[i, j], expected) <= tolerance


@pytest.mark.parametrize("axis", ["eyepiece", "pupil"])
def test_the_plane_that_is_seen_is_what_two_thin_lenses_image(axis: str) -> None:
    """In the back focal plane of the eyepiece lies the spectrum; a lens of the eye's power forms the image behind it.

    The lens is centred on the eyepiece's axis or on the pupil. In the latter case the picture moves as a whole by
    y·A, as a nearer object does that is seen from the side; the fixation follows it. Paraxial: the quartic phase, left
    out, is (z/λ)·s⁴/8 = 3.2 mm/460 nm·0.03⁴/8 turns = 4.4 mrad at the edge of the pupil, 2.5 mrad r.m.s.
    """
    d, y, A = 1.8e-3, 0.25e-3, 1.5
    system = _bench(pupil=d, pupil_y=y, accommodation=[A], chromatic_axis=axis)
    drive = hv.random_drive(system, seed=6)
    seen = hv.simulate(system, drive, backend="torch64").intensity[0]
    for j, λ in enumerate(WAVELENGTHS):
        spectrum, u_y, u_x = _spectrum(system, drive[0, 0], λ)
        power = A - (_refraction(λ) - _refraction(550e-9))
        behind = y if axis == "pupil" else 0.0
        lens = np.exp(-1j * np.pi / λ * power * ((λ * F * u_y - behind) ** 2 + (λ * F * u_x) ** 2))
        fixation = np.exp(-2j * np.pi * F * behind * A * u_y)
        expected = _cut_out(spectrum * lens * fixation * _pupil(u_y, u_x, λ, d, y, 0.0))
        assert _relative(seen[j], expected) <= 5e-3


# --- the image of a point -------------------------------------------------------------------------------------------


AT = 3.0  # dioptres at which the point lies


def _point(eye: dict[str, Any], defocus: float = 0.0, wavelength: int = 1) -> tuple[NDArray[Any], float]:
    """The retinal image (y, x) of a point on the axis, and the distance of its samples; `defocus` in dioptres."""
    side = 96
    modulator = hv.Modulator(PITCH, (side, side), 800e-9)
    system = _bench(**eye, accommodation=[AT + defocus]).edit({"modulators": [modulator], "propagation": "periodic"})
    plan: Plan = hv.make_plan(system)
    executor = TorchExecutor(plan, FrameInputs(plan, hv.random_drive(system)), double=True)
    y, x = (torch.from_numpy(k) for k in executor.frequencies(1))
    middle = side * UPSAMPLE // 2
    λ, step = WAVELENGTHS[wavelength], 1 / (side * PITCH)
    sine2 = (λ * step) ** 2 * (y[:, None] ** 2 + x[None, :] ** 2)
    turns = -middle / (side * UPSAMPLE) * (y[:, None] + x[None, :]) - AT * F**2 / λ * torch.sqrt(1 - sine2)
    flat = TorchField(torch.polar(torch.ones_like(turns), 2 * math.pi * turns))
    seen = executor.field(executor.transmit(flat, 1, wavelength), 1)
    return executor.download_field(seen).__abs__() ** 2, plan.grid.pitch_m


def _place(image: NDArray[Any], pitch_m: float) -> tuple[float, float]:
    """Where the light is (y, x), m: the phase of its first Fourier coefficient, in which distant rings cancel.

    A frequency's light interferes with that of the next one, with a phase of 2π·y/L on the grid of length L for light
    that travels to y: the mean over all pairs of neighbouring rays in the pupil.
    """
    coefficients = np.fft.fft2(np.fft.ifftshift(image))
    y, x = (
        -np.angle(coefficient) / (2 * np.pi) * n * pitch_m
        for coefficient, n in zip((coefficients[1, 0], coefficients[0, 1]), image.shape, strict=True)
    )
    return float(y), float(x)


def test_a_point_in_focus_is_an_airy_pattern() -> None:
    """Its first zero lies at 1.22·λ·f/d; the intensity is (2·J₁(v)/v)², v = π·d·r/(λ·f). The pupil is a disc of samples
    of frequency, 34 across: its radius is certain to half a sample at most, 3 %."""
    d = 1.5e-3
    image, pitch_m = _point({"pupil": d})
    profile = image[96, 96:]
    zero = int(np.argmax(np.diff(profile) > 0))
    assert zero * pitch_m == pytest.approx(1.22 * 550e-9 * F / d, abs=0.5 * pitch_m + 0.03 * 1.8e-5)
    v = np.pi * d * np.arange(1, 4) * pitch_m / (550e-9 * F)
    theta = np.linspace(0, np.pi, 4001)
    j1 = np.array([np.trapezoid(np.cos(theta - a * np.sin(theta)), theta) / np.pi for a in v])
    assert profile[1:4] / profile[0] == pytest.approx((2 * j1 / v) ** 2, abs=0.03)


def test_light_rises_with_the_area_of_the_pupil() -> None:
    """As the number of frequencies in a disc; Gauss's circle problem leaves it within 2·√(2π·r) of π·r²."""
    small, large = (_point({"pupil": d})[0].sum() for d in (1.2e-3, 2.4e-3))
    step = 1 / (96 * PITCH)
    radii = [d / 2 / (550e-9 * F) / step for d in (1.2e-3, 2.4e-3)]
    margin = sum(2 * math.sqrt(2 * math.pi * r) / (math.pi * r * r) for r in radii)
    assert large / small == pytest.approx(4, rel=margin)


@pytest.mark.parametrize("place_m", [-0.4e-3, 0.0, 0.3e-3])
def test_a_point_out_of_focus_moves_with_the_pupil(place_m: float) -> None:
    """By y·f·A in the plane that is seen: the mean ray through the pupil has the direction y/f over the distance f²·A.

    The mean is taken over pairs of neighbouring samples of the pupil; tangents exceed sines by 3e-4 at most.
    """
    image, pitch_m = _point({"pupil": 1e-3, "pupil_y": place_m, "chromatic": False}, defocus=1.0)
    y, x = _place(image, pitch_m)
    sample_m = 550e-9 * F / (96 * PITCH)
    rows, columns = np.meshgrid(sample_m * np.arange(-40, 41), sample_m * np.arange(-40, 41), indexing="ij")
    inside = np.hypot(rows - place_m, columns) <= 0.5e-3
    centre_m = float((rows + sample_m / 2)[:-1][inside[:-1] & inside[1:]].mean())
    assert centre_m == pytest.approx(place_m, abs=0.5 * sample_m)
    assert y == pytest.approx(centre_m * F * 1.0, rel=1e-2, abs=1e-8)  # a 400th of a sample
    assert x == pytest.approx(0.0, abs=1e-8)


def test_beside_the_axis_colours_separate_by_displacement_times_difference_of_focus() -> None:
    """Thibos et al. 1990: as an angle, the place of the pupil times the chromatic difference of refraction."""
    x_m, eye = 0.5e-3, {"pupil": 1e-3, "pupil_x": 0.5e-3}
    places = [_place(*_point(eye, wavelength=wavelength))[1] for wavelength in (0, 2)]
    difference = _refraction(640e-9) - _refraction(460e-9)
    assert (places[0] - places[1]) / F == pytest.approx(x_m * difference, abs=0.5e-6 / F)


def test_an_eye_that_moves_as_a_whole_sees_no_separation() -> None:
    eye = {"pupil": 1e-3, "pupil_x": 0.5e-3, "chromatic_axis": "pupil"}
    places = [_place(*_point(eye, 1.0, wavelength))[1] for wavelength in (0, 1, 2)]
    assert places == pytest.approx([0.5e-3 * F] * 3, abs=0.5e-6)


@pytest.mark.parametrize("axis", [0, 30, 90])
def test_a_cylinder_focuses_its_meridians_at_their_own_dioptres(axis: int) -> None:
    """Along the axis an eye with sphere S and cylinder C is focused S further away, across it S + C."""
    eye: dict[str, Any] = {"pupil": 2e-3, "chromatic": False}
    eye["prescription"] = {"sphere": 0.5, "cylinder": 1.0, "axis": axis}
    along = (math.sin(math.radians(axis)), math.cos(math.radians(axis)))
    across = (along[1], -along[0])
    for defocus, narrow, wide in ((0.5, along, across), (1.5, across, along)):
        image, pitch_m = _point(eye, defocus)
        size = [_half_width(image, direction) * pitch_m for direction in (narrow, wide)]
        assert size[0] < 0.5 * 1.22 * 550e-9 * F / 2e-3 * 1.5
        assert size[1] == pytest.approx(
            0.5 * 2e-3 * F * 1.0 / math.sqrt(3) * math.sqrt(3) / 2, rel=0.2
        )  # r.m.s. of d·f·C


def _half_width(image: NDArray[Any], direction: tuple[float, float]) -> float:
    """Root mean square extent of the brightest part (above 5 % of the peak) along a direction (y, x), samples."""
    bright = np.where(image > 0.05 * image.max(), image, 0)
    y, x = (np.arange(n) - n // 2 for n in image.shape)
    place = y[:, None] * direction[0] + x[None, :] * direction[1]
    return float(np.sqrt((bright * place**2).sum() / bright.sum()))


def test_the_stiles_crawford_effect_halves_the_exponent_for_amplitudes() -> None:
    plan = hv.make_plan(_bench(pupil="4 mm", stiles_crawford=True, pupil_x="1 mm", accommodation=[1.0]))
    pupil = FrameInputs(plan, hv.random_drive(plan.nominal)).pupils[1][1]
    assert pupil is not None
    step = 550e-9 * F * plan.grid.frequency_step[1]
    at = round(2e-3 / step)
    r_mm = (at * step - 1e-3) * 1e3
    assert float(pupil[0, at].abs()) ** 2 == pytest.approx(10 ** (-0.05 * r_mm**2), rel=1e-9)


def test_defocus_by_a_zernike_term_is_defocus_by_accommodation() -> None:
    """c₄ = D·d²/(16·√3), up to the quartic phase, Δz/λ·s⁴/8 = 1.6 mm/550 nm·0.0225⁴/8 turns = 0.6 mrad."""
    d, D = 1.8e-3, 1.0
    rms_m = -D * d**2 / (16 * math.sqrt(3))
    by_focus = _point({"pupil": d, "chromatic": False}, defocus=D)[0]
    by_term = _point({"pupil": d, "chromatic": False, "prescription": {"aberration": {"Z4": rms_m}}})[0]
    assert _relative(by_term, by_focus) <= 2e-3


def test_a_sample_is_seen_at_pitch_over_focal_length() -> None:
    view = hv.simulate(_bench(), hv.random_drive(_bench()), backend="torch")
    assert view.degrees_per_sample == pytest.approx(math.degrees(PITCH / UPSAMPLE / F), rel=1e-6)
    assert view.at([0]).accommodation_dpt == pytest.approx([2e-3 / F**2])
    plain = _bench().with_(eye=None)
    assert hv.simulate(plain, hv.random_drive(plain), backend="torch").degrees_per_sample is None
