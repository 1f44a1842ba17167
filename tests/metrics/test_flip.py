"""FLIP beside its paper's equations for uniform colours, its scale, what of an image it is given, and speckle."""

from __future__ import annotations

import sys
from itertools import pairwise

import numpy as np
import pytest

from holoview.colour import SRGB_TO_XYZ
from holoview.metrics.perceptual import flip
from holoview.util.errors import UserError
from tests.speckled import PATTERNS, picture, speckled

GREEN, BLUE = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
WHITES = 1e-4
"""The library's white has Z = 1.08890, ours 1.08906: 1.4e-4/3 of b*/200, 0.01 beside errors of 100, to the 0.7."""


def _uniform(colour: np.ndarray) -> np.ndarray:
    return np.broadcast_to(colour, (24, 32, 3))


def _adjusted_lab(colour: np.ndarray) -> np.ndarray:
    """L*a*b* with the Hunt effect, equations 4 to 8 of the paper: a colour looks more colourful where it is lighter."""
    t = SRGB_TO_XYZ @ colour / (SRGB_TO_XYZ @ np.ones(3))
    x, y, z = np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29)
    lightness = 116 * y - 16
    return np.array([lightness, 0.01 * lightness * 500 * (x - y), 0.01 * lightness * 200 * (y - z)])


def _hyab(one: np.ndarray, other: np.ndarray) -> float:
    difference = _adjusted_lab(one) - _adjusted_lab(other)
    return float(abs(difference[0]) + np.hypot(*difference[1:]))


def _paper(one: np.ndarray, other: np.ndarray) -> float:
    """FLIP of two uniform colours: the filters leave them as they are, and no edge or point differs."""
    error, largest = _hyab(one, other) ** 0.7, _hyab(GREEN, BLUE) ** 0.7
    knee = 0.4 * largest
    return 0.95 * error / knee if error < knee else 0.95 + 0.05 * (error - knee) / (largest - knee)


def test_uniform_colours_have_the_error_of_the_papers_equations() -> None:
    rng = np.random.default_rng(0)
    pairs = [(GREEN, BLUE), (np.ones(3), np.zeros(3)), *rng.random((6, 2, 3))]
    for seen, wanted in pairs:
        found = flip(_uniform(seen), _uniform(wanted), 67.0).mean
        assert found == pytest.approx(_paper(seen, wanted), abs=WHITES)
    assert flip(_uniform(GREEN), _uniform(BLUE), 67.0).mean == pytest.approx(1.0, abs=1e-6)


def test_equal_images_have_none_and_planes_their_own() -> None:
    target = np.stack([picture(), picture()[::-1]])
    image = target.copy()
    image[1] = speckled(image[1], 1)
    found = flip(image, target, 67.0)
    assert found.planes[0] == 0.0 < found.planes[1]
    assert found.mean == pytest.approx(np.mean(found.planes))
    assert found.planes[1] == flip(image[1], target[1], 67.0).mean


def test_it_falls_with_the_contrast_of_speckle() -> None:
    target = picture()
    errors = [flip(speckled(target, n), target, 60.0).mean for n in PATTERNS]
    assert all(more > 1.3 * less for more, less in pairwise(errors)), errors


def test_finer_detail_is_noticed_less() -> None:
    target = picture()
    image = speckled(target, 1, grain=2)
    errors = [flip(image, target, density).mean for density in (30.0, 67.0, 174.0)]
    assert errors[0] > 1.2 * errors[1] > 1.2 * 1.2 * errors[2]


def test_light_beyond_what_a_screen_shows_counts_as_the_most_that_it_shows() -> None:
    rng = np.random.default_rng(1)
    image = rng.uniform(-0.5, 2.0, (24, 32, 3))
    assert flip(image, np.clip(image, 0, 1), 67.0).mean == 0.0


@pytest.mark.parametrize(
    ("image", "density", "words"),
    [
        ((20, 21, 3), 67.0, r"expected \(y, x, 3\)"),
        ((20, 20, 3), 0.0, "0 samples a degree; expected a positive number"),
    ],
)
def test_what_makes_no_sense_is_refused(image: tuple[int, ...], density: float, words: str) -> None:
    with pytest.raises(UserError, match=words):
        flip(np.zeros(image), np.zeros((20, 20, 3)), density)


def test_without_the_library_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    with pytest.raises(UserError, match=r"FLIP: flip_evaluator isn't installed.*holoview\[perceptual\]"):
        flip(picture(), picture(), 67.0)
