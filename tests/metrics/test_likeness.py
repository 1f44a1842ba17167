"""Whether a picture shows its target: pictures whose share of the target's structure is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from holoview.holograms.metrics.likeness import OtherPlanes, likeness, luminance_contrast
from holoview.light.colour import SRGB_TO_XYZ
from holoview.viewer.document.measurements import contrast_by_wavelength, measure_region
from tests.document.conftest import small_system

SIDE, GRAIN = 128, 4
WHOLE = (0, 0, SIDE, SIDE)


def _target(seed: int = 0, contrast: float = 0.5) -> np.ndarray:
    """A luminance (y, x) of mean 1 with smooth structure."""
    structure = ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=(SIDE, SIDE)), 6.0, mode="wrap")
    return np.maximum(1 + contrast * structure / structure.std(), 0.1)


def _speckle(seed: int, patterns: int = 4) -> np.ndarray:
    """The sum of independent speckle patterns behind a square pupil, of mean 1, with grains some samples wide."""
    rng, side = np.random.default_rng(1000 + seed), SIDE // GRAIN
    found = np.zeros((SIDE, SIDE))
    for _ in range(patterns):
        spectrum = np.zeros((SIDE, SIDE), complex)
        spectrum[:side, :side] = rng.normal(size=(side, side)) + 1j * rng.normal(size=(side, side))
        found += np.abs(np.fft.ifft2(spectrum)) ** 2
    return found / found.mean()


def _grey(luminance: np.ndarray) -> np.ndarray:
    return np.repeat(luminance[..., None], 3, axis=-1)


@pytest.mark.parametrize("stray", [0.0, 1.0, 3.0])
def test_the_share_is_the_slope_of_the_picture_on_its_target(stray: float) -> None:
    """Over 24 draws the mean share is right within 5 of its standard errors, and they scatter as it is said.

    The deviation of 24 normal numbers is within 0.5 and 1.6 of the true one but for 1 in 10⁵ (χ² of 23 degrees).
    """
    target = _target()
    found = [likeness((target + stray) * _speckle(seed), target) for seed in range(24)]
    shares, stated = np.array([of.share for of in found]), np.mean([of.standard_error for of in found])
    share = target.mean() / (target.mean() + stray)
    assert shares.mean() == pytest.approx(share, abs=5 * stated / np.sqrt(24))
    assert 0.5 < shares.std(ddof=1) / stated < 1.6


def test_of_a_picture_that_shows_something_else_the_contrast_is_withheld() -> None:
    target = _target(1)
    for picture in (_speckle(3), _target(2) * _speckle(3), (target + 4) * _speckle(3)):
        found = luminance_contrast(picture, WHOLE, _grey(target))
        assert "doesn't show the target" in found.withheld and not found.has_target
        assert found.estimate.contrast == found.raw.contrast
    shown = luminance_contrast(target * _speckle(3), WHOLE, _grey(target))
    assert not shown.withheld and shown.has_target
    assert shown.estimate.contrast == pytest.approx(0.5, abs=5 * shown.estimate.standard_error)


def _scene(seed: int) -> np.ndarray:
    """A luminance (y, x) of mean 1 with objects of sharp edges, from dark to bright."""
    rng, scene = np.random.default_rng(500 + seed), np.full((SIDE, SIDE), 0.4)
    for _ in range(40):
        y, x = rng.integers(0, SIDE - 12, 2)
        height, width = rng.integers(8, 40, 2)
        scene[y : y + height, x : x + width] = 10 ** rng.uniform(-0.7, 0.3)
    return scene / scene.mean()


@pytest.mark.parametrize(
    ("blur", "least", "most"), [(0.0, 0.0, 0.0), (1.0, 0.7, 1.4), (2.5, 2.0, 2.8), (3.5, 2.8, 4.0)]
)
def test_a_target_is_divided_out_at_the_resolution_that_the_picture_shows(
    blur: float, least: float, most: float
) -> None:
    """A picture that is known to be blurred, by scipy: four patterns have the contrast 1/2 whatever it shows.

    The widths are a factor of √2 apart, so that the next finer or the next wider one may fit best.
    """
    for seed in range(4):
        target = _scene(seed)
        shown = ndimage.gaussian_filter(target, blur, mode="nearest") if blur else target
        found = luminance_contrast(shown * _speckle(40 + seed), WHOLE, _grey(target))
        assert found.has_target and not found.withheld and least <= found.blur_px <= most
        assert found.estimate.contrast == pytest.approx(0.5, abs=5 * found.estimate.standard_error)
        assert found.left is not None
        for left in (found.left.levels, found.left.edges, found.left.places):
            assert left.share < 0.05 + 5 * left.standard_error


def _with_another_object(target: np.ndarray) -> np.ndarray:
    """Six times as bright, or as dark, in a tenth of the area."""
    changed = target.copy()
    changed[40:80, 32:72] *= 1 / 6 if target[40:80, 32:72].mean() > target.mean() else 6.0
    return changed


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda target: np.roll(target, 1, axis=1), "displaced by 1 px to the left it leaves"),
        (lambda target: np.roll(target, (-5, 2), axis=(0, 1)), "displaced by 2 px to the left and 5 px down it leaves"),
        (lambda target: np.roll(target, 20, axis=0), "displaced by 20 px up it leaves"),
        (lambda target: target[:, ::-1], "mirrored it leaves"),
        (lambda target: target[::-1], "upside down it leaves"),
        (lambda target: target[::-1, ::-1], "turned by 180° it leaves"),
        (lambda target: target**0.45, "read as a signal, not as light, it leaves"),
        (lambda target: target**2.2, "read as light, not as a signal, it leaves"),
        (_with_another_object, "the target"),
    ],
)
def test_a_wrong_target_that_shares_structure_is_withheld(wrong: Callable[[np.ndarray], np.ndarray], said: str) -> None:
    """Displaced, mirrored, with a tone curve, with something else in a place: in each of four scenes, for any seed."""
    for seed in range(4):
        target = _scene(seed)
        found = luminance_contrast(target * _speckle(50 + seed, patterns=16), WHOLE, _grey(wrong(target)))
        assert found.withheld and not found.has_target and said in found.withheld
        assert found.estimate.contrast == found.raw.contrast


@pytest.mark.parametrize("by", [(0, 1), (-3, 2)])
def test_a_displaced_target_is_aligned_where_that_is_asked(by: tuple[int, int]) -> None:
    """Then the contrast is that beside the right target, but for the border that the displacement lost."""
    target, region = _scene(4), (24, 24, 80, 80)
    picture, wrong = target * _speckle(60, patterns=16), np.roll(target, by, axis=(0, 1))
    assert luminance_contrast(picture, region, _grey(wrong)).withheld
    found = luminance_contrast(picture, region, _grey(wrong), is_aligned=True)
    right = luminance_contrast(picture, region, _grey(target), is_aligned=True)
    assert found.displacement_px == (-by[0], -by[1]) and right.displacement_px == (0, 0)
    assert found.has_target and found.estimate.contrast == pytest.approx(right.estimate.contrast, rel=1e-6)


def test_the_target_of_another_plane_is_said() -> None:
    """Beside a stack of a sharp and two blurred pictures, of which the picture shows the first."""
    scene = _scene(5)
    near, far = (ndimage.gaussian_filter(scene, (0, width), mode="nearest") for width in (3.0, 8.0))
    picture, others = scene * _speckle(61, patterns=16), OtherPlanes({"at 5 mm": _grey(scene), "at 9 mm": _grey(near)})
    found = luminance_contrast(picture, WHOLE, _grey(far), others=others)
    assert found.better is not None and found.better.what == "at 5 mm" and "at 5 mm it leaves" in found.withheld
    rest = OtherPlanes({"at 9 mm": _grey(near), "at 12 mm": _grey(far)})
    right = luminance_contrast(picture, WHOLE, _grey(scene), others=rest)
    assert right.better is None and not right.withheld


def test_of_a_target_made_for_its_plane_it_is_only_said_that_that_of_another_plane_fits_better() -> None:
    """A hologram that shows at its first plane what is at its second, as one of few iterations does, has no other one.

    Of the speckle s of 16 patterns and the target M' that is shown, division by M leaves the contrast of s·M'/M.
    """
    near = _scene(5)
    far = ndimage.gaussian_filter(near, (0, 6.0), mode="nearest")
    speckle = _speckle(61, patterns=16)
    given = OtherPlanes({"at 5 mm": _grey(near)})
    made = replace(given, are_mistakable=False)
    withheld, stated = (luminance_contrast(near * speckle, WHOLE, _grey(far), others=of) for of in (given, made))
    assert "at 5 mm it leaves" in withheld.withheld and not withheld.doubt
    assert not stated.withheld and stated.has_target and stated.doubt.startswith("another target fits better: at 5 mm")
    ratio = speckle * near / far
    assert stated.estimate.contrast == pytest.approx(ratio.std() / ratio.mean(), rel=0.05)


def test_a_target_with_next_to_no_structure_is_not_withheld_for_what_it_happens_to_share() -> None:
    """A tilt of 10⁻⁶ has a share of thousands of some speckle, of either sign, and division by it changes nothing."""
    tilt = np.broadcast_to(1 + 1e-6 * np.linspace(-1, 1, SIDE), (SIDE, SIDE))
    for seed in range(4):
        for picture in (_speckle(seed), _speckle(seed) * (tilt - 1e5 * (tilt - 1))):
            found = luminance_contrast(picture, WHOLE, _grey(tilt))
            assert not found.withheld
            assert found.estimate.contrast == pytest.approx(found.raw.contrast, rel=1e-4)


def test_a_right_target_is_stated_for_any_seed_and_contrast() -> None:
    """Of 40 pictures of one to sixteen patterns in four scenes none is withheld.

    Each limit is two standard errors beyond a fifth or a tenth of the variance, which speckle reaches with neither.
    """
    for seed in range(40):
        patterns = (1, 4, 16)[seed % 3]
        found = luminance_contrast(_scene(seed % 4) * _speckle(100 + seed, patterns), WHOLE, _grey(_scene(seed % 4)))
        assert not found.withheld, f"seed {seed}: {found.withheld}"


def test_a_contrast_above_that_of_speckle_is_withheld() -> None:
    """A target with hardly any structure beside a picture of dots in the dark."""
    picture = np.where(np.random.default_rng(9).random((SIDE, SIDE)) < 0.02, 1.0, 0.01)
    found = luminance_contrast(picture, WHOLE, _grey(_target(3, contrast=0.05)))
    assert "speckle has 1 at most" in found.withheld or "doesn't show" in found.withheld


def test_an_even_target_decides_and_changes_nothing() -> None:
    picture = _speckle(5)
    for target in (np.ones((SIDE, SIDE)), _target(6, contrast=0.005)):
        found = luminance_contrast(picture, WHOLE, _grey(target))
        assert not found.withheld and found.has_target
        assert found.estimate.contrast == pytest.approx(found.raw.contrast, abs=found.estimate.standard_error)


def test_the_viewer_withholds_it_and_has_its_standard_error() -> None:
    target = _grey(_target(7))
    shown = measure_region((target * _speckle(8)[..., None]) @ SRGB_TO_XYZ.T, WHOLE, target)
    known = luminance_contrast((target * _speckle(8)[..., None] @ SRGB_TO_XYZ.T)[..., 1], WHOLE, target).estimate
    assert (shown.contrast, shown.standard_error) == (known.contrast, known.standard_error)
    assert shown.text == f"{known.contrast:.3f} ± {known.standard_error:.3f}"
    other = measure_region(_grey(_speckle(9)) @ SRGB_TO_XYZ.T, WHOLE, target)
    assert other.contrast is None and other.text == "withheld" and other.raw_contrast > 0.3
    assert "doesn't show the target" in other.withheld and other.psnr_db is not None


def test_the_contrast_by_wavelength_has_errors_and_no_structure_of_the_target() -> None:
    """A laser that follows one channel of the target has the contrast 1; evenly lit ones 1/√1, 1/√2, 1/√3."""
    system, rng = small_system(observer="mono"), np.random.default_rng(10)
    target = np.stack([_target(seed) for seed in (11, 12, 13)], axis=-1)
    lasers = [target[..., i] * _speckle(20 + i, patterns=1) for i in rng.permutation(3)]
    curve = contrast_by_wavelength(lasers.__getitem__, system, WHOLE, target=target)
    assert not curve.is_raw
    assert curve.measured[0] == pytest.approx(1.0, abs=5 * curve.errors[0])
    raw = contrast_by_wavelength(lasers.__getitem__, system, WHOLE)
    assert raw.is_raw and raw.measured[0] > curve.measured[0]
    even = contrast_by_wavelength([_speckle(30 + i, 1) for i in range(3)].__getitem__, system, WHOLE)
    assert np.all(np.abs(even.measured - 1 / np.sqrt([1, 2, 3])) < 5 * even.errors)
