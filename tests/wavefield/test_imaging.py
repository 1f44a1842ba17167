"""An image in four pieces at the corners is recognised, near and far, and the note that the remedy needs works."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import holoview as hv
from holoview.holograms.fields.imaging import image_field
from holoview.holograms.fields.reading import ReadRequest
from holoview.holograms.fields.wavefield import without_checkerboard
from holoview.holograms.load_field import open_hologram

PITCH_M, λ = 8e-6, 532e-9
SHAPE = (200, 256)


def _hologram(distance_m: float, seed: int) -> NDArray[np.complex64]:
    """The hologram of a diffuse square in the middle of the plane at a distance: its light, propagated back by FFT."""
    if distance_m > 0.4:  # a far image: one Fresnel transform, whose square fills 0.4 of the first order
        window = np.zeros(SHAPE, complex)
        window[60:140, 80:176] = np.exp(2j * np.pi * np.random.default_rng(seed).random((80, 96)))
        y, x = (np.arange(n) - n // 2 for n in SHAPE)
        chirp = np.exp(-1j * np.pi * PITCH_M**2 * (y[:, None] ** 2 + x**2) / (λ * distance_m))
        return (np.fft.ifftshift(np.fft.ifft2(np.fft.ifftshift(window))) * chirp).astype(np.complex64)
    spectrum = np.fft.fft2(np.exp(2j * np.pi * np.random.default_rng(seed).random(SHAPE)))
    fy, fx = np.meshgrid(*(np.fft.fftfreq(n) for n in SHAPE), indexing="ij")
    return np.fft.ifft2(spectrum * (np.hypot(fy, fx) < 0.2)).astype(np.complex64)


@pytest.mark.parametrize("distance_m", [0.01, 1.5])
def test_an_image_in_four_corners_is_recognised_and_mended(distance_m: float, tmp_path: Path) -> None:
    values = _hologram(distance_m, seed=1)
    request = ReadRequest((PITCH_M, PITCH_M), (λ,), distance_m)
    np.save(tmp_path / "right.npy", values)
    right = open_hologram([tmp_path / "right.npy"], request)
    assert bool(right.moved_m) == (distance_m > 1)
    assert not [note for note in right.notes if "corners" in note]
    np.save(tmp_path / "corners.npy", without_checkerboard(values))
    wrong = open_hologram([tmp_path / "corners.npy"], request)
    assert [note for note in wrong.notes if "checkerboard=false" in note]
    np.testing.assert_array_equal(wrong.hologram.drive, right.hologram.drive)
    for stated in (True, False):
        (tmp_path / "corners.npy.holoview.toml").write_text(f"checkerboard = {str(stated).lower()}\n")
        opened = open_hologram([tmp_path / "corners.npy"], request)
        assert not [note for note in opened.notes if "corners" in note]
        assert np.array_equal(opened.hologram.drive, right.hologram.drive) == stated


def test_a_double_phase_pattern_keeps_its_alternating_phases(tmp_path: Path) -> None:
    """Of a small bright square before a dim ground: more than nine tenths of the light go to the corners.

    φ ± acos(a) in turn is exp(iφ)·(a ± i·√(1 − a²)): the image's own light stands around the middle of the spectrum.
    """
    seen = np.full(SHAPE, 0.05, complex)
    seen[80:120, 108:148] = 1
    spectrum, frequencies = np.fft.fft2(seen), [np.fft.fftfreq(n, PITCH_M) for n in SHAPE]
    cosine = np.sqrt(1 - (λ * frequencies[0][:, None]) ** 2 - (λ * frequencies[1]) ** 2)
    field = np.fft.ifft2(spectrum * np.exp(-2j * np.pi * 0.02 / λ * cosine))
    turn = np.arccos(np.abs(field) / np.abs(field).max()) * (1 - 2 * (np.indices(SHAPE).sum(axis=0) % 2))
    pattern = ((np.angle(field) + turn) % (2 * np.pi)).astype(np.float32)
    np.save(tmp_path / "pattern.npy", pattern)
    opened = open_hologram([tmp_path / "pattern.npy"], ReadRequest((PITCH_M, PITCH_M), (λ,), 0.02))
    assert [note for note in opened.notes if "checkerboard=true" in note]
    np.testing.assert_allclose(opened.hologram.field().values[0, 0], np.exp(1j * pattern), atol=1e-5)


def test_light_that_fills_the_band_says_nothing(tmp_path: Path) -> None:
    """Random phases: each balance has a standard deviation of √(1/2/n) = 3e-3 for n samples, 80 times below −0.25."""
    values = np.exp(2j * np.pi * np.random.default_rng(0).random(SHAPE)).astype(np.complex64)
    np.save(tmp_path / "random.npy", values)
    opened = open_hologram([tmp_path / "random.npy"], ReadRequest((PITCH_M, PITCH_M), (λ,), 0.02))
    assert not [note for note in opened.notes if "corners" in note]


def test_an_image_beside_the_window_is_seen_in_that_of_one_transform() -> None:
    """A grating sends light to λz/period beside the axis, here outside the field's own 1.6 mm × 2.0 mm."""
    distance_m, period = 1.0, 4
    y, x = (np.arange(n) - (n - 1) / 2 for n in SHAPE)
    lens = np.exp(-1j * np.pi * PITCH_M**2 * (y[:, None] ** 2 + x**2) / (λ * distance_m))
    grating = np.exp(2j * np.pi * x / period)
    field = hv.load_field((lens * grating).astype(np.complex64), pitch=PITCH_M, wavelengths=[λ], distance=distance_m)
    imaged = image_field(field.field(), "auto")
    seen, note = imaged.field, imaged.note
    power = np.square(np.abs(seen.values[0, 0]))
    row, column = np.unravel_index(power.argmax(), power.shape)
    place = [(at - (n - 1) / 2) * seen.pitch_m[0] for at, n in zip((row, column), power.shape, strict=True)]
    assert "Fresnel" in note
    assert place == pytest.approx([0.0, λ * distance_m / (period * PITCH_M)], abs=2 * seen.pitch_m[0])
