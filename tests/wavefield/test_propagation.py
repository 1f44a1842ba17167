"""Fields at every distance against closed forms, against a direct sum over point sources, and against themselves."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.special import fresnel

from holoview.holograms.fields.propagation import (
    choose_method,
    farthest_by_light,
    farthest_by_spectrum,
    own_window,
    propagate_field,
)
from holoview.holograms.fields.wavefield import Wavefield
from holoview.light.optics.free_space import SampleWindow
from holoview.util.errors import UserError

WAVELENGTH = 532e-9
DISTANCES = [1e-3, -1e-3, 0.01, 0.05, -0.2, 0.5, 1.0, 2.0, -2.0]
WINDOWS = [
    SampleWindow((192, 192), (8e-6, 8e-6)),  # the field's own
    SampleWindow((100, 130), (5e-6, 11e-6), (0.1e-3, -0.15e-3)),  # another pitch, beside the axis
    SampleWindow((90, 100), (8e-6, 8e-6), (-160e-6, 136e-6)),  # whole samples beside the axis
]


def _field(values: np.ndarray, pitch_m: tuple[float, float] = (8e-6, 8e-6), **options) -> Wavefield:
    return Wavefield(np.asarray(values, np.complex64)[None, None], pitch_m, np.array([WAVELENGTH]), **options)


def _axes(window: SampleWindow) -> tuple[np.ndarray, np.ndarray]:
    return window.positions_m(0)[:, None], window.positions_m(1)[None, :]


def _gaussian(window: SampleWindow, waist_m: float, distance_m: float) -> np.ndarray:
    """A Gaussian beam with its waist at 0, without the carrier (Goodman, eq. 4-33 ff.)."""
    y, x = _axes(window)
    q = 1 + 1j * distance_m * WAVELENGTH / (math.pi * waist_m**2)
    return np.exp(-(y**2 + x**2) / (waist_m**2 * q)) / q


def _error(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


def _values(field: Wavefield, *where, **options) -> np.ndarray:
    return propagate_field(field, *where, **options).values[0, 0].numpy()


def _random_phase(seed: int, shape: tuple[int, int]) -> np.ndarray:
    return np.exp(2j * math.pi * np.random.default_rng(seed).random(shape))


def _direct_sum(values: np.ndarray, pitch_m: float, window: SampleWindow, distance_m: float) -> np.ndarray:
    """Rayleigh and Sommerfeld's first integral over point sources, without the carrier, in float64.

    h = z/r²·(1/(2πr) − i/λ)·exp(ik(r − z)) with r − z = ρ²/(r + z), which has no cancellation.
    """
    rows, columns = _axes(SampleWindow(values.shape, (pitch_m, pitch_m)))
    found = np.empty(window.shape, dtype=complex)
    for row, y in enumerate(window.positions_m(0)):
        for column, x in enumerate(window.positions_m(1)):
            squared = (y - rows) ** 2 + (x - columns) ** 2
            r = np.sqrt(squared + distance_m**2)
            phase = 2 * math.pi / WAVELENGTH * squared / (r + distance_m)
            h = distance_m / r**2 * (1 / (2 * math.pi * r) - 1j / WAVELENGTH) * np.exp(1j * phase)
            found[row, column] = (values * h).sum() * pitch_m**2
    return found


# The closed form is paraxial: the beam's divergence θ = λ/(πw) = 0.85 mrad makes a phase of k·z·θ⁴/8 = 1.6e-6 rad at
# 2 m. complex64 rounds by 6e-8 in each of about 2·log2(P) ≈ 22 additions of each of four transforms, as a random walk:
# 6e-8·√88 = 6e-7; the fading edge of the band leaves less than 1e-6. The bar is the 1e-5.


@pytest.mark.parametrize("window", WINDOWS, ids=["own", "scaled", "shifted"])
@pytest.mark.parametrize("distance_m", DISTANCES)
def test_a_gaussian_beam_arrives_to_a_hundred_thousandth_at_every_distance(
    distance_m: float, window: SampleWindow
) -> None:
    field = _field(_gaussian(WINDOWS[0], 200e-6, 0.0))
    found, expected = _values(field, distance_m, "asm", window), _gaussian(window, 200e-6, distance_m)
    assert _error(found, expected) < 1e-5
    bright = np.abs(expected) ** 2 > 1e-3 * (np.abs(expected) ** 2).max()
    assert np.abs(np.angle(found[bright] / expected[bright])).max() < 1e-3


@pytest.mark.parametrize("window", WINDOWS, ids=["own", "scaled", "shifted"])
@pytest.mark.parametrize("distance_m", [0.03, -0.2, 2.0])
def test_so_it_does_by_one_transform_where_the_first_order_is_wider_than_the_field(distance_m, window) -> None:
    field = _field(_gaussian(WINDOWS[0], 200e-6, 0.0))
    assert _error(_values(field, distance_m, "fresnel", window), _gaussian(window, 200e-6, distance_m)) < 1e-5


# Light of every direction that the samples hold, up to the hard edges of the field. At 7 mm the samples' band
# ends 5·√(λz) beyond the rays that reach the window, further away more: room for the fading, which leaves 1e-6.
@pytest.mark.parametrize("distance_m", [0.007, 0.05, 1.0])
def test_hard_edged_random_phase_equals_the_direct_sum_over_its_point_sources(distance_m: float) -> None:
    values, pitch_m = _random_phase(1, (40, 40)), 4e-6
    for window in (SampleWindow((12, 9), (13e-6, 7e-6)), SampleWindow((6, 7), (3e-6, 5e-6), (60e-6, 20e-6))):
        found = _values(_field(values, (pitch_m, pitch_m)), distance_m, "asm", window)
        assert _error(found, _direct_sum(values, pitch_m, window, distance_m)) < 1e-5


def test_a_window_far_off_axis_sees_the_direct_sum_too() -> None:
    values, pitch_m = _random_phase(2, (30, 30)), 2e-6
    window = SampleWindow((8, 8), (50e-6, 50e-6), (0.03, -0.04))  # at 14 degrees; the samples hold 7.6 along each axis
    field = _field(values, (pitch_m, pitch_m))
    found = propagate_field(field, 0.4, "asm", window)
    assert _error(found.values[0, 0].numpy(), _direct_sum(values, pitch_m, window, 0.4)) < 1e-5


def test_no_light_arrives_beyond_the_first_order() -> None:
    field = _field(_random_phase(3, (30, 30)), (8e-6, 8e-6))
    assert np.abs(_values(field, 0.4, "asm", SampleWindow((8, 8), (50e-6, 50e-6), (0.0, 0.1)))).max() == 0


# Samples are points here and the slit is continuous: a sample stands for light of local frequency s as sinc(dx·s), with
# s ≤ D/(λz) and D the farthest way sideways. The error is at most (π·dx·s)²/6.
@pytest.mark.parametrize(("method", "distance_m"), [("asm", 0.02), ("asm", 0.3), ("fresnel", 0.3)])
def test_a_slit_shows_fresnels_integrals(method: str, distance_m: float) -> None:
    pitch_m, width_m = 1e-6, 160e-6
    window = SampleWindow((1, 101), (pitch_m, 4e-6))
    slit = np.zeros((160, 256))
    slit[:, 48:208] = 1.0
    found = _values(_field(slit, (pitch_m, pitch_m)), distance_m, method, window)
    scale = math.sqrt(2 / (WAVELENGTH * distance_m))

    def integral(x: np.ndarray) -> np.ndarray:
        high, low = fresnel(scale * (width_m / 2 - x)), fresnel(scale * (-width_m / 2 - x))
        return ((high[1] - low[1]) + 1j * (high[0] - low[0])) / math.sqrt(2)

    y, x = _axes(window)
    expected = integral(y) * integral(x) * -1j
    local = (80e-6 + 200e-6) / (WAVELENGTH * distance_m)
    paraxial = 2 * math.pi / WAVELENGTH * (280e-6) ** 4 / (8 * distance_m**3)
    assert _error(found, expected) < (math.pi * pitch_m * local) ** 2 / 6 + paraxial + 1e-5


def test_light_comes_back_from_where_it_went() -> None:
    rng = np.random.default_rng(4)
    smooth = np.exp(-(_axes(WINDOWS[0])[0] ** 2 + _axes(WINDOWS[0])[1] ** 2) / 0.2e-3**2)
    tilt = rng.uniform(-2e4, 2e4, size=2)  # 1/m
    field = _field(smooth * np.exp(2j * math.pi * (tilt[0] * _axes(WINDOWS[0])[0] + tilt[1] * _axes(WINDOWS[0])[1])))
    there = _values(field, 0.01, "asm")
    assert _error(_values(_field(there), -0.01, "asm"), field.values[0, 0]) < 1e-5
    assert _error(_values(field, 0.0), field.values[0, 0]) < 1e-6


@pytest.mark.parametrize(("method", "distance_m"), [("asm", 0.004), ("asm", 0.5), ("fresnel", 0.5), ("fourier", 0.5)])
def test_gradients_are_the_adjoint(method: str, distance_m: float) -> None:
    rng = np.random.default_rng(5)
    field, window = _field(np.ones((18, 20))), SampleWindow((9, 14), (6e-6, 9e-6), (20e-6, 0.0))
    u, v = (
        torch.from_numpy(rng.normal(size=(1, 1, *s)) + 1j * rng.normal(size=(1, 1, *s))) for s in ((18, 20), (9, 14))
    )
    u.requires_grad_()
    seen = propagate_field(field, distance_m, method, window, values=u).values
    product = (seen.conj() * v).sum()
    product.real.backward()
    assert u.grad is not None
    assert complex((u.detach().conj() * u.grad).sum()).real == pytest.approx(product.real.item(), rel=1e-12)


# --- tilted windows ---------------------------------------------------------------------------------------------------


def _tilted_points(window: SampleWindow, distance_m: float) -> np.ndarray:
    """Positions (rows, columns, 3) of x, y, z, by turning the window about y by β, then about its own x axis by α."""
    (alpha, beta), (y, x) = window.tilt_rad, window.centre_m
    along_x = np.array([math.cos(beta), 0.0, math.sin(beta)])
    normal = np.array([-math.sin(beta), 0.0, math.cos(beta)])
    along_y = math.cos(alpha) * np.array([0.0, 1.0, 0.0]) + math.sin(alpha) * normal
    rows, columns = ((np.arange(n) - (n - 1) / 2) * p for n, p in zip(window.shape, window.pitch_m, strict=True))
    return np.array([x, y, distance_m]) + rows[:, None, None] * along_y + columns[None, :, None] * along_x


@pytest.mark.parametrize("distance_m", [0.05, -0.05])
@pytest.mark.parametrize("tilt_rad", [(0.0, 0.3), (-0.5, 0.0), (0.4, -0.6)], ids=str)
def test_a_tilted_window_sees_the_direct_sum_at_its_own_points(tilt_rad, distance_m: float) -> None:
    values, pitch_m = _random_phase(6, (40, 40)), 4e-6
    window = SampleWindow((7, 9), (20e-6, 15e-6), (50e-6, -80e-6), tilt_rad)
    found = _values(_field(values, (pitch_m, pitch_m)), distance_m, "auto", window)
    at = (np.arange(40) - 19.5) * pitch_m
    expected = np.empty(window.shape, complex)
    sources = values if distance_m > 0 else np.conj(values)  # the way back is the conjugate of the conjugate's way on
    for index in np.ndindex(*window.shape):
        x, y, z = _tilted_points(window, distance_m)[index]
        squared = (x - at[None, :]) ** 2 + (y - at[:, None]) ** 2
        r = np.sqrt(squared + z * z)
        path = squared / (r + abs(z)) + abs(z) - abs(distance_m)
        h = abs(z) / r**2 * (1 / (2 * math.pi * r) - 1j / WAVELENGTH) * np.exp(2j * math.pi * (path / WAVELENGTH % 1))
        expected[index] = (sources * h).sum() * pitch_m**2
    assert _error(found, expected if distance_m > 0 else np.conj(expected)) < 1e-5


def test_the_gradient_of_a_tilted_window_is_its_adjoint() -> None:
    rng = np.random.default_rng(7)
    window = SampleWindow((6, 5), (30e-6, 20e-6), tilt_rad=(0.2, 0.3))
    u, v = (
        torch.from_numpy(rng.normal(size=(1, 1, *s)) + 1j * rng.normal(size=(1, 1, *s))) for s in ((18, 20), (6, 5))
    )
    u.requires_grad_()
    product = (propagate_field(_field(np.ones((18, 20))), 0.03, "asm", window, values=u).values.conj() * v).sum()
    product.real.backward()
    assert u.grad is not None
    assert complex((u.detach().conj() * u.grad).sum()).real == pytest.approx(product.real.item(), rel=1e-12)


@pytest.mark.parametrize(
    ("window", "distance_m", "method"),
    [
        (SampleWindow((64, 64), (1e-3, 1e-3), tilt_rad=(0.0, 0.5)), 0.01, "auto"),  # reaches the plane of the field
        (SampleWindow((8, 8), (8e-6, 8e-6), tilt_rad=(0.0, 1.56)), 0.01, "auto"),  # light grazes it
        (SampleWindow((8, 8), (8e-6, 8e-6), tilt_rad=(0.0, 0.5)), 0.2, "fresnel"),
    ],
    ids=["too near", "grazed", "fresnel"],
)
def test_impossible_tilts_are_refused(window: SampleWindow, distance_m: float, method: str) -> None:
    with pytest.raises(UserError) as error:
        propagate_field(_field(np.ones((64, 64))), distance_m, method, window)
    assert error.value.where == "window"


# --- spherical reference ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("distance_m", "method"),
    [(0.5, "fourier"), (0.45, "fourier"), (0.6, "fourier"), (0.0, "asm"), (0.02, "asm"), (-0.02, "asm")],
)
def test_a_spherical_reference_is_a_lens(distance_m: float, method: str) -> None:
    """A Gaussian beam through a lens of focal length R: its complex parameter obeys 1/q' = 1/q − 1/R."""
    radius_m, waist_m = 0.5, 200e-6
    field = _field(_gaussian(WINDOWS[0], waist_m, 0.0), reference_radius_m=radius_m)
    seen = propagate_field(field, distance_m)
    assert seen.choice.method == method
    y, x = _axes(seen.choice.window)
    q = 1 / (1 / (-1j * math.pi * waist_m**2 / WAVELENGTH) - 1 / radius_m)
    expected = np.exp(1j * math.pi * (y**2 + x**2) / (WAVELENGTH * (q + distance_m))) / (1 + distance_m / q)
    assert _error(seen.values[0, 0].numpy(), expected) < 1e-5


