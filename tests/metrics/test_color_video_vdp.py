"""ColorVideoVDP: what the library is given, by a stand-in for it, and where it is installed, what it finds of speckle.

`benchmarks/perceptual_scores.py` repeats its published examples, which need the authors' pictures.
"""

from __future__ import annotations

import sys
from importlib.util import find_spec
from itertools import pairwise
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from holoview.colour import D65_WHITE, SRGB_TO_XYZ
from holoview.metrics.perceptual import WHITE_CD_M2, color_video_vdp
from holoview.util.errors import UserError
from tests.speckled import PATTERNS, picture, speckled

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
def test_what_makes_no_sense_is_refused(shape: tuple[int, ...], density: float, white: float, words: str) -> None:
    with pytest.raises(UserError, match=words):
        color_video_vdp(np.zeros(shape), np.zeros(shape), density, white)


@pytest.mark.usefixtures("given")
def test_images_of_other_shapes_are_refused() -> None:
    with pytest.raises(UserError, match=r"expected \(y, x, 3\)"):
        color_video_vdp(np.zeros((20, 21, 3)), np.zeros((20, 20, 3)), 60.0)


def test_without_the_library_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
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
