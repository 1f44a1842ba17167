"""Perceptual scores by name: which are installed, the visual angle they are given, and how they are printed."""

from __future__ import annotations

import sys
from dataclasses import replace
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import torch

import holoview as hv
from holoview.holograms.metrics.perceptual import WHITE_CD_M2, color_video_vdp, flip, measure_perceptual_scores, ms_ssim
from holoview.holograms.metrics.perceptual_scores import (
    PERCEPTUAL_SCORES,
    installed_scores,
    require_scores,
    usable_scores,
)
from holoview.light.colour import D65_WHITE, SRGB_TO_XYZ, srgb_encode
from holoview.light.model.eye import sample_degrees
from holoview.light.numerics.structural_similarity import multi_scale_similarity
from holoview.util.errors import UserError
from tests.speckled import PATTERNS, picture, speckled


def test_ms_ssim_rises_as_the_contrast_of_speckle_falls() -> None:
    target = picture(192, 256)
    found = [ms_ssim(speckled(target, n), target) for n in PATTERNS]
    assert {one.scales for one in found} == {5}
    assert all(more.mean > less.mean + 0.03 for less, more in pairwise(found)), found


def test_the_visual_angle_is_that_of_the_eyepiece_and_without_an_eye_that_of_40_mm() -> None:
    system = hv.load("holochrome-8").with_(shape=[16, 16])
    stack = np.full((1, 32, 32, 3), 0.5)
    without = hv.simulate(system, hv.random_drive(system), planes=["10 mm"], backend="torch")
    for eyepiece, density in ((None, 174.533), ("40 mm", 174.533), ("20 mm", 87.266)):  # π/180·f/(4 µm)
        angle = None if eyepiece is None else sample_degrees(without.pitch_m, hv.Eye(eyepiece_m=eyepiece).eyepiece_m)
        found = measure_perceptual_scores(replace(without, degrees_per_sample=angle), stack, ["ms_ssim", "flip"])
        assert found["flip"].mean == pytest.approx(flip(without.rgb, stack, density).mean, rel=1e-4)
        assert found["ms_ssim"] == ms_ssim(without.rgb, stack)


def test_a_score_whose_library_is_absent_is_not_installed_and_names_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    monkeypatch.setitem(sys.modules, "pycvvdp", None)
    assert installed_scores() == ("ms_ssim",)
    require_scores(["ms_ssim"])
    for name, title in (("flip", "FLIP"), ("jod", "ColorVideoVDP")):
        with pytest.raises(UserError, match=rf"{title}.*isn't installed.*holoview\[perceptual\]"):
            require_scores([name])


def test_a_library_that_does_not_load_is_reported_and_left_out(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "pycvvdp.py").write_text('raise RuntimeError("operator torchvision::nms does not exist")\n')
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "pycvvdp", raising=False)
    assert "jod" in installed_scores()
    lines: list[str] = []
    assert "jod" not in usable_scores(lines.append)
    (line,) = lines
    assert "pycvvdp can't be loaded: operator torchvision::nms does not exist" in line


def test_a_score_is_printed_with_its_name_and_unit() -> None:
    texts = [score.format(value) for score, value in zip(PERCEPTUAL_SCORES.values(), (0.5634, 0.1, 7.456), strict=True)]
    assert texts == ["MS-SSIM 0.563", "FLIP 0.100", "ColorVideoVDP 7.46 JOD"]


def _light(*shape: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-0.1, 1.1, shape)


def test_equal_images_have_1_and_planes_their_own_values() -> None:
    target = _light(3, 24, 30, 3)
    image = target.copy()
    image[1] = _light(24, 30, 3, seed=1)
    found = ms_ssim(image, target)
    assert found.planes[0] == found.planes[2] == pytest.approx(1, abs=1e-12)
    assert found.planes[1] < 0.5 and found.mean == pytest.approx(np.mean(found.planes)) and found.scales == 2


def test_it_is_the_mean_over_channels_of_the_clipped_display_signal() -> None:
    image, target = _light(40, 30, 3), _light(40, 30, 3, seed=1)
    signals = [torch.from_numpy(np.moveaxis(srgb_encode(np.clip(one, 0, 1)), -1, 0).copy()) for one in (image, target)]
    assert ms_ssim(image, target).mean == pytest.approx(float(multi_scale_similarity(*signals).mean()), rel=1e-12)


def test_brightness_is_not_fitted() -> None:
    target = 0.6 * np.clip(_light(32, 32, 3), 0, 1)
    assert ms_ssim(0.5 * target, target).mean < 0.95


@pytest.mark.parametrize(
    ("image", "target", "words"),
    [
        ((8, 40, 3), (8, 40, 3), "40 x 8 samples; expected at least 11 rows and columns"),
        ((20, 20, 3), (20, 21, 3), r"expected \(y, x, 3\)"),
        ((20, 20), (20, 20), r"expected \(y, x, 3\)"),
    ],
)
def test_images_that_do_not_fit_are_refused(image: tuple[int, ...], target: tuple[int, ...], words: str) -> None:
    with pytest.raises(UserError, match=words):
        ms_ssim(np.zeros(image), np.zeros(target))


GREEN, BLUE = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
WHITES = 0.05
"""By so much may differences of colours differ: the library's white is X = 0.95043, Z = 1.08890, ours 0.95046, 1.08906,
which is 0.011 of a* and b*, and its numbers are float32. Between white and black it is 0.034."""


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