def test_several_colours_share_a_window() -> None:
    values = np.stack([_gaussian(WINDOWS[0], 200e-6, 0.0)] * 2).astype(np.complex64)[None]
    field = Wavefield(values, (8e-6, 8e-6), np.array([640e-9, 473e-9]))
    seen = propagate_field(field, 0.3, "fresnel")
    assert seen.choice.window.pitch_m[0] == pytest.approx(473e-9 * 0.3 / (192 * 8e-6))
    width = [float((i * torch.arange(192).sub(95.5).square()).sum() / i.sum()) for i in seen.intensity]
    spot = [(200e-6 / 2) ** 2 + (λ * 0.3 / (2 * math.pi * 200e-6)) ** 2 for λ in field.wavelengths_m]
    assert width[0] / width[1] == pytest.approx(spot[0] / spot[1], rel=1e-3)


# --- what is chosen, and what is refused ------------------------------------------------------------------------------


def test_the_method_follows_from_the_samples() -> None:
    field = _field(_random_phase(5, (100, 120)))
    limit_m = farthest_by_spectrum(field)
    assert limit_m == pytest.approx(2 * 100 * 64e-12 / WAVELENGTH)
    assert choose_method(field, limit_m).method == choose_method(field, -limit_m).method == "asm"
    beyond = choose_method(field, -1.2 * limit_m)
    assert beyond.method == "fresnel"
    assert "outside the field's own window" in beyond.reason
    assert choose_method(field, 10 * limit_m, window=own_window(field)).method == "asm"


