"""A field in place of modulators: its light at planes before and behind it, in both executors and in closed form."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import holoview as hv
from holoview.bench.captures.virtual_measurement import make_captures
from holoview.holograms.fields.field_bench import MEAN_LUMINANCE, bench_of_field
from holoview.holograms.fields.reading import ReadRequest
from holoview.holograms.fields.wavefield import Wavefield
from holoview.holograms.load_field import open_hologram
from holoview.light.engine.torch_executor import TorchExecutor
from holoview.light.model import preset
from holoview.light.model.plan import make_plan
from holoview.light.optics.frame_inputs import FrameInputs
from holoview.util.errors import UserError

PITCH_M, λ = 8e-6, 532e-9
WAIST_M = 0.3e-3


def _grid(rows: int, columns: int) -> tuple[NDArray[Any], NDArray[Any]]:
    y, x = ((np.arange(n) - (n - 1) / 2) * PITCH_M for n in (rows, columns))
    return y[:, None], x[None, :]


def _beam(z_m: float, shape: tuple[int, int] = (256, 320)) -> NDArray[np.complex128]:
    """A Gaussian beam without its carrier (Saleh & Teich, Fundamentals of Photonics, eq. 3.1-7), waist at z = 0."""
    y, x = _grid(*shape)
    q = 1 + 1j * z_m * λ / (np.pi * WAIST_M**2)
    return np.exp(-(x**2 + y**2) / (WAIST_M**2 * q)) / q


def _at(system: hv.System, drive: NDArray[Any], plane_m: float) -> NDArray[Any]:
    """The complex field at a plane, complex128."""
    plan = make_plan(system, [plane_m])
    executor = TorchExecutor(plan, FrameInputs(plan, drive), double=True)
    behind = executor.modulate(executor.illuminate(0, 0), 0, 0, 0)
    spectrum = executor.transmit(executor.spectrum(behind, 0), 1, 0)
    return executor.download_field(executor.field(spectrum, 1))


@pytest.mark.parametrize("plane_m", [-0.4, -0.05, 0.0, 1e-3, 0.05, 0.4])
def test_a_gaussian_beam_spreads_and_bends_as_in_closed_form_on_both_sides(plane_m: float) -> None:
    """The window is 2 mm high: its edge cuts the beam at exp(−3.4²) = 1e-5 of the amplitude, which diffracts.

    The closed form is paraxial: the next term of the phase, π·z·λ³u⁴/4 at λu = 3·λ/(π·w), is 1e-6 rad.
    """
    field = hv.load_field(_beam(0.0), pitch=PITCH_M, wavelengths=[λ])
    found = _at(field.system, field.drive, plane_m)
    assert np.abs(found - _beam(plane_m)).max() <= 1e-4 * np.abs(_beam(plane_m)).max()


@pytest.mark.parametrize("factors", [(2, 1), (1, 3)])
def test_samples_of_two_pitches_are_those_of_the_smaller_one(factors: tuple[int, int], tmp_path: Path) -> None:
    """A beam that each pitch samples finely is known between them: at offsets of a half or a third of the larger."""
    fine, coarse = _beam(0.0, (240, 240)), (PITCH_M * factors[0], PITCH_M * factors[1])
    y, x = ((np.arange(240 // f) - (240 // f - 1) / 2) * p for f, p in zip(factors, coarse, strict=True))
    values = np.exp(-(y[:, None] ** 2 + x**2) / WAIST_M**2) + 0j
    field = hv.load_field(values, pitch=coarse, wavelengths=[λ], distance="5 cm")
    assert field.system.modulators[0].pitch_m == PITCH_M and field.drive.shape == (1, 1, 240, 240)
    # the beam has fallen to exp(−(0.96/0.3)²) = 4e-5 where its window ends, which rings; its file is complex64
    assert np.abs(field.drive[0, 0] - fine).max() < 1e-4
    np.save(tmp_path / "field.npy", values)
    request = ReadRequest(coarse, (λ,), 0.05)
    opened = open_hologram([tmp_path / "field.npy"], request)
    np.testing.assert_allclose(opened.hologram.drive, field.drive, atol=1e-6)
    assert any("was resampled to 8 um" in note for note in opened.notes) and opened.moved_m == 0.0


def test_a_plane_wave_that_fills_whole_periods_keeps_its_direction_before_and_behind() -> None:
    """Periodic, with a whole number of periods in the window: only its phase changes, by −2π·z/λ·(1 − √(1 − s²))."""
    shape, k = (64, 128), 9
    _, x = _grid(*shape)
    sine = k * λ / (shape[1] * PITCH_M)
    wave = np.broadcast_to(np.exp(2j * np.pi * sine * x / λ), shape)
    field = hv.load_field(wave.copy(), pitch=PITCH_M, wavelengths=[λ])
    for plane_m in (-1.5, -0.02, 0.3, 2.0):
        found = _at(field.system.with_(propagation="periodic"), field.drive, plane_m)
        turns = -plane_m / λ * (1 - np.sqrt(1 - sine**2))
        # the samples are complex64: 6e-8 of each
        assert np.abs(found / wave * np.exp(-2j * np.pi * turns) - 1).max() < 1e-6


def test_light_that_goes_back_is_the_conjugate_of_light_that_goes_on() -> None:
    """u(−z) of a field U is the conjugate of u(z) of U*: free space without loss is reversible."""
    rng = np.random.default_rng(3)
    values = (rng.normal(size=(1, 1, 48, 64)) + 1j * rng.normal(size=(1, 1, 48, 64))).astype(np.complex64)
    system = hv.load_field(values, pitch=PITCH_M, wavelengths=[λ]).system
    back, on = _at(system, values, -0.03), _at(system, values.conj(), 0.03)
    # complex128: roundings of 1e-16 in sums of 1e4 terms
    np.testing.assert_allclose(back, on.conj(), atol=1e-11)


@pytest.mark.gpu
@pytest.mark.parametrize("plane", ["-2 m", "-200 mm", "-1 mm", "0 mm", "20 mm", "500 mm", "2 m"])
def test_shaders_see_what_torch_sees_in_double_precision_from_minus_2_to_2_metres(plane: str) -> None:
    rng = np.random.default_rng(1)
    shape = (2, 2, 250, 384)
    values = (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)
    field = hv.load_field(values, pitch="8 um", wavelengths=["638 nm", "460 nm"])
    exact, shaders = (hv.simulate(field, planes=[plane], backend=b).intensity for b in ("torch64", "wgpu"))
    for found, expected in zip(shaders[0], exact[0], strict=True):
        # as for modulators (tests/parity/test_frame.py): 4e-7 to 1.05e-6 of the L2 norm were seen
        assert np.linalg.norm(found - expected) <= 2e-6 * np.linalg.norm(expected)


def test_each_wavelength_and_frame_has_its_own_field() -> None:
    values = np.zeros((2, 2, 16, 16), np.complex64)
    values[0, 0], values[1, 1] = 2.0, 3j
    field = hv.load_field(values, pitch="8 um", wavelengths=["640 nm", "532 nm"])
    view = hv.simulate(field.system.with_(amplitudes=[[1.0, 1.0]] * 2), field.drive, planes=[0.0], backend="torch")
    # the mean over two frames of |u|²
    np.testing.assert_allclose(view.intensity[0].mean(axis=(1, 2)), [2.0, 4.5], rtol=1e-5)


@pytest.mark.parametrize("scale", [1e-4, 1.0, 3e3])
@pytest.mark.parametrize("nm", [[532], [640, 532, 473]])
def test_a_field_in_any_unit_has_the_same_mean_luminance(scale: float, nm: list[int]) -> None:
    values = np.full((1, len(nm), 8, 8), scale, np.complex64)
    field = hv.load_field(values, pitch="8 um", wavelengths=[f"{n} nm" for n in nm])
    view = hv.simulate(field, planes=[0.0], backend="torch")
    assert view.xyz[..., 1].mean() == pytest.approx(MEAN_LUMINANCE, rel=1e-4)


def test_light_that_no_eye_sees_is_shown_in_grey() -> None:
    field = Wavefield(np.ones((1, 1, 8, 8), np.complex64), (PITCH_M, PITCH_M), np.array([1064e-9]))
    assert bench_of_field(field).observer == "mono"


def test_a_spherical_wave_focuses_the_field_of_a_fourier_hologram() -> None:
    """Lit by a wave of radius R, an even field comes to a point at R: all of it in phase, N² samples' amplitudes."""
    even = Wavefield(np.ones((1, 1, 64, 64), np.complex64), (PITCH_M, PITCH_M), np.array([λ]), 0.1, 0.1)
    hologram = hv.Hologram.of_field(even)
    found = np.abs(_at(hologram.system, hologram.drive, 0.1))
    assert found.argmax() // 64 in (31, 32) and found.argmax() % 64 in (31, 32)
    # on the axis |u| = (N·dx)²/(λz) (Goodman, eq. 4-17), the sampled window's edge apart
    assert found.max() == pytest.approx((64 * PITCH_M) ** 2 / (λ * 0.1), rel=0.05)