def _paper(difference: float, widest: float) -> float:
    """FLIP of two uniform colours: the filters leave them as they are, and no edge or point differs.

    widest: the difference of green and blue.
    """
    error, largest = difference**0.7, widest**0.7
    knee = 0.4 * largest
    return 0.95 * error / knee if error < knee else 0.95 + 0.05 * (error - knee) / (largest - knee)


def test_uniform_colours_have_the_error_of_the_papers_equations() -> None:
    rng = np.random.default_rng(0)
    pairs = [(GREEN, BLUE), (np.ones(3), np.zeros(3)), *rng.random((6, 2, 3))]
    for seen, wanted in pairs:
        found = flip(_uniform(seen), _uniform(wanted), 67.0).mean
        difference, widest = _hyab(seen, wanted), _hyab(GREEN, BLUE)
        lowest = _paper(max(difference - WHITES, 0.0), widest + WHITES)
        assert lowest <= found <= _paper(difference + WHITES, widest - WHITES)
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


needs_library = pytest.mark.skipif(
    find_spec("pycvvdp") is None, reason="cvvdp isn't installed: its torchvision must be of the same build as torch"
)


@pytest.fixture
def given(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """What a stand-in for the library is given in each of its predictions, which find 10 − (number of them)."""
    calls: list[dict[str, Any]] = []

    class Display:
        def get_peak_luminance(self) -> float:
            raise NotImplementedError

    class Metric:
        def __init__(self, **options: Any) -> None:
            self._options = options

        def predict(self, seen: Any, wanted: Any, dim_order: str) -> tuple[float, dict[str, Any]]:
            calls.append({"seen": seen, "wanted": wanted, "order": dim_order, **self._options})
            return 10.0 - len(calls), {}

    library = ModuleType("pycvvdp")
    library.cvvdp, library.vvdp_display_photometry = Metric, Display  # type: ignore[attr-defined]
    library.vvdp_display_geometry = lambda shape, ppd: (shape, ppd)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "pycvvdp", library)
    return calls


def test_the_library_is_given_light_in_absolute_units_and_the_visual_angle(given: list[dict[str, Any]]) -> None:
    target = np.full((2, 16, 24, 3), 1.0)
    image = np.random.default_rng(0).uniform(0.0, 3.0, target.shape)
    found = color_video_vdp(image, target, 174.0, 80.0)
    assert found.planes == (9.0, 8.0) and found.mean == 8.5
    for plane, call in zip(image, given, strict=True):
        assert call["order"] == "CHW" and call["display_geometry"] == ((24, 16), 174.0)
        np.testing.assert_allclose(np.moveaxis(call["seen"].numpy(), 0, -1), 80 * plane @ SRGB_TO_XYZ.T, rtol=1e-6)
        np.testing.assert_allclose(call["wanted"].numpy()[:, 3, 5], 80 * D65_WHITE, rtol=1e-6)
        display = call["display_photometry"]
        assert display.forward(call["seen"]) is call["seen"] and not display.is_input_display_encoded()
        assert display.rgb2xyz_list == np.eye(3).tolist()


def test_there_is_no_light_below_black_and_white_has_a_stated_luminance(given: list[dict[str, Any]]) -> None:
    color_video_vdp(np.full((16, 16, 3), -1.0), np.full((16, 16, 3), 1.0), 60.0)
    assert (given[0]["seen"].numpy() == np.float32(0.005)).all()
    assert given[0]["wanted"].numpy()[1].mean() == pytest.approx(WHITE_CD_M2, rel=1e-6)


@pytest.mark.parametrize(
    ("shape", "density", "white", "words"),
    [
        ((15, 40, 3), 60.0, 100.0, "40 x 15 samples; expected at least 16 rows and columns"),
        ((20, 40, 3), 0.0, 100.0, "0 samples a degree"),
        ((20, 40, 3), 60.0, -1.0, "white of -1 cd/m²"),
    ],
)
@pytest.mark.usefixtures("given")
def test_what_makes_no_sense_is_refused_of_color_video_vdp(
    shape: tuple[int, ...], density: float, white: float, words: str
) -> None:
    with pytest.raises(UserError, match=words):
        color_video_vdp(np.zeros(shape), np.zeros(shape), density, white)


@pytest.mark.usefixtures("given")
def test_images_of_other_shapes_are_refused() -> None:
    with pytest.raises(UserError, match=r"expected \(y, x, 3\)"):
        color_video_vdp(np.zeros((20, 21, 3)), np.zeros((20, 20, 3)), 60.0)


def test_without_the_library_the_extra_is_named_of_color_video_vdp(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pycvvdp", None)
    with pytest.raises(UserError, match=r"ColorVideoVDP: pycvvdp isn't installed.*holoview\[perceptual\]"):
        color_video_vdp(picture(), picture(), 60.0)


@needs_library
def test_equal_images_have_10_and_it_rises_as_the_contrast_of_speckle_falls() -> None:
    target = picture()
    assert color_video_vdp(target, target, 60.0).mean == 10.0
    found = [color_video_vdp(speckled(target, n), target, 60.0).mean for n in PATTERNS]
    assert all(more > less + 0.2 for less, more in pairwise(found)), found


@needs_library
def test_speckle_is_seen_less_where_it_is_finer_or_darker_and_more_where_it_outshines_white() -> None:
    target = picture()
    image = speckled(target, 4)
    plain = color_video_vdp(image, target, 60.0).mean
    assert color_video_vdp(image, target, 240.0).mean > plain + 0.2
    assert color_video_vdp(image, target, 60.0, 1.0).mean > plain + 0.2
    assert color_video_vdp(np.minimum(image, 0.7), target, 60.0).mean > plain
