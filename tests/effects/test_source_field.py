"""A complex field as the light before modulator 1, against plane waves, a Gaussian beam and another bench."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import holoview as hv
from holoview.light.colour import xyz_to_linear_srgb
from holoview.light.model.system import System
from holoview.util.errors import UserError

PITCH_M = 3e-6  # of the field: another than the simulation's 4 µm
Y, X = np.mgrid[-89:91, -89:91] * PITCH_M - PITCH_M / 2  # positions count from the field's middle


@pytest.fixture
def system() -> System:
    return hv.load("holochrome-8").with_(
        shape=[24, 32], planes=["5 mm"], wavelengths=["450 nm", "620 nm"], amplitudes=[[1.0, 1.0]]
    )


def lit_by(system: System, path: Path, values: NDArray[Any], distance: str = "0 mm") -> System:
    """The system lit by a field (y, x), or (wavelength, y, x), that a file holds."""
    stack = np.broadcast_to(values, (len(system.wavelengths_m), *values.shape[-2:])).astype(np.complex64)
    hv.load_field(stack, pitch=PITCH_M, wavelengths=list(system.wavelengths_m)).save(path)
    return system.edit({"effects.source_field.file": str(path), "effects.source_field.distance": distance})


def intensity(system: System, backend: str = "torch64") -> NDArray[Any]:
    return hv.simulate(system, hv.random_drive(system), backend=backend).intensity


def tilted(system: System, sine: float) -> NDArray[Any]:
    return np.exp(2j * np.pi * sine * X[None] / system.wavelengths_m[:, None, None])


def smooth() -> NDArray[Any]:
    """1 where the modulator is, 192 µm × 256 µm, and 0 at the edges: a band-limited field."""
    fall = [1 / (1 + np.exp((np.abs(r) - 190e-6) / 8e-6)) for r in (Y, X)]
    return fall[0] * fall[1] + 0j


def test_a_tilted_wave_is_a_tilt_of_the_source(system: System, tmp_path: Path) -> None:
    found = intensity(lit_by(system, tmp_path / "tilted.safetensors", smooth() * tilted(system, np.sin(3e-3))))
    expected = intensity(system.edit({"source.directions": [[0.0, 3e-3]]}))
    # the window falls to 1 − 3e-4 at the modulator's edge, 62 µm inside its own
    np.testing.assert_allclose(found, expected, atol=2e-3 * expected.max())


@pytest.mark.gpu
def test_both_executors_agree(system: System, tmp_path: Path) -> None:
    lit = lit_by(system, tmp_path / "field.safetensors", smooth() * np.exp(3e8j * (X**2 - Y * X)))
    reference = intensity(lit)
    # roundings of f32: 2⁻²⁴ for each of some 40 operations of the two transforms and products
    np.testing.assert_allclose(intensity(lit, "wgpu"), reference, atol=40 * 2**-24 * reference.max())


def test_it_comes_from_a_distance(system: System, tmp_path: Path) -> None:
    """A Gaussian beam of waist w is wider by √(1 + (z/z_R)²) at a distance z, with z_R = πw²/λ."""
    waist, z = 50e-6, 20e-3
    beam = np.exp(-(Y**2 + X**2) / waist**2)
    lit = lit_by(system, tmp_path / "beam.safetensors", beam, "20 mm")
    light = hv.field_at(lit, hv.random_drive(lit), stage="light", laser=1)
    λ = float(lit.wavelengths_m[1])
    width2 = waist**2 * (1 + (z * λ / (np.pi * waist**2)) ** 2)
    y, x = ((np.arange(n) - (n - 1) / 2) * light.step[0] for n in light.values.shape)
    expected = np.exp(-2 * (y[:, None] ** 2 + x[None] ** 2) / width2)
    # paraxial: the next term of the phase is π·z·λ³u⁴/4 with u = 1/(πw) at the beam's edge, 6e-8; float32 in the file
    np.testing.assert_allclose(abs(light.values) ** 2, expected / expected.mean(), rtol=1e-4, atol=1e-5)


def test_the_field_behind_another_bench_can_be_the_light(system: System, tmp_path: Path) -> None:
    one = system.with_(modulators=system.modulators[:1], gap=None)
    behind = hv.as_field(hv.Hologram(hv.random_drive(one, seed=3), one))
    behind.save(tmp_path / "behind.safetensors")
    flat = np.zeros(one.drive_shape, np.float32)
    lit = one.edit({"effects.source_field.file": str(tmp_path / "behind.safetensors")})
    found = hv.simulate(lit, flat, backend="torch64").intensity
    expected = hv.simulate(behind, backend="torch64").intensity
    np.testing.assert_allclose(found, expected, atol=1e-6 * expected.max())


def test_the_field_behind_modulators_holds_its_light(system: System, tmp_path: Path) -> None:
    lit = lit_by(system, tmp_path / "field.safetensors", smooth())
    hologram = hv.Hologram(hv.random_drive(lit), lit)
    found = hv.simulate(hv.as_field(hologram), backend="torch64").intensity
    expected = hv.simulate(hologram, backend="torch64").intensity
    np.testing.assert_allclose(found, expected, atol=1e-5 * expected.max())  # the field is complex64


def test_an_optimisation_takes_it_into_account(system: System, tmp_path: Path) -> None:
    lit = lit_by(system, tmp_path / "field.safetensors", smooth() * np.exp(3e8j * (X**2 - Y * X)))
    stack = np.full((1, 48, 64, 3), 0.2, np.float32)
    last = list(hv.iterate(lit, stack, hv.Settings(iterations=3)))[-1]
    shown = hv.simulate(last.best.system, last.best.drive, backend="torch64")
    error = xyz_to_linear_srgb(shown.xyz).clip(0, 1) - 0.2
    # 20/ln 10 dB for each part of the error, whose image is rounded in f32 in some 100 operations, to 1e-5 of white
    assert -10 * np.log10(np.mean(error**2)) == pytest.approx(last.best_psnr_db, abs=1e-3)


@pytest.mark.parametrize("fault", ["missing", "wavelength", "frames", "dark"])
def test_a_field_that_lights_nothing_is_refused(fault: str, system: System, tmp_path: Path) -> None:
    path = tmp_path / "light.safetensors"
    lit = lit_by(system, path, np.zeros((8, 8)) if fault == "dark" else smooth())
    if fault == "missing":
        path.unlink()
    if fault == "wavelength":
        lit = lit.with_(wavelengths=["450 nm", "660 nm"])
    if fault == "frames":
        hv.load_field(np.ones((2, 2, 8, 8), np.complex64), pitch="8 um", wavelengths=["450 nm", "620 nm"]).save(path)
    expected = {"missing": "no such file", "wavelength": "no light of 660 nm", "frames": "2 frames", "dark": "no light"}
    with pytest.raises(UserError, match=expected[fault]):
        intensity(lit)