@pytest.mark.parametrize(
    ("distance_m", "method", "radius_m"),
    [
        (0.1, "nearest", None),
        (1e-3, "fresnel", None),
        (0.0, "fresnel", None),
        (0.4, "asm", 0.3),
        (1e-3, "fourier", 0.3),
    ],
)
def test_what_would_alias_or_is_unknown_is_refused(distance_m: float, method: str, radius_m: float | None) -> None:
    with pytest.raises(UserError) as error:
        propagate_field(_field(np.ones((64, 64)), reference_radius_m=radius_m), distance_m, method)
    assert error.value.where == "propagation"


def test_values_of_another_shape_are_refused() -> None:
    with pytest.raises(UserError):
        propagate_field(_field(np.ones((64, 64))), 0.1, values=torch.ones(64, 64, dtype=torch.complex64))


def test_light_that_fills_little_of_the_band_keeps_the_field_s_own_window() -> None:
    """A Gaussian of waist w has 99 % of its power within f = 2.576/(2πw) along an axis."""
    shape, waist_m, wavelength_m = (128, 128), 100e-6, 532e-9
    window = SampleWindow(shape, (8e-6, 8e-6))
    field = _field(_gaussian(window, waist_m, 0.0))
    expected_m = 128 * 8e-6 / (wavelength_m * 2.576 / (2 * math.pi * waist_m))
    step = 1 / (128 * 8e-6)
    slack = step / (2.576 / (2 * math.pi * waist_m))  # the band is known to a frequency step
    assert abs(farthest_by_light(field) / expected_m - 1) < 1.5 * slack
    assert farthest_by_spectrum(field) < 0.3 < farthest_by_light(field)
    assert choose_method(field, 0.3).method == "asm"
    assert choose_method(field, 2 * farthest_by_light(field)).method == "fresnel"


def test_light_that_fills_the_band_is_shown_by_one_transform_beyond_its_limit() -> None:
    field = _field(_random_phase(3, (64, 64)))
    limit_m = farthest_by_spectrum(field)
    assert farthest_by_light(field) == pytest.approx(limit_m, rel=0.15)  # f99 of a flat band, and its scatter
    assert choose_method(field, 1.2 * limit_m).method == "fresnel"