# --- what is refused ------------------------------------------------------------------------------------------------


def _field_system(**changes: Any) -> hv.System:
    return hv.load_field(np.ones((8, 8), np.complex64), pitch="8 um", wavelengths=["532 nm"]).system.with_(**changes)


@pytest.mark.parametrize(
    ("changes", "where", "words"),
    [
        ({"upsample": 2}, "sampling.upsample", "known at points"),
        ({"planes": ["3 m"]}, "planes[0]", "-2000 mm and 2000 mm"),
        ({"stroke": "800 nm"}, "modulators.0.stroke", "a field"),
        (
            {"modulators": [{"pitch": "8 um", "shape": [8, 8], "content": "field"}] * 2, "gap": 0.0},
            "modulators",
            "alone",
        ),
    ],
)
def test_a_bench_of_a_field_has_no_pixels(changes: dict[str, Any], where: str, words: str) -> None:
    with pytest.raises(UserError, match=words) as caught:
        _field_system(**changes)
    assert caught.value.where == where


def test_what_needs_patterns_refuses_a_field() -> None:
    with pytest.raises(UserError, match="modulators: a field"):
        next(iter(hv.iterate(_field_system(), np.ones((1, 8, 8, 3), np.float32))))
    with pytest.raises(UserError, match="modulators: a field"):
        make_captures(_field_system())


