"""Holograms through parts of themselves: the light of the part alone, where the whole is seen."""

from __future__ import annotations

import math

import numpy as np
import pytest

from holoview.holograms.fields.propagation import propagate_field
from holoview.holograms.fields.synthetic_aperture import SyntheticAperture, published_picture, seen_through, viewpoints
from holoview.holograms.fields.wavefield import Wavefield
from holoview.util.errors import UserError

PITCH_M, WAVELENGTH = 8e-6, 532e-9


def _field(seed: int, shape: tuple[int, int] = (60, 80), **options) -> Wavefield:
    phase = np.random.default_rng(seed).random(shape)
    values = np.exp(2j * math.pi * phase).astype(np.complex64)[None, None]
    return Wavefield(values, (PITCH_M, PITCH_M), np.array([WAVELENGTH]), **options)


# Far enough that the band doesn't end beside the rays into the window; complex64 and the fading: 1e-6 each.
@pytest.mark.parametrize(("method", "radius_m"), [("asm", None), ("fresnel", None), ("fourier", 0.3)])
def test_it_is_the_light_of_a_hologram_that_is_dark_elsewhere(method: str, radius_m: float | None) -> None:
    field = _field(1, reference_radius_m=radius_m)
    aperture = SyntheticAperture.from_samples(field, (20, 31), (7.0, -12.5))
    seen = seen_through(field, aperture, 0.25, method)
    masked = np.zeros_like(field.values)
    (row, column), (rows, columns) = aperture.first, aperture.shape
    masked[..., row : row + rows, column : column + columns] = aperture.cut(field).values
    whole = propagate_field(
        Wavefield(masked, field.pitch_m, field.wavelengths_m, reference_radius_m=radius_m), 0.25, method
    )
    assert seen.choice.window == whole.choice.window
    difference = (seen.values - whole.values).norm() / whole.values.norm()
    assert float(difference) < 1e-5


def test_degrees_are_those_from_the_image() -> None:
    field = _field(2, (600, 800))
    aperture = SyntheticAperture.from_degrees(field, -0.1, (1.0, 2.0), (0.2, -0.5))
    expected = [2 * 0.1 * math.tan(math.radians(a) / 2) / PITCH_M for a in (1.0, 2.0)]
    assert aperture.shape == tuple(round(n) for n in expected)
    at = [0.1 * math.tan(math.radians(a)) for a in (0.2, -0.5)]
    assert aperture.centre_m(field) == pytest.approx(at, abs=PITCH_M)


def test_viewpoints_go_from_edge_to_edge() -> None:
    found = viewpoints(_field(3), (20, 20), (2, 3))
    assert [a.first for a in found] == [(0, 0), (0, 30), (0, 60), (40, 0), (40, 30), (40, 60)]
    assert viewpoints(_field(3), (20, 20), (1, 1))[0].first == (20, 30)


def test_apertures_outside_are_refused() -> None:
    field = _field(4)
    for make in (
        lambda: SyntheticAperture.from_samples(field, (61, 10)),
        lambda: SyntheticAperture.from_samples(field, (10, 10), (30.0, 0.0)),
        lambda: SyntheticAperture.from_degrees(field, 0.1, (190.0, 1.0)),
        lambda: viewpoints(field, (20, 20), (0, 1)),
        lambda: published_picture(np.ones((4, 4)), percentiles=(50, 50)),
    ):
        with pytest.raises(UserError):
            make()


def test_pictures_are_clipped_at_percentiles_and_resized_by_cubic_convolution() -> None:
    ramp = np.arange(101.0)[None].repeat(16, axis=0)
    picture = published_picture(ramp, percentiles=(10, 90))
    assert picture[0, [5, 10, 50, 90, 95]].tolist() == [0, 0, 128, 255, 255]
    larger = published_picture(np.stack([ramp] * 3, axis=-1), (32, 202))
    assert larger.shape == (32, 202, 3)
    # cubic convolution reproduces a ramp inside: sample j of twice as many lies at (j + 0.5)/2 − 0.5
    inside = np.arange(10, 190)
    np.testing.assert_allclose(larger[16, inside, 0] / 255 * 100, (inside + 0.5) / 2 - 0.5, atol=0.6)
    assert published_picture(np.zeros((3, 3))).max() == 0
