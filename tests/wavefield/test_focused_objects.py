"""In-line recordings of objects at known distances: the objects are found there, listed, or said not to be clear.

The light behind opaque discs is known in closed form: 1 minus the inverse transform of a·J₁(2πaf)/f times the transfer
function of free space, for discs of any depth as long as one doesn't shade another. The camera counts photons.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy.ndimage
import torch
from scipy.special import j1

from holoview.holograms.fields.demodulation import in_line_field
from holoview.holograms.fields.depth_sweep import Swept
from holoview.holograms.fields.focus import default_range_m, find_focus
from holoview.holograms.fields.reading import Recording
from holoview.holograms.fields.remaining_light import without_objects
from holoview.holograms.fields.wavefield import Wavefield

SIDE, PITCH_M, WAVELENGTH = 192, 2e-6, 500e-9
FINE = 2  # samples a pixel
NYQUIST_DEPTH_M = 4 * PITCH_M**2 / WAVELENGTH  # λ/NA² of NA = λ/(2·pitch), 32 µm
FAR_M = SIDE * PITCH_M**2 / WAVELENGTH  # 1.5 mm: beyond, the side of the camera limits the aperture

Disc = tuple[float, float, float, float]  # radius, y, x, distance, m


def _depth_of_focus(distance_m: float) -> float:
    return WAVELENGTH / min(WAVELENGTH / (2 * PITCH_M), SIDE * PITCH_M / (2 * distance_m)) ** 2


def _recorded(discs: list[Disc], photons: float, rng: np.random.Generator) -> np.ndarray:
    """Counts (y, x) of a camera whose window is the middle half of what is computed."""
    n, step = 2 * SIDE * FINE, PITCH_M / FINE
    f = np.fft.fftfreq(n, step)
    radial = np.hypot(f[:, None], f[None, :])
    shadow = np.zeros((n, n), complex)
    for radius, y, x, distance in discs:
        spectrum = radius * j1(2 * np.pi * radius * radial) / np.maximum(radial, 1e-9)
        spectrum[0, 0] = np.pi * radius**2
        phase = 2 * np.pi * distance / WAVELENGTH * (np.sqrt(np.maximum(1 - (WAVELENGTH * radial) ** 2, 0)) - 1)
        middle = n / 2 * step
        place = np.exp(-2j * np.pi * (f[:, None] * (y + middle) + f[None, :] * (x + middle)))
        shadow += spectrum * np.exp(1j * phase) * place
    light = np.abs(1 - np.fft.ifft2(shadow) / step**2) ** 2
    first = (n - SIDE * FINE) // 2
    cut = light[first : first + SIDE * FINE, first : first + SIDE * FINE]
    return rng.poisson(photons * cut.reshape(SIDE, FINE, SIDE, FINE).mean(axis=(1, 3)))


def _field(counts: np.ndarray, reference_radius_m: float | None = None) -> Wavefield:
    recording = Recording(
        counts[None, None].astype(np.float32),
        (PITCH_M, PITCH_M),
        np.array([WAVELENGTH]),
        0.0,
        "in-line",
        "",
        reference_radius_m=reference_radius_m,
    )
    return in_line_field(recording).field


@pytest.mark.long
@pytest.mark.parametrize("distance_m", [0.4 * FAR_M, 1.5 * FAR_M])
def test_a_large_opaque_disc_is_found_within_a_depth_of_focus(distance_m: float) -> None:
    """Its shadow is wider than the first Fresnel zone, so that no small peak stands where it is in focus."""
    rng = np.random.default_rng(1)
    radius = rng.uniform(1.4, 1.8) * np.sqrt(WAVELENGTH * distance_m)
    y, x = rng.uniform(-0.15, 0.15, 2) * SIDE * PITCH_M
    field = _field(_recorded([(radius, y, x, distance_m)], 400, rng))
    found = find_focus(field, *default_range_m(field))
    assert found.clear
    assert found.objects[0].share > 0.5
    assert abs(found.distance_m - distance_m) < _depth_of_focus(distance_m)
    assert found.objects[0].centre_m == pytest.approx((y, x), abs=radius)


@pytest.mark.long
def test_particles_at_two_depths_are_both_listed_with_their_places() -> None:
    """Those of each depth lie in one half of the picture."""
    rng = np.random.default_rng(2)
    depths = 0.3 * FAR_M, 0.7 * FAR_M
    discs = [
        (rng.uniform(1.5, 2.5) * PITCH_M, rng.uniform(-0.3, 0.3) * SIDE * PITCH_M, half * side, depth)
        for depth, half in zip(depths, (-1, 1), strict=True)
        for side in rng.uniform(0.12, 0.35, 8) * SIDE * PITCH_M
    ]
    field = _field(_recorded(discs, 2000, rng))
    found = find_focus(field, *default_range_m(field))
    listed = sorted(found.objects, key=lambda thing: thing.distance_m)
    assert len(listed) == 2
    for thing, depth, half in zip(listed, depths, (-1, 1), strict=True):
        assert abs(thing.distance_m - depth) < _depth_of_focus(depth)
        assert thing.centre_m is not None
        assert half * thing.centre_m[1] > 0.05 * SIDE * PITCH_M
    assert sum(thing.share for thing in listed) > 0.8


def test_noise_has_no_clear_focus_nor_has_a_range_without_the_object() -> None:
    rng = np.random.default_rng(3)
    field = _field(rng.poisson(300, (SIDE, SIDE)))
    assert not find_focus(field, *default_range_m(field)).clear
    distance_m = 0.5 * FAR_M
    field = _field(_recorded([(1.5 * np.sqrt(WAVELENGTH * distance_m), 0.0, 0.0, distance_m)], 1000, rng))
    assert not find_focus(field, 1.5 * distance_m, 3 * distance_m).clear


@pytest.mark.long
def test_a_point_source_moves_the_focus_by_fresnels_scaling() -> None:
    """With a point source at R from the camera, an object at z makes the fringes of an object M = R/(R − z) times as
    large in a plane wave over z·M: here these are known, and z and the place follow."""
    rng = np.random.default_rng(4)
    radius_m, equivalent_m = 5e-3, 0.6 * FAR_M
    distance_m = equivalent_m * radius_m / (radius_m + equivalent_m)
    y, x = 0.2 * SIDE * PITCH_M, -0.1 * SIDE * PITCH_M
    discs = [(2 * PITCH_M, y, x, equivalent_m), (2.5 * PITCH_M, y, x + 20 * PITCH_M, equivalent_m)]
    field = _field(_recorded(discs, 2000, rng), radius_m)
    found = find_focus(field, *default_range_m(field))
    shrunk = (radius_m - distance_m) / radius_m
    assert found.clear
    assert abs(found.distance_m - distance_m) < _depth_of_focus(equivalent_m) * shrunk**2
    assert found.objects[0].centre_m == pytest.approx((y * shrunk, (x + 10 * PITCH_M) * shrunk), abs=16 * PITCH_M)


def test_the_range_may_lie_before_the_plane() -> None:
    rng = np.random.default_rng(5)
    distance_m = 0.5 * FAR_M
    field = _field(_recorded([(2 * PITCH_M, 0.0, 0.0, distance_m)], 2000, rng))
    found = find_focus(field, -2 * distance_m, -0.4 * distance_m)
    assert found.distance_m == pytest.approx(-distance_m, abs=_depth_of_focus(distance_m))
    assert found.other_side_m["edge sparsity"] == -found.distances_m["edge sparsity"]


@pytest.mark.long
def test_objects_are_taken_out_of_a_recording_at_their_distance_alone() -> None:
    """The wave of particles is confined to them at their own distance, so that the recorded amplitude gives it, and
    little is left: 1 to 2 % in three draws. At another distance it spreads and most of it stays below the support's
    limit; of two depths the other's light is left."""
    rng = np.random.default_rng(6)
    near_m, far_m = 0.3 * FAR_M, 0.7 * FAR_M
    places = rng.uniform(-0.3, 0.3, (2, 6, 2)) * SIDE * PITCH_M
    discs = [(2 * PITCH_M, *place, z) for at, z in zip(places, (near_m, far_m), strict=True) for place in at]
    values = torch.from_numpy(_field(_recorded(discs, 1e5, rng)).values[0, 0].copy())
    swept = Swept.of(values, (PITCH_M, PITCH_M), WAVELENGTH)
    rest, left = without_objects(swept, [near_m, far_m])
    assert left < 0.05
    assert float(rest.values.abs().square().sum()) < 0.1 * float(swept.values.abs().square().sum())
    assert without_objects(swept, [near_m])[1] > 2 * left
    assert without_objects(swept, [0.5 * FAR_M])[1] > 2 * left