def test_effects_on_a_modulator_are_refused() -> None:
    with pytest.raises(UserError, match=r"crosstalk.*a field has none"):
        _field_system().edit({"effects.crosstalk.sigma": 0.4})


@pytest.mark.parametrize(
    ("source", "options", "words"),
    [
        (np.ones((8, 8)), {"pitch": "8 um", "wavelengths": "532 nm"}, "complex"),
        (np.ones(8, np.complex64), {"pitch": "8 um", "wavelengths": "532 nm"}, "shape"),
        (np.ones((8, 8), np.complex64), {"pitch": "8 um"}, "wavelengths"),
        (np.ones((8, 8192), np.complex64), {"pitch": ("2 um", "8 um"), "wavelengths": "532 nm"}, "at most 16384"),
        (np.ones((2, 8, 8), np.complex64), {"pitch": "8 um", "wavelengths": "532 nm"}, "2, as many"),
        (np.full((8, 8), np.nan, np.complex64), {"pitch": "8 um", "wavelengths": "532 nm"}, "finite"),
    ],
)
def test_an_array_that_is_no_field_is_refused(source: NDArray[Any], options: dict[str, Any], words: str) -> None:
    with pytest.raises(UserError, match=words):
        hv.load_field(source, **options)


def test_the_callers_array_stays_his_own() -> None:
    values = np.ones((1, 1, 8, 8), np.complex64)
    hv.load_field(values, pitch="8 um", wavelengths=["532 nm"])
    values[0, 0, 0, 0] = 2  # still writeable


# --- files ----------------------------------------------------------------------------------------------------------


def test_a_field_survives_its_file_with_its_bench(tmp_path: Any) -> None:
    values = np.exp(2j * np.pi * np.random.default_rng(0).random((1, 2, 6, 8))).astype(np.complex64)
    field = hv.load_field(values, pitch="3.74 um", wavelengths=["639 nm", "473 nm"], distance="-12.5 cm")
    seen = hv.Hologram(field.drive, field.system.edit({"relay2.iris_na": 0.02, "eye": {"infinity": "0 mm"}}))
    seen.save(tmp_path / "field.safetensors")
    again = hv.load_field(tmp_path / "field.safetensors")
    assert again.system == seen.system
    np.testing.assert_array_equal(again.drive, values)


def test_the_bench_of_a_field_survives_toml() -> None:
    system = _field_system(planes=["-5 mm", "5 mm"])
    assert preset.loads(preset.dumps(system)) == system
