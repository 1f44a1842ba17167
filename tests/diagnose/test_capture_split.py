"""Captures are fitted or judged, never both; searches begin with the smoothest of each wavelength."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from holoview.bench.captures.dataset import Captures
from holoview.bench.diagnose.capture_split import split_captures

Make = Callable[..., Captures]


@pytest.mark.parametrize("count", [2, 3, 4, 6, 12, 32, 100])
@pytest.mark.parametrize("wavelengths", [1, 2, 4, 10])
@pytest.mark.parametrize("planes", [1, 3, 100])
def test_no_capture_is_fitted_and_judged(make_captures: Make, count: int, wavelengths: int, planes: int) -> None:
    lasers, distances = np.linspace(450e-9, 640e-9, wavelengths), np.linspace(3e-3, 5e-3, planes)
    captures = make_captures(count, wavelength_m=np.resize(lasers, count), distance_m=np.resize(distances, count))
    found = split_captures(captures, np.random.default_rng(count).uniform(size=count))
    assert len(found.coarse) and len(found.fine) and len(found.held_out)
    assert not set(found.held_out) & (set(found.rough) | set(found.fine) | set(found.coarse))
    assert len(found.coarse) <= 6 and len(found.fine) <= 12 and len(found.rough) <= 18 and len(found.held_out) <= 16


def test_the_smoothest_of_each_wavelength_come_first(make_captures: Make) -> None:
    captures = make_captures(16)
    rough = np.random.default_rng(1).permutation(16).astype(float)
    found = split_captures(captures, rough)
    for wavelength in captures.wavelengths_m:
        own = np.flatnonzero(captures.wavelength_m == wavelength)
        assert own[rough[own].argmin()] in found.coarse
        assert np.count_nonzero(captures.wavelength_m[found.held_out] == wavelength) == 2
        unseen = [k for k in own if k not in found.held_out]
        assert unseen[int(rough[unseen].argmax())] in found.rough


def test_every_plane_is_fitted_and_judged(make_captures: Make) -> None:
    captures = make_captures(32, distance_m=np.resize(np.repeat([3e-3, 5e-3], 2), 32))
    found = split_captures(captures, np.random.default_rng(2).uniform(size=32))
    for indices in (found.fine, found.held_out):
        assert set(captures.distance_m[indices]) == {3e-3, 5e-3}


@pytest.mark.parametrize(("pictures", "expected"), [(100, (2, 4, 6, 4)), (5, (2, 4, 5, 4)), (1, (2, 2, 2, 2))])
def test_of_large_pictures_each_set_has_as_many_as_its_pixels_allow(
    make_captures: Make, pictures: int, expected: tuple[int, ...]
) -> None:
    """One of each of the two wavelengths at least."""
    captures = make_captures(16)
    most = pictures * captures.images[0].size
    found = split_captures(captures, np.random.default_rng(3).uniform(size=16), max_pixels=most)
    assert tuple(len(part) for part in (found.coarse, found.fine, found.rough, found.held_out)) == expected
    for part in (found.coarse, found.fine, found.held_out):
        assert len(np.unique(captures.wavelength_m[part])) == 2