@pytest.mark.parametrize("finely", [False, True])
def test_light_that_is_sharper_at_another_distance_is_left(finely: bool) -> None:
    """Eight depths of focus beside them, particles are blurred over eight times their size: their parts of the picture
    stand out there, but are many times sharper at their own distance, and are no object's. At their own distance none
    is left but what the window cuts off: below 0.2 % in three draws, and 80 to 100 % at the other."""
    rng = np.random.default_rng(9)
    distance_m = 0.3 * FAR_M
    discs = [(2 * PITCH_M, *(rng.uniform(-0.35, 0.35, 2) * SIDE * PITCH_M), distance_m) for _ in range(8)]
    values = torch.from_numpy(_field(_recorded(discs, 1e5, rng)).values[0, 0].copy())
    swept = Swept.of(values, (PITCH_M, PITCH_M), WAVELENGTH)
    assert without_objects(swept, [distance_m], finely)[1] < 0.05
    assert without_objects(swept, [distance_m + 8 * _depth_of_focus(distance_m)], finely)[1] > 0.6


@pytest.mark.long
def test_how_much_is_in_focus_at_no_listed_distance_is_a_number() -> None:
    """The beam's own pattern has the power of the particles', half of all, and no focus. The particles' supports take
    some of it, and smooth parts count as beam: 34 to 37 % in three draws, where particles alone leave 0 to 1 %."""
    rng = np.random.default_rng(10)
    photons, distance_m = 2000, 0.3 * FAR_M
    discs = [(2 * PITCH_M, *(rng.uniform(-0.35, 0.35, 2) * SIDE * PITCH_M), distance_m) for _ in range(8)]
    counts = _recorded(discs, photons, rng)
    pattern = scipy.ndimage.gaussian_filter(rng.normal(size=counts.shape), 2.0)
    pattern *= np.sqrt(counts.var() - photons) / pattern.std()
    for seen, least, most in ((counts, 0.0, 0.1), (counts + pattern, 0.2, 0.55)):
        field = _field(np.maximum(seen, 0))
        found = find_focus(field, *default_range_m(field))
        assert found.distance_m == pytest.approx(distance_m, abs=_depth_of_focus(distance_m))
        assert found.unexplained is not None
        assert least <= found.unexplained < most
        assert found.is_incomplete == (seen is not counts)


@pytest.mark.long
def test_an_object_whose_depth_is_not_found_is_said() -> None:
    """A few particles among many of another depth: they are listed or said, and nothing is listed where none stand."""
    rng = np.random.default_rng(8)
    depths = 0.4 * FAR_M, 0.8 * FAR_M
    many = [
        (rng.uniform(1.5, 2.5) * PITCH_M, *(rng.uniform(-0.35, 0.35, 2) * SIDE * PITCH_M), depths[0]) for _ in range(30)
    ]
    few = [(2 * PITCH_M, *(rng.uniform(-0.3, 0.3, 2) * SIDE * PITCH_M), depths[1]) for _ in range(3)]
    field = _field(_recorded(many + few, 5000, rng))
    found = find_focus(field, *default_range_m(field))
    assert found.clear
    for thing in found.objects:
        assert min(abs(thing.distance_m - z) / _depth_of_focus(z) for z in depths) < 1
    assert len(found.objects) == 2 or found.unclear
